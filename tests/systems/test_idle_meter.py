"""IdleMeter: increments between updates, and up to now."""

import numpy as np
import pytest

from pace_drake.systems.idle_meter import IdleMeter
from tests.systems.forced import force_update


@pytest.fixture(scope="module")
def dut():
    return IdleMeter(num_joint_actions=2, human_idle_weight=3.0)


def at(dut, context, time, robot=0, human=0, joint=0):
    """Moves to ``time``, with these inputs from then on."""
    context.SetTime(time)
    for name, value in (("robot_waiting", robot), ("human_waiting", human), ("human_joint", joint)):
        dut.GetInputPort(name).FixValue(context, float(value))
    force_update(dut, context)


def idle(dut, context):
    return np.array([dut.GetOutputPort(name).Eval(context) for name in ("robot_idle", "human_idle")])


def test_intervals_count_for_the_agent_and_joint_action_that_waited(dut):
    context = dut.CreateDefaultContext()
    at(dut, context, 0.0)
    at(dut, context, 1.0, robot=1)
    at(dut, context, 3.5, human=1, joint=2)  # robot waited 2.5 s at 1
    context.SetTime(4.0)
    np.testing.assert_allclose(idle(dut, context), [[2.5, 0], [0, 0.5]])  # up to now
    assert dut.GetOutputPort("cost").Eval(context)[0] == pytest.approx(2.5 + 3 * 0.5)
    at(dut, context, 5.0)
    at(dut, context, 9.0)
    np.testing.assert_allclose(idle(dut, context), [[2.5, 0], [0, 1.5]])


def test_being_at_a_joint_action_is_not_waiting_for_it(dut):
    context = dut.CreateDefaultContext()
    at(dut, context, 0.0, human=0, joint=1)
    at(dut, context, 5.0)
    assert not idle(dut, context).any()


def test_with_one_joint_action_the_ports_are_still_vectors():
    dut = IdleMeter(1, 3.0)
    assert dut.GetOutputPort("robot_idle").size() == 1
    context = dut.CreateDefaultContext()
    at(dut, context, 0.0, robot=1)
    context.SetTime(2.0)
    assert dut.GetOutputPort("robot_idle").Eval(context) == [2.0]
