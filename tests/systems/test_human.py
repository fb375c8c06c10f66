"""Human: actions follow in time, waiting ends when the robot is ready, the hand follows the demonstration."""

import numpy as np
import pytest

from pace_drake.demos import Demonstration
from pace_drake.systems.human import Human
from pace_drake.task import Episode
from tests.systems.forced import force_update
from tests.systems.tasks import five_actions

PATH = np.column_stack([np.linspace(0, 1, 11), np.linspace(1, 0, 11), np.zeros(11)])


def demonstration(action, offset=0.0):
    return Demonstration(action, "S1", "1", 0.1, PATH + offset, synthetic=True)


@pytest.fixture(scope="module")
def dut():
    """a (10 s), b (5 s), joint c (4 s), d (2 s), joint e (3 s)."""
    return Human(
        five_actions(),
        [[demonstration("a"), demonstration("a", 5.0)], [demonstration("b")], [], [demonstration("d", 2.0)], []],
    )


@pytest.fixture
def context(dut):
    context = dut.CreateDefaultContext()
    none = np.zeros(0)
    dut.set_episode(context, Episode(np.array([10.0, 5, 4, 2, 3]), np.array([1, 0, -1, 0, -1]), none, none, none))
    dut.GetInputPort("joint_ready").FixValue(context, 0.0)
    return context


def out(dut, context, name, time):
    context.SetTime(time)
    value = dut.GetOutputPort(name).Eval(context)
    return value if len(value) > 1 else value[0]


def status(dut, context, time):
    names = ("human_action", "human_elapsed", "human_waiting", "human_joint", "joints_done", "next_event_time")
    return [out(dut, context, name, time) for name in names]


def ready(dut, context, time, joint):
    dut.GetInputPort("joint_ready").FixValue(context, float(joint))
    context.SetTime(time)
    force_update(dut, context)


def test_the_sequence(dut, context):
    assert status(dut, context, 0.0) == [1, 0, 0, 0, 0, 10]
    assert status(dut, context, 9.5) == [1, 9.5, 0, 0, 0, 10]
    assert status(dut, context, 10.0) == [2, 0, 0, 0, 0, 15]  # the action ends at its end, not after
    assert status(dut, context, 15.0) == [3, 0, 1, 1, 0, np.inf]
    assert status(dut, context, 20.0) == [3, 5, 1, 1, 0, np.inf]
    ready(dut, context, 20.0, 1)
    assert status(dut, context, 20.0) == [3, 0, 0, 1, 0, 24]
    assert status(dut, context, 24.0) == [4, 0, 0, 0, 1, 26]
    assert status(dut, context, 26.0) == [5, 0, 1, 2, 1, np.inf]
    ready(dut, context, 26.0, 2)
    assert status(dut, context, 28.0) == [5, 2, 0, 2, 1, 29]
    assert status(dut, context, 30.0) == [5, 1, 0, 0, 2, np.inf]


@pytest.mark.parametrize(("time", "joint"), [(12.0, 1), (16.0, 2), (16.0, 0)])
def test_a_joint_action_begins_only_where_the_person_waits_for_it(dut, context, time, joint):
    before = status(dut, context, time)
    ready(dut, context, time, joint)
    assert status(dut, context, time) == before


def test_the_hand_follows_the_drawn_demonstration_rescaled_to_the_drawn_duration(dut, context):
    np.testing.assert_allclose(out(dut, context, "p_WH", 2.5), [5.25, 5.75, 5.0])
    np.testing.assert_allclose(out(dut, context, "p_WH", 11.0), [0.2, 0.8, 0.0])


def test_waiting_the_hand_rests_and_in_a_joint_action_it_moves_to_where_the_next_begins(dut, context):
    np.testing.assert_allclose(out(dut, context, "p_WH", 17.0), PATH[-1])
    ready(dut, context, 20.0, 1)
    np.testing.assert_allclose(out(dut, context, "p_WH", 20.0), PATH[-1])
    np.testing.assert_allclose(out(dut, context, "p_WH", 22.0), (PATH[-1] + PATH[0] + 2.0) / 2)
    quarter = 0.103515625  # minimum jerk: 10 s^3 - 15 s^4 + 6 s^5
    np.testing.assert_allclose(out(dut, context, "p_WH", 21.0), PATH[-1] + quarter * (PATH[0] + 2.0 - PATH[-1]))
    np.testing.assert_allclose(out(dut, context, "p_WH", 24.0 - 1e-9), PATH[0] + 2.0, atol=1e-6)


def test_the_tracker_s_clock_restarts_with_each_action(dut, context):
    np.testing.assert_allclose(out(dut, context, "p_WH_sampled", 2.57), out(dut, context, "p_WH", 2.5))
    for k in range(100):  # no sample is lost to rounding, wherever the global clock stands
        assert out(dut, context, "p_WH_sampled", k * 0.1)[0] == pytest.approx(5.0 + k * 0.01)


def test_progress(dut, context):
    for time, progress in ((5.0, 0.5), (12.5, 0.5), (16.0, 1.0)):
        context.SetTime(time)
        assert dut.progress(context) == pytest.approx(progress)
