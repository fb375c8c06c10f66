"""RobotAction: one motion per sequence number; HOLD freezes, a new number of the same command goes on."""

import numpy as np
import pytest

from pace_drake.systems.robot_action import NUM_POSTURES, Pacing, RobotAction
from pace_drake.task import ActionKind, sample_episode
from tests.systems.forced import force_update


class LineMotions:
    """Straight joint motions; each (kind, index) ends somewhere else."""

    home = np.zeros(7)

    def position(self, kind, index, fraction):
        return np.full(7, 0.1 * int(kind) + 0.01 * index) * fraction

    def velocity(self, kind, index, fraction):
        inside = 0 <= fraction <= 1
        return np.full(7, 0.1 * int(kind) + 0.01 * index) / self.minimum_duration(kind, index) * inside

    def gripper_width(self, kind, index, fraction):
        return 0.04 * (1 - fraction)

    def minimum_duration(self, kind, index):
        return 9.0 if kind == ActionKind.PREPARE else 1.0


class Bench:
    def __init__(self, dut, episode):
        self.dut = dut
        self.context = dut.CreateDefaultContext()
        dut.set_episode(self.context, episode)

    def update(self, time, kind, index, sequence):
        self.context.SetTime(time)
        self.dut.GetInputPort("robot_action").FixValue(self.context, [float(kind), index, sequence])
        force_update(self.dut, self.context)

    def out(self, name, time=None):
        if time is not None:
            self.context.SetTime(time)
        value = self.dut.GetOutputPort(name).Eval(self.context)
        return value[0] if len(value) == 1 else value


@pytest.fixture(scope="module")
def episode(chair):
    return sample_episode(chair.task, np.random.default_rng(0), [1, 0, 1, 0, 1, 0])


@pytest.fixture(scope="module")
def task_level(chair):
    return RobotAction(chair.task)


@pytest.fixture
def bench(task_level, episode):
    return Bench(task_level, episode)


def test_a_robot_task_takes_the_time_drawn_for_its_command(bench, episode):
    bench.update(1.0, ActionKind.ROBOT_TASK, 2, 5)
    end = 1.0 + episode.robot[4, 1]
    assert bench.out("next_event_time") == end
    assert bench.out("motion_done", end - 1e-9) == 0
    assert bench.out("robot_busy") == 1
    assert bench.out("motion_done", end) == 5
    assert bench.out("motion_progress", end + 5.0)[2] == 1.0  # and no further, however late the next update is
    assert bench.out("robot_busy") == 0


def test_assistance_takes_the_times_drawn_for_the_joint_action(bench, episode):
    cases = (
        (ActionKind.PREPARE, episode.preparation[1]),
        (ActionKind.JOINT, episode.human[3]),  # the person's pace
        (ActionKind.HOME, episode.homing[1]),
        (ActionKind.HOME_ABORTED, episode.homing[1]),
    )
    time = 0.0
    for sequence, (kind, duration) in enumerate(cases, start=1):
        bench.update(time, kind, 2, sequence)
        assert bench.out("next_event_time") == time + duration
        time += duration
        assert bench.out("motion_done", time) == sequence


def test_the_same_sequence_number_is_the_same_command(bench):
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    end = bench.out("next_event_time")
    bench.update(2.0, ActionKind.ROBOT_TASK, 1, 1)
    assert bench.out("next_event_time") == end
    bench.update(end, ActionKind.NONE, 0, 1)
    bench.update(end + 3.0, ActionKind.ROBOT_TASK, 1, 1)
    assert bench.out("motion_done", end + 30.0) == 1
    assert bench.out("next_event_time") == np.inf


def test_hold_freezes_and_a_new_number_goes_on_where_it_was(bench, episode):
    duration = episode.robot[0, 0]
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    bench.update(2.0, ActionKind.HOLD, 0, 1)
    assert bench.out("robot_busy", 50.0) == 0
    assert bench.out("motion_done") == 0
    assert bench.out("motion_progress")[2] == pytest.approx(2.0 / duration)
    bench.update(50.0, ActionKind.ROBOT_TASK, 1, 2)
    assert bench.out("motion_progress")[2] == pytest.approx(2.0 / duration)
    assert bench.out("next_event_time") == pytest.approx(50.0 + duration - 2.0)
    assert bench.out("motion_done", bench.out("next_event_time")) == 2


def test_another_command_after_a_hold_starts_from_its_beginning(bench):
    bench.update(0.0, ActionKind.PREPARE, 1, 1)
    bench.update(2.0, ActionKind.HOLD, 0, 1)
    bench.update(3.0, ActionKind.HOME_ABORTED, 1, 2)
    assert bench.out("motion_progress")[2] == 0


def test_the_same_command_after_it_was_finished_starts_anew(bench):
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    end = bench.out("next_event_time")
    bench.update(end, ActionKind.ROBOT_TASK, 1, 2)
    assert bench.out("motion_progress")[2] == 0
    assert bench.out("motion_done") == 1


def test_with_motions_it_is_done_when_the_arm_is_there_and_never_faster_than_the_limits(chair, episode):
    bench = Bench(RobotAction(chair.task, LineMotions()), episode)
    measured = bench.dut.GetInputPort("position_measured")
    measured.FixValue(bench.context, np.zeros(7))
    assert np.all(bench.out("position", 0.0) == 0)
    bench.update(0.0, ActionKind.PREPARE, 2, 1)
    assert episode.preparation[1] < 9.0
    assert bench.out("next_event_time") == 9.0
    np.testing.assert_allclose(bench.out("position", 4.5), np.full(7, 0.11))
    assert bench.out("gripper_position") == pytest.approx(0.02)
    assert bench.out("motion_done", 9.0) == 0  # its time is over, the arm is not there
    assert bench.out("robot_busy") == 1
    assert bench.out("next_event_time") == pytest.approx(9.01)
    measured.FixValue(bench.context, np.full(7, 0.22 + 0.04))
    assert bench.out("motion_done") == 1


def test_holding_and_going_on_never_jump_in_velocity(chair, episode):
    """The fraction of the path is continuous with its rate; the motion loses half the stop time twice over."""
    stop_time = 0.4
    bench = Bench(RobotAction(chair.task, LineMotions(), stop_time=stop_time), episode)
    bench.dut.GetInputPort("position_measured").FixValue(bench.context, np.full(7, 0.11))
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    duration = bench.out("next_event_time")
    commands = {2.0: (ActionKind.HOLD, 0, 1), 5.0: (ActionKind.ROBOT_TASK, 1, 2)}
    step, fractions, busy = 0.01, [], []
    for k in range(800):
        time = k * step
        if time in commands:
            bench.update(time, *commands[time])
        fractions.append(bench.out("motion_progress", time)[2])
        busy.append(bench.out("robot_busy"))
    rate = np.diff(fractions) * duration / step
    assert np.all(rate >= -1e-9)
    assert np.max(np.abs(np.diff(rate))) <= step / stop_time + 1e-6
    assert rate[100] == pytest.approx(1)
    assert rate[300] == pytest.approx(0)
    assert rate[-1] == pytest.approx(1)
    assert busy[230] == 1  # still slowing down: the operator cannot resume yet
    assert busy[245] == 0
    assert bench.out("next_event_time") == pytest.approx(duration + 3.0)
    assert bench.out("motion_done", bench.out("next_event_time")) == 2


def test_a_hold_says_when_the_arm_is_at_rest(chair, episode):
    bench = Bench(RobotAction(chair.task, LineMotions(), stop_time=0.4), episode)
    bench.dut.GetInputPort("position_measured").FixValue(bench.context, np.zeros(7))
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    bench.update(2.0, ActionKind.HOLD, 0, 1)
    assert bench.out("next_event_time") == pytest.approx(2.4)
    assert bench.out("next_event_time", 2.4) == np.inf


def test_a_motion_that_ends_while_it_slows_down_is_done(chair, episode):
    bench = Bench(RobotAction(chair.task, LineMotions(), stop_time=0.4), episode)
    bench.dut.GetInputPort("position_measured").FixValue(bench.context, np.full(7, 0.11))
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    end = bench.out("next_event_time")
    bench.update(end - 0.1, ActionKind.HOLD, 0, 1)
    late = bench.out("next_event_time")
    assert end < late < end + 0.1
    assert bench.out("motion_done", late - 1e-6) == 0
    assert bench.out("motion_done", late) == 1
    bench.update(late, ActionKind.HOLD, 0, 1)
    bench.update(late + 1, ActionKind.ROBOT_TASK, 1, 2)  # the same task again is a new motion
    assert bench.out("motion_progress")[2] == 0


def test_a_hold_while_speeding_up_again_slows_down_from_there(chair, episode):
    bench = Bench(RobotAction(chair.task, LineMotions(), stop_time=0.4), episode)
    bench.dut.GetInputPort("position_measured").FixValue(bench.context, np.zeros(7))
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    bench.update(2.0, ActionKind.HOLD, 0, 1)
    bench.update(3.0, ActionKind.ROBOT_TASK, 1, 2)
    bench.update(3.1, ActionKind.HOLD, 0, 2)  # at a quarter of the rate
    assert bench.out("next_event_time") == pytest.approx(3.2)
    duration = episode.robot[0, 0]
    path = 2.0 + 0.2 + 2 * 0.25 * 0.1 / 2
    assert bench.out("motion_progress", 9.0)[2] == pytest.approx(path / duration)


# ---- a rate led from outside


class PacedBench(Bench):
    """Looks at ``speed_scale`` every 10 ms, as the Simulator does."""

    def __init__(self, task, episode, motions=None):
        pacing = Pacing(period=0.01, look_ahead=0.2)
        super().__init__(RobotAction(task, motions or LineMotions(), stop_time=0.4, pacing=pacing), episode)
        self.dut.GetInputPort("position_measured").FixValue(self.context, np.full(7, 0.11))
        self.scale(1.0)

    def scale(self, value):
        self.dut.GetInputPort("speed_scale").FixValue(self.context, [value])

    def look(self, time):
        self.context.SetTime(time)
        self.context.SetDiscreteState(self.dut.EvalUniquePeriodicDiscreteUpdate(self.context))

    def state(self):
        return self.context.get_discrete_state_vector().value().copy()


@pytest.fixture(scope="module")
def paced(chair, episode):
    return PacedBench(chair.task, episode)


@pytest.fixture
def paced_bench(paced, episode):
    paced.context.SetTime(0.0)
    paced.dut.set_episode(paced.context, episode)
    paced.scale(1.0)
    return paced


def test_at_full_scale_looking_changes_nothing(paced_bench):
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    before = paced_bench.state()
    for k in range(1, 200):
        paced_bench.look(0.01 * k)
    assert np.array_equal(paced_bench.state(), before)


def test_the_rate_follows_the_scale_on_a_ramp_and_the_end_is_foretold(paced_bench, episode):
    duration = episode.robot[0, 0]
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    changes = {200: 0.5, 300: 0.0, 400: 0.25, 500: 1.0}
    fractions, rates, busy = [], [], []
    for k in range(1300):
        if k in changes:
            paced_bench.scale(changes[k])
        paced_bench.look(0.01 * k)
        fractions.append(paced_bench.out("motion_progress")[2])
        rates.append(paced_bench.out("path_rate"))
        busy.append(paced_bench.out("robot_busy"))
    measured = np.diff(fractions) * duration / 0.01
    moving = np.array(fractions[1:]) < 1
    np.testing.assert_allclose(measured[moving], (np.array(rates)[1:] + np.array(rates)[:-1])[moving] / 2, atol=0.02)
    assert np.max(np.abs(np.diff(rates[:800]))) <= 0.01 / 0.4 + 1e-9
    for k, rate in ((199, 1.0), (290, 0.5), (390, 0.0), (490, 0.25), (590, 1.0)):
        assert rates[k] == pytest.approx(rate)
    assert busy[390] == 0
    assert busy[490] == 1
    # Path time lost: each ramp takes 0.4 s per unit, and the rates in between.
    passed = np.interp(duration, np.cumsum(np.array(rates)) * 0.01, np.arange(1300) * 0.01)
    assert paced_bench.out("next_event_time") >= passed - 0.02
    assert paced_bench.out("motion_done") == 1


def test_the_end_at_half_rate_is_exact(paced_bench, episode):
    duration = episode.robot[0, 0]
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    paced_bench.scale(0.5)
    paced_bench.look(2.0)
    in_ramp = 0.75 * 0.2
    assert paced_bench.out("next_event_time") == pytest.approx(2.2 + (duration - 2.0 - in_ramp) / 0.5)
    assert paced_bench.out("motion_done", paced_bench.out("next_event_time")) == 1


def test_a_hold_keeps_the_arm_whatever_the_scale_and_goes_on_at_it(paced_bench):
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    paced_bench.scale(0.5)
    paced_bench.look(1.0)
    paced_bench.update(2.0, ActionKind.HOLD, 0, 1)
    for time, scale in ((2.1, 1.0), (3.0, 0.7)):
        paced_bench.scale(scale)
        paced_bench.look(time)
    assert paced_bench.out("path_rate", 4.0) == 0
    paced_bench.update(5.0, ActionKind.ROBOT_TASK, 1, 2)
    assert paced_bench.out("path_rate", 5.0) == 0
    assert paced_bench.out("path_rate", 6.0) == pytest.approx(0.7)


def test_a_stop_right_at_the_start_is_at_once(paced_bench):
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    paced_bench.scale(0.0)
    paced_bench.look(0.01)
    assert paced_bench.out("path_rate") == 0
    paced_bench.update(1.0, ActionKind.ROBOT_TASK, 2, 2)
    assert paced_bench.out("path_rate") == 0  # a new motion waits, too
    assert paced_bench.out("next_event_time") == np.inf


def test_the_path_ahead_is_that_of_the_motion(paced_bench, episode):
    duration = episode.robot[0, 0]
    assert not np.any(paced_bench.out("path_velocity"))
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    paced_bench.scale(0.5)
    paced_bench.look(1.0)
    ahead = (paced_bench.out("motion_progress", 2.0)[2] * duration + np.linspace(0, 0.2, NUM_POSTURES)) / duration
    position = paced_bench.out("path_position").reshape(NUM_POSTURES, 7)
    np.testing.assert_allclose(position, 0.11 * np.outer(ahead, np.ones(7)))
    np.testing.assert_allclose(paced_bench.out("path_velocity"), 0.11 / duration)  # at rate 1, whatever the rate


def test_the_path_is_the_same_at_any_rate(paced_bench):
    """Every commanded position lies on the motion, and none is skipped."""
    paced_bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    rng, positions = np.random.default_rng(0), []
    for k in range(4000):
        paced_bench.scale(float(rng.choice([0.0, 0.3, 1.0])))
        paced_bench.look(0.01 * k)
        fraction = paced_bench.out("motion_progress")[2]
        positions.append(paced_bench.out("position").copy())
        assert np.array_equal(positions[-1], LineMotions().position(ActionKind.ROBOT_TASK, 1, fraction))
    steps = np.diff(np.array(positions)[:, 0])
    assert np.all(steps >= 0)
    assert np.max(steps) <= 0.11 / 5.5 * 0.01 * 1.01
    assert positions[-1][0] == pytest.approx(0.11)
