"""ActionMonitor: actions end when the hand or the button says so, joint actions when the robot has felt it."""

import numpy as np
import pytest

from pace_drake.systems.action_monitor import ActionMonitor
from tests.systems.forced import force_update
from tests.systems.tasks import five_actions


class EndsAfter:
    """A detector that says the end at its n-th sample."""

    num_states = 2

    def __init__(self, num):
        self.num = num

    def initial_state(self):
        return np.zeros(2)

    def step(self, state, sample):
        state[0] += 1.0
        state[1] = sample[0]

    def ended_at(self, state):
        return state[0] >= self.num


@pytest.fixture(scope="module")
def task():
    """a, b, joint c, d, joint e."""
    return five_actions()


def begin(dut):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("p_WH").FixValue(context, np.array([1.0, 2.0, 3.0]))
    dut.GetInputPort("joints_done").FixValue(context, 0.0)
    return context


def at(dut, context, time, **inputs):
    """Updates at a time [s], and returns (human_action, human_joint, human_elapsed)."""
    context.SetTime(time)
    for name, value in inputs.items():
        dut.GetInputPort(name).FixValue(context, value)
    force_update(dut, context)
    return tuple(dut.GetOutputPort(name).Eval(context)[0] for name in ("human_action", "human_joint", "human_elapsed"))


def test_follows_detectors_and_joint_actions(task):
    dut = ActionMonitor(task, [EndsAfter(3), EndsAfter(2), None, EndsAfter(1), None])
    context = begin(dut)
    assert at(dut, context, 0.0) == (1, 0, 0.0)
    assert at(dut, context, 0.1) == (1, 0, 0.1)
    assert at(dut, context, 0.2) == (2, 0, 0.0)
    assert at(dut, context, 0.3)[:2] == (2, 0)
    assert at(dut, context, 0.4) == (3, 1, 0.0)
    assert at(dut, context, 5.0) == (3, 1, 4.6)
    assert at(dut, context, 5.05, joints_done=1.0) == (4, 0, 0.0)
    assert dut.GetOutputPort("next_event_time").Eval(context)[0] == pytest.approx(5.1)


def test_samples_once_in_a_period(task):
    dut = ActionMonitor(task, [EndsAfter(3), None, None, None, None])
    context = begin(dut)
    for time in (0.0, 0.03, 0.05, 0.09):
        assert at(dut, context, time)[0] == 1
    assert context.get_discrete_state_vector().value()[4] == 1.0


def test_a_press_ends_an_action_and_a_press_in_a_joint_action_ends_nothing(task):
    dut = ActionMonitor(task, [None] * 5)
    context = begin(dut)
    assert at(dut, context, 1.0)[0] == 1
    assert at(dut, context, 2.0, button=1.0)[0] == 2
    assert at(dut, context, 3.0)[0] == 2
    assert at(dut, context, 4.0, button=2.0)[:2] == (3, 1)
    assert at(dut, context, 5.0, button=3.0)[:2] == (3, 1)
    assert at(dut, context, 6.0, joints_done=1.0)[:2] == (4, 0)
    assert at(dut, context, 7.0)[:2] == (4, 0)


def test_stays_in_the_last_action(task):
    dut = ActionMonitor(task, [None] * 5)
    context = begin(dut)
    for presses in (1.0, 2.0):
        at(dut, context, presses, button=presses)
    at(dut, context, 3.0, joints_done=1.0)
    at(dut, context, 4.0, button=3.0)
    assert at(dut, context, 9.0, joints_done=2.0)[:2] == (5, 2)


def test_a_hand_that_is_not_seen_is_no_sample(task):
    dut = ActionMonitor(task, [EndsAfter(2), EndsAfter(2), None, None, None])
    context = begin(dut)
    nowhere = np.full(3, np.nan)
    for time in (0.0, 0.1, 0.2):
        assert at(dut, context, time, p_WH=nowhere)[0] == 1
    assert context.get_discrete_state_vector().value()[4] == 0.0
    assert at(dut, context, 0.3, p_WH=np.ones(3))[0] == 1
    assert at(dut, context, 0.4)[0] == 2
    # The button needs no hand.
    assert at(dut, context, 0.5, p_WH=nowhere, button=1.0)[0] == 3
