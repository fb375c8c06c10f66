"""RobotAction: one motion per sequence number; HOLD freezes, a new number of the same command goes on."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.systems.robot_action import MAX_COMPONENT_AGE, NUM_POSTURES, LetGo, Pacing, RobotAction
from pace_drake.task import ActionKind, sample_episode
from tests.systems.forced import force_update


@dataclass(frozen=True)
class LineHandOver:
    """Held out from half of the motion on; opens in 0.6 s."""

    offered: float = 0.5
    p_WH: np.ndarray = field(default_factory=lambda: np.array([0.7, 0.1, 0.4]))
    reach: float = 0.05
    speed: float = 0.1
    width: float = 0.06


@dataclass(frozen=True)
class LineMotion:
    """A straight joint motion."""

    end: np.ndarray
    duration: float
    hand_over: LineHandOver | None

    def position(self, fraction):
        return self.end * min(max(fraction, 0.0), 1.0)

    def path_positions(self, fractions):
        return np.outer(np.clip(fractions, 0.0, 1.0), self.end)

    def path_velocities(self, fractions):
        inside = (fractions >= 0) & (fractions <= 1)
        return np.outer(inside, self.end / self.duration)

    def gripper_width(self, fraction):
        return 0.024 if self.hand_over else 0.04 * (1 - fraction)


class LineMotions:
    """Each (kind, index) ends somewhere else; what fetches component 0 or 1, also by where that lies."""

    home = np.zeros(7)

    def component(self, kind, index):
        return {ActionKind.ROBOT_TASK: 0, ActionKind.PREPARE: 1}.get(kind)

    def motion(self, kind, index, located=None):
        end = np.full(7, 0.1 * int(kind) + 0.01 * index)
        if located is not None and self.component(kind, index) is not None:
            end[:3] += located
        hand_over = LineHandOver() if kind == ActionKind.JOINT and index > 1 else None
        return LineMotion(end, 9.0 if kind == ActionKind.PREPARE else 1.0, hand_over)


AT_ORIGIN = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


class Bench:
    def __init__(self, dut, episode):
        self.dut = dut
        self.context = dut.CreateDefaultContext()
        dut.set_episode(self.context, episode)
        if dut.HasInputPort("component_poses"):
            self.put(component_poses=2 * AT_ORIGIN, component_ages=[0.0, 0.0], p_WH=[2.0, 0.0, 0.0])

    def put(self, **inputs):
        for name, value in inputs.items():
            self.dut.GetInputPort(name).FixValue(self.context, value)

    def look(self, time):
        """The periodic updates, as the Simulator does them."""
        self.context.SetTime(time)
        self.context.SetDiscreteState(self.dut.EvalUniquePeriodicDiscreteUpdate(self.context))

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
    bench = Bench(RobotAction(chair.task, LineMotions(), 2), episode)
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
    bench = Bench(RobotAction(chair.task, LineMotions(), 2, stop_time=stop_time), episode)
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
    bench = Bench(RobotAction(chair.task, LineMotions(), 2, stop_time=0.4), episode)
    bench.dut.GetInputPort("position_measured").FixValue(bench.context, np.zeros(7))
    bench.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    bench.update(2.0, ActionKind.HOLD, 0, 1)
    assert bench.out("next_event_time") == pytest.approx(2.4)
    assert bench.out("next_event_time", 2.4) == np.inf


def test_a_motion_that_ends_while_it_slows_down_is_done(chair, episode):
    bench = Bench(RobotAction(chair.task, LineMotions(), 2, stop_time=0.4), episode)
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
    bench = Bench(RobotAction(chair.task, LineMotions(), 2, stop_time=0.4), episode)
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

    def __init__(self, task, episode, let_go=None):
        pacing = Pacing(period=0.01, look_ahead=0.2)
        super().__init__(RobotAction(task, LineMotions(), 2, stop_time=0.4, pacing=pacing, let_go=let_go), episode)
        self.dut.GetInputPort("position_measured").FixValue(self.context, np.full(7, 0.11))
        self.scale(1.0)

    def scale(self, value):
        self.dut.GetInputPort("speed_scale").FixValue(self.context, [value])

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
    motion = LineMotions().motion(ActionKind.ROBOT_TASK, 1)
    rng, positions = np.random.default_rng(0), []
    for k in range(4000):
        paced_bench.scale(float(rng.choice([0.0, 0.3, 1.0])))
        paced_bench.look(0.01 * k)
        fraction = paced_bench.out("motion_progress")[2]
        positions.append(paced_bench.out("position").copy())
        assert np.array_equal(positions[-1], motion.position(fraction))
    steps = np.diff(np.array(positions)[:, 0])
    assert np.all(steps >= 0)
    assert np.max(steps) <= 0.11 / 5.5 * 0.01 * 1.01
    assert positions[-1][0] == pytest.approx(0.11)


# ---- what is fetched, and where it lies


@pytest.fixture(scope="module")
def plain(chair):
    return RobotAction(chair.task, LineMotions(), 2)


@pytest.fixture
def fetching(plain, episode):
    bench = Bench(plain, episode)
    bench.put(position_measured=np.zeros(7))
    return bench


def lying(*located):
    """Poses of components that lie at x, y, yaw."""
    X_WO = [RigidTransform(RollPitchYaw(0.0, 0.0, yaw), [x, y, 0.02]) for x, y, yaw in located]
    return np.concatenate([np.append(X.rotation().ToQuaternion().wxyz(), X.translation()) for X in X_WO])


@pytest.mark.parametrize(("kind", "number"), [(ActionKind.ROBOT_TASK, 0), (ActionKind.PREPARE, 1)])
def test_a_motion_that_fetches_begins_when_its_component_has_just_been_seen(fetching, kind, number):
    ages = np.zeros(2)
    ages[number] = MAX_COMPONENT_AGE + 1e-6
    fetching.put(component_ages=ages)
    fetching.update(1.0, kind, 1, 1)
    assert fetching.out("next_event_time") == np.inf
    assert fetching.out("robot_busy") == 0
    np.testing.assert_array_equal(fetching.out("position", 3.0), LineMotions.home)
    ages[:] = np.inf
    ages[number] = MAX_COMPONENT_AGE  # the age of the other does not matter
    fetching.put(component_ages=ages)
    fetching.update(3.0, kind, 1, 1)
    assert fetching.out("robot_busy") == 1
    assert fetching.out("motion_progress", 3.0)[2] == 0
    assert fetching.out("motion_progress", 4.0)[2] > 0


def test_what_fetches_nothing_begins_whatever_is_seen(fetching):
    fetching.put(component_ages=[np.inf, np.inf])
    fetching.update(1.0, ActionKind.HOME, 1, 1)
    assert fetching.out("robot_busy") == 1


def test_a_motion_leads_to_where_its_component_was_when_it_began(fetching):
    fetching.put(component_poses=lying((0.3, -0.5, 0.2), (0.4, 0.6, -2.8)))
    for sequence, (kind, located) in enumerate(
        ((ActionKind.ROBOT_TASK, [0.3, -0.5, 0.2]), (ActionKind.PREPARE, [0.4, 0.6, -2.8])), start=1
    ):
        begin = 50.0 * sequence
        fetching.update(begin, kind, 1, sequence)
        end = LineMotions().motion(kind, 1, np.array(located)).end
        np.testing.assert_allclose(fetching.out("position", begin + 40.0), end, atol=1e-12)
        fetching.put(component_poses=lying((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), component_ages=[9.0, 9.0])
        fetching.look(begin + 40.0)
        np.testing.assert_allclose(fetching.out("position"), end, atol=1e-12)
        fetching.put(position_measured=end)
        assert fetching.out("motion_done") == sequence
        fetching.put(component_poses=lying((0.3, -0.5, 0.2), (0.4, 0.6, -2.8)), component_ages=[0.0, 0.0])


def test_the_yaw_is_found_whatever_the_length_of_the_quaternion(fetching):
    """The plant's time stepping does not keep it at 1."""
    poses = lying((0.3, -0.5, 1.2), (0.0, 0.0, 0.0))
    poses[:4] *= 1.2
    fetching.put(component_poses=poses)
    fetching.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    end = LineMotions().motion(ActionKind.ROBOT_TASK, 1, np.array([0.3, -0.5, 1.2])).end
    np.testing.assert_allclose(fetching.out("position", 60.0), end, atol=1e-12)


def test_a_motion_goes_on_after_a_hold_whatever_is_seen(fetching):
    fetching.put(component_poses=lying((0.3, -0.5, 0.2), (0.0, 0.0, 0.0)))
    fetching.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    fetching.update(2.0, ActionKind.HOLD, 0, 1)
    fetching.put(component_poses=lying((0.1, -0.1, 0.0), (0.0, 0.0, 0.0)), component_ages=[9.0, 9.0])
    fetching.update(5.0, ActionKind.ROBOT_TASK, 1, 2)
    assert fetching.out("robot_busy", 6.0) == 1
    end = LineMotions().motion(ActionKind.ROBOT_TASK, 1, np.array([0.3, -0.5, 0.2])).end
    np.testing.assert_allclose(fetching.out("position", 60.0), end, atol=1e-12)


def test_what_an_update_would_begin(fetching):
    def begins(kind, index, sequence, time):
        fetching.context.SetTime(time)
        fetching.put(robot_action=[float(kind), index, sequence])
        return fetching.dut.begins(fetching.context)

    assert begins(ActionKind.NONE, 0, 0, 0.0) is None
    assert begins(ActionKind.ROBOT_TASK, 2, 1, 0.0) == (ActionKind.ROBOT_TASK, 2, 1)
    fetching.update(0.0, ActionKind.ROBOT_TASK, 2, 1)
    assert begins(ActionKind.ROBOT_TASK, 2, 1, 1.0) is None  # has begun
    assert begins(ActionKind.HOLD, 0, 1, 1.0) is None
    fetching.update(2.0, ActionKind.HOLD, 0, 1)
    assert begins(ActionKind.ROBOT_TASK, 2, 2, 3.0) is None  # goes on
    assert begins(ActionKind.PREPARE, 1, 2, 3.0) == (ActionKind.PREPARE, 1, 2)
    fetching.update(3.0, ActionKind.ROBOT_TASK, 2, 2)
    fetching.put(position_measured=LineMotions().motion(ActionKind.ROBOT_TASK, 2).end)
    assert begins(ActionKind.ROBOT_TASK, 2, 3, 60.0) == (ActionKind.ROBOT_TASK, 2, 3)  # it is over: the same anew


# ---- what is held out

CLOSED = 0.024


@pytest.fixture
def offering(fetching, episode):
    """JOINT 2 begins at time 0."""
    fetching.update(0.0, ActionKind.JOINT, 2, 1)
    fetching.put(position_measured=LineMotions().motion(ActionKind.JOINT, 2).end)
    return fetching


@pytest.fixture
def duration(episode):
    """[s] of JOINT 2."""
    return episode.human[3]


THERE = LineHandOver().p_WH
REACHED = np.add(THERE, [0.0, 0.0, 0.0499])


def test_the_gripper_lets_go_when_the_hand_has_it_and_only_then_it_is_done(offering, duration):
    offering.put(p_WH=np.add(THERE, [0.0, 0.0, 0.0501]))
    for time in (0.6 * duration, duration, duration + 5.0):
        offering.look(time)
        assert offering.out("gripper_position") == CLOSED
        assert offering.out("motion_done") == 0
        assert offering.out("robot_busy") == 1
    assert offering.out("next_event_time") == pytest.approx(duration + 5.01)  # it is asked again
    offering.put(p_WH=REACHED)
    assert offering.out("gripper_position") == CLOSED  # until the hand is looked at
    offering.look(duration + 6.0)
    offering.put(p_WH=[2.0, 0.0, 0.0])  # gone again: it is let go all the same
    for passed, width in ((0.0, CLOSED), (0.3, 0.03), (0.5, 0.05), (0.6001, 0.06), (5.0, 0.06)):
        offering.look(duration + 6.0 + passed)
        assert offering.out("gripper_position") == pytest.approx(width)
        assert offering.out("motion_done") == (passed > 0.6)


def test_nothing_is_let_go_before_it_is_held_out(offering, duration):
    offering.put(p_WH=REACHED)
    offering.look(0.499 * duration)
    assert offering.out("gripper_position", 0.499 * duration + 1.0) == CLOSED
    offering.look(0.501 * duration)
    offering.look(0.501 * duration + 0.3)  # the hand is still there: it does not begin again
    assert offering.out("gripper_position", 0.501 * duration + 0.5) == pytest.approx(0.05)
    # Opened long before the end of its time: done at the end.
    assert offering.out("motion_done", duration - 1e-6) == 0
    assert offering.out("motion_done", duration) == 1


def test_nothing_is_let_go_while_the_robot_is_held(offering, duration):
    offering.update(0.7 * duration, ActionKind.HOLD, 0, 1)
    offering.put(p_WH=REACHED)
    offering.look(0.7 * duration + 2.0)
    assert offering.out("gripper_position", 0.7 * duration + 4.0) == CLOSED
    offering.update(0.7 * duration + 4.0, ActionKind.JOINT, 2, 2)
    offering.look(0.7 * duration + 4.0)
    assert offering.out("gripper_position", 0.7 * duration + 4.5) == pytest.approx(0.05)


def test_what_was_let_go_stays_let_go_over_a_hold(offering, duration):
    offering.put(p_WH=REACHED)
    offering.look(0.6 * duration)
    offering.update(0.7 * duration, ActionKind.HOLD, 0, 1)
    offering.update(0.7 * duration + 3.0, ActionKind.JOINT, 2, 2)
    assert offering.out("gripper_position") == pytest.approx(0.06)


def test_the_next_motion_holds_on_again(offering, duration):
    offering.put(p_WH=REACHED)
    offering.look(duration)
    end = duration + 1.0
    assert offering.out("motion_done", end) == 1
    offering.put(p_WH=[2.0, 0.0, 0.0])
    offering.update(end, ActionKind.JOINT, 2, 2)
    offering.look(end + duration + 1.0)
    assert offering.out("gripper_position") == CLOSED
    assert offering.out("motion_done") == 1


def test_where_nothing_is_held_out_the_clock_opens_the_gripper(fetching):
    fetching.update(0.0, ActionKind.JOINT, 1, 1)
    fetching.put(p_WH=REACHED, position_measured=LineMotions().motion(ActionKind.JOINT, 1).end)
    fetching.look(50.0)
    assert fetching.out("gripper_position") == 0.0
    assert fetching.out("motion_done") == 1


# ---- what was lost from the gripper is fetched anew


class LosingBench(PacedBench):
    """Sorts, and is told that it has lost what it fetched."""

    def __init__(self, task, episode):
        super().__init__(task, episode, LetGo(speed=0.1, width=0.052))
        self.put(position_measured=np.zeros(7), num_lost=0.0)

    def lose(self, time, kind=ActionKind.ROBOT_TASK):
        """The chart faults, and issues the command again when the arm is at rest."""
        self.context.SetTime(time)
        self.put(num_lost=self.dut.GetInputPort("num_lost").Eval(self.context)[0] + 1)
        self.update(time, ActionKind.HOLD, 0, 1)
        self.update(time + 1.0, kind, 1, 2)


@pytest.fixture(scope="module")
def with_let_go(chair, episode):
    return LosingBench(chair.task, episode)


@pytest.fixture
def losing(with_let_go, episode):
    with_let_go.context.SetTime(0.0)
    with_let_go.dut.SetDefaultContext(with_let_go.context)
    with_let_go.dut.set_episode(with_let_go.context, episode)
    with_let_go.put(position_measured=np.zeros(7), speed_scale=1.0, num_lost=0.0)
    with_let_go.put(component_poses=2 * AT_ORIGIN, component_ages=[0.0, 0.0])
    return with_let_go


def test_what_was_lost_is_fetched_anew_from_where_the_motion_began(losing, episode):
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    losing.lose(3.0)
    back = losing.out("motion_progress")[2] * episode.robot[0, 0]
    assert 3.0 < back < 3.3  # it has come to rest
    end = losing.out("next_event_time")
    assert end == pytest.approx(4.0 + back + 0.2)  # the same way, but that it starts on a ramp
    times = np.arange(4.0, end, 0.01)
    fractions = np.array([losing.out("motion_progress", time)[2] for time in times])
    assert np.all(np.diff(fractions) < 0.0)
    assert np.max(-np.diff(fractions)) * episode.robot[0, 0] < 0.01 + 1e-9
    np.testing.assert_allclose(losing.out("position"), fractions[-1] * 0.11)
    losing.put(component_poses=lying((0.3, -0.5, 0.2), (0.0, 0.0, 0.0)))
    losing.update(end - 0.01, ActionKind.ROBOT_TASK, 1, 2)
    assert losing.out("motion_progress")[2] > 0.0
    losing.update(end, ActionKind.ROBOT_TASK, 1, 2)
    assert losing.out("motion_progress")[2] == 0.0
    again = end + episode.robot[1, 0]  # the time drawn for the new command
    assert losing.out("next_event_time") == again
    reached = LineMotions().motion(ActionKind.ROBOT_TASK, 1, np.array([0.3, -0.5, 0.2])).end
    np.testing.assert_allclose(losing.out("position", again), reached)
    losing.put(position_measured=reached)
    assert losing.out("motion_done") == 2


def test_the_gripper_opens_on_the_way_back_and_as_the_motion_has_it_where_that_is_wider(losing, episode):
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    losing.lose(5.0)
    planned = 0.04 * (1 - losing.out("motion_progress")[2])
    assert losing.out("gripper_position") == pytest.approx(planned)
    for since in (0.3, 0.4, 0.52, 3.0):
        width = losing.out("gripper_position", 6.0 + since)
        assert width == pytest.approx(max(min(0.1 * since, 0.052), 0.04 * (1 - losing.out("motion_progress")[2])))
    losing.update(losing.out("next_event_time"), ActionKind.ROBOT_TASK, 1, 2)
    assert losing.out("gripper_position") == pytest.approx(0.04)


def test_a_motion_that_has_lost_what_it_fetches_is_not_done(losing, episode):
    losing.put(position_measured=np.full(7, 0.11))
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    end = losing.out("next_event_time")
    assert losing.out("motion_done", end) == 1
    losing.put(num_lost=1.0)
    assert losing.out("motion_done") == 0


def test_what_fetches_nothing_goes_on_without_it(losing, episode):
    losing.update(0.0, ActionKind.JOINT, 1, 1)
    losing.lose(2.0, ActionKind.JOINT)
    fraction = losing.out("motion_progress")[2]
    assert losing.out("motion_progress", 5.0)[2] > fraction
    losing.put(position_measured=np.full(7, 0.31))
    assert losing.out("motion_done", losing.out("next_event_time")) == 2


def test_a_stop_without_a_loss_goes_on_and_so_does_one_after_it_was_fetched_anew(losing):
    losing.put(num_lost=3.0)
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    losing.update(2.0, ActionKind.HOLD, 0, 1)
    losing.update(3.0, ActionKind.ROBOT_TASK, 1, 2)
    assert losing.out("motion_progress", 4.0)[2] > losing.out("motion_progress", 3.0)[2]


def test_a_hold_on_the_way_back_freezes_and_it_goes_on_back(losing, episode):
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    losing.lose(3.0)
    before = losing.out("motion_progress", 5.0)[2]
    losing.update(5.0, ActionKind.HOLD, 0, 2)
    held = losing.out("motion_progress", 6.0)[2]
    assert held == pytest.approx(before - 0.2 / episode.robot[0, 0])  # on the way on which it slows down
    assert losing.out("motion_progress", 9.0)[2] == held
    assert losing.out("robot_busy") == 0
    losing.update(9.0, ActionKind.ROBOT_TASK, 1, 3)
    assert losing.out("motion_progress", 10.0)[2] < held
    end = losing.out("next_event_time")
    losing.update(end, ActionKind.ROBOT_TASK, 1, 3)
    assert losing.out("next_event_time") == end + episode.robot[2, 0]


def test_on_the_way_back_the_path_ahead_leads_back(losing, episode):
    duration = episode.robot[0, 0]
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    losing.lose(3.0)
    passed = losing.out("motion_progress", 5.0)[2] * duration
    ahead = (passed - np.linspace(0, 0.2, NUM_POSTURES)) / duration
    position = losing.out("path_position").reshape(NUM_POSTURES, 7)
    np.testing.assert_allclose(position, 0.11 * np.outer(ahead, np.ones(7)))
    np.testing.assert_allclose(losing.out("path_velocity"), -0.11 / duration)
    losing.put(speed_scale=0.5)
    losing.look(5.0)
    assert losing.out("path_rate", 6.0) == pytest.approx(0.5)
    slower = losing.out("motion_progress", 6.0)[2] - losing.out("motion_progress", 7.0)[2]
    assert slower * duration == pytest.approx(0.5)


def test_it_is_looked_for_anew_when_the_arm_is_back(losing):
    losing.update(0.0, ActionKind.ROBOT_TASK, 1, 1)
    assert losing.out("to_locate").tolist() == [ActionKind.ROBOT_TASK, 1, 1]
    losing.lose(3.0)
    assert losing.out("to_locate").tolist() == [ActionKind.NONE, 0, 0]
    end = losing.out("next_event_time")
    assert losing.out("to_locate", end).tolist() == [ActionKind.ROBOT_TASK, 1, 2.5]
    losing.put(component_ages=[2.0, 0.0])
    losing.update(end, ActionKind.ROBOT_TASK, 1, 2)
    np.testing.assert_allclose(losing.out("position", end + 1.0), LineMotions.home, atol=1e-12)  # not seen: it waits
    losing.put(component_ages=[0.0, 0.0])
    losing.update(end + 1.0, ActionKind.ROBOT_TASK, 1, 2)
    assert losing.out("to_locate").tolist() == [ActionKind.ROBOT_TASK, 1, 2]
    assert losing.out("motion_progress", end + 2.0)[2] > 0.0
