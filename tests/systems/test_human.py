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


# ---- places of the hand in joint actions

GRIP = np.array([0.7, 0.1, 0.4])
PLACED = np.array([0.8, -0.2, 0.2])


@pytest.fixture(scope="module")
def with_paths():
    """Joint c takes the hand to two places; joint e keeps it at one from half of its time to four fifths."""
    return Human(
        five_actions(),
        [[demonstration("a"), demonstration("a", 5.0)], [demonstration("b")], [], [demonstration("d", 2.0)], []],
        [[(0.35, GRIP), (0.8, PLACED)], [(0.5, GRIP), (0.8, GRIP)]],
    )


@pytest.fixture
def both_joints(with_paths):
    """Joint c (4 s) begins at 20 s, d follows at 24 s, joint e (3 s) begins at 30 s and is the last."""
    context = with_paths.CreateDefaultContext()
    none = np.zeros(0)
    with_paths.set_episode(
        context, Episode(np.array([10.0, 5, 4, 2, 3]), np.array([1, 0, -1, 0, -1]), none, none, none)
    )
    ready(with_paths, context, 20.0, 1)
    first = context.Clone()
    ready(with_paths, context, 30.0, 2)
    return first, context


def test_in_a_joint_action_the_hand_is_at_its_places_at_their_shares_of_the_time(with_paths, both_joints):
    first, last = both_joints
    for time, place in ((20.0, PATH[-1]), (21.4, GRIP), (23.2, PLACED), (24.0 - 1e-9, PATH[0] + 2.0)):
        np.testing.assert_allclose(out(with_paths, first, "p_WH", time), place, atol=1e-6)
    np.testing.assert_allclose(out(with_paths, first, "p_WH", 22.3), (GRIP + PLACED) / 2)  # halfway in time
    for time, place in ((30.0, PATH[-1] + 2.0), (31.5, GRIP), (32.0, GRIP), (32.4, GRIP)):
        np.testing.assert_allclose(out(with_paths, last, "p_WH", time), place, atol=1e-6)


def test_after_the_last_joint_action_the_hand_rests_where_that_left_it(with_paths, both_joints):
    _, last = both_joints
    for time in (32.7, 33.0 - 1e-9):
        np.testing.assert_allclose(out(with_paths, last, "p_WH", time), GRIP, atol=1e-9)


def test_the_hand_never_jumps_in_a_joint_action(with_paths, both_joints):
    first, _ = both_joints
    times = np.arange(20.0, 24.2, 0.005)
    p_WH = np.array([out(with_paths, first, "p_WH", time) for time in times])
    speed = np.linalg.norm(np.diff(p_WH, axis=0), axis=1) / 0.005
    legs = np.diff([PATH[-1], GRIP, PLACED, PATH[0] + 2.0], axis=0)
    mean = np.linalg.norm(legs, axis=1) / (4.0 * np.diff([0.0, 0.35, 0.8, 1.0]))
    assert np.max(speed) < 15 / 8 * np.max(mean) + 1e-3  # as fast as a minimum jerk gets
    for place in (GRIP, PLACED):  # at a place it is at rest
        assert speed[np.argmin(np.linalg.norm(p_WH[:-1] - place, axis=1))] < 0.02


def test_without_places_the_hand_goes_straight_on(dut, context):
    ready(dut, context, 20.0, 1)
    straight = Human(
        five_actions(),
        [[demonstration("a"), demonstration("a", 5.0)], [demonstration("b")], [], [demonstration("d", 2.0)], []],
        [[], []],
    )
    state = straight.CreateDefaultContext()
    state.SetDiscreteState(context.get_discrete_state_vector().value())
    for time in np.linspace(20.0, 26.0, 30):
        np.testing.assert_array_equal(out(straight, state, "p_WH", time), out(dut, context, "p_WH", time))
