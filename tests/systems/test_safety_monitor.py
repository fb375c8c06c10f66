"""SafetyMonitor: what slows, what stops, what latches, and who releases it."""

import numpy as np
import pytest

from pace_drake.safety.config import SafetyConfig
from pace_drake.stations.arm_capsules import load_arm_capsules
from pace_drake.stations.workcell import Workcell
from pace_drake.systems.robot_action import NUM_POSTURES
from pace_drake.systems.safety_monitor import SafetyMonitor
from pace_drake.task import ActionKind

HOME = np.array(Workcell().home)
TCP = np.array([0.307, 0.0, 0.487])  # at home
FAR, AHEAD, TOUCHING = np.array([1.5, 0.0, 0.5]), TCP + np.array([0.25, 0.0, 0.0]), TCP + np.array([0.07, 0.0, 0.0])
FORWARDS = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # [rad/s] the second joint moves the gripper towards +x


@pytest.fixture(scope="module")
def dut():
    return SafetyMonitor(SafetyConfig(), load_arm_capsules())


class Bench:
    def __init__(self, dut):
        self.dut = dut
        self.context = dut.CreateDefaultContext()
        self.set(p_WH=FAR, position_measured=HOME, path_position=np.tile(HOME, NUM_POSTURES))
        self.moves(FORWARDS)

    def set(self, **values):
        for name, value in values.items():
            self.dut.GetInputPort(name).FixValue(self.context, value)

    def moves(self, velocity, kind=ActionKind.ROBOT_TASK):
        self.set(path_velocity=np.tile(velocity, NUM_POSTURES), motion_progress=[float(kind), 1.0, 0.5])

    def out(self, name):
        return self.dut.GetOutputPort(name).Eval(self.context)[0]

    def look(self):
        """The periodic update."""
        values = self.dut.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.SetDiscreteState(values)


@pytest.fixture
def bench(dut):
    return Bench(dut)


def test_a_hand_slows_stops_and_lets_go_on_without_a_latch(bench):
    assert bench.out("speed_scale") == 1.0
    scales = []
    for distance in (0.6, 0.35, 0.2, 0.15, 0.12, 0.09):
        bench.set(p_WH=TCP + np.array([distance, 0.0, 0.0]))
        bench.look()
        scales.append(bench.out("speed_scale"))
    assert scales == sorted(scales, reverse=True)
    assert 0 < scales[3] < 1
    assert scales[-1] == 0
    assert bench.out("stop") == 0
    bench.set(p_WH=FAR)
    assert bench.out("speed_scale") == 1.0


def test_moving_away_is_allowed_and_a_joint_action_may_touch(bench):
    bench.set(p_WH=TOUCHING)
    assert bench.out("speed_scale") == 0
    bench.moves(-FORWARDS, ActionKind.HOME)
    assert bench.out("speed_scale") > 0.3
    bench.moves(0.5 * FORWARDS, ActionKind.JOINT)
    assert bench.out("speed_scale") == 1.0
    bench.moves(4 * FORWARDS, ActionKind.JOINT)
    assert 0 < bench.out("speed_scale") < 1
    bench.moves(0 * FORWARDS)
    assert bench.out("speed_scale") == 1.0  # it stands still


def test_distance_and_speeds_are_those_of_the_nearest_part(bench):
    bench.set(p_WH=AHEAD)
    assert 0.1 < bench.out("hand_distance") < 0.25
    assert bench.out("closing_speed") == pytest.approx(0.15, abs=0.15)
    bench.set(p_WH=TCP)
    assert bench.out("hand_distance") < 0
    assert bench.out("allowed_speed") == 0


@pytest.mark.parametrize(
    ("cause", "gone"),
    [
        ({"hand_age": 0.21}, {"hand_age": 0.05}),
        ({"hand_age": np.nan}, {"hand_age": 0.0}),
        ({"p_WH": [np.nan, 0.0, 0.5]}, {"p_WH": FAR}),
        ({"position_measured": np.full(7, np.nan)}, {"position_measured": HOME}),
    ],
)
def test_what_is_not_seen_latches_until_the_operator_acknowledges(bench, cause, gone):
    bench.set(ack=0.0)
    bench.look()
    bench.set(**cause)
    assert (bench.out("stop"), bench.out("speed_scale")) == (1, 0)  # at once
    bench.look()
    bench.set(ack=1.0)
    bench.look()
    bench.set(**gone)
    bench.look()
    assert (bench.out("stop"), bench.out("speed_scale")) == (1, 0)  # acknowledged too early
    bench.set(ack=0.0)
    bench.look()
    assert bench.out("stop") == 1
    bench.set(ack=1.0)
    bench.look()
    assert (bench.out("stop"), bench.out("speed_scale")) == (0, 1)
    bench.set(**cause)
    bench.look()
    bench.set(**gone)
    bench.look()
    assert bench.out("stop") == 1  # an acknowledgement that stays is none


def test_the_operators_stop_passes_through_and_does_not_latch(bench):
    bench.set(stop=1.0)
    bench.look()
    assert bench.out("stop") == 1
    bench.set(stop=0.0)
    assert bench.out("stop") == 0
