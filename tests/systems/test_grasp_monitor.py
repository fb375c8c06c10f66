"""GraspMonitor: what the width between the fingers says of what they are meant to hold."""

from dataclasses import replace

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.safety.config import SafetyConfig
from pace_drake.scenario import load_scenario
from pace_drake.stations.workcell import Workcell
from pace_drake.systems.grasp_monitor import CONFIRMATION, GraspMonitor
from pace_drake.task import ActionKind

OPEN, CUBE, CLOSED = 0.06, 0.04, 0.024  # [m] widths of the gripper that is open, holds a cube, and is told to hold one


@pytest.fixture(scope="module")
def dut():
    return GraspMonitor(SafetyConfig(), Workcell(), max_age=0.5)


class Bench:
    """Looks every 10 ms."""

    def __init__(self, dut):
        self.dut = dut
        self.context = dut.CreateDefaultContext()
        self.put(ack=0.0, gripper_age=0.0)
        self.moves(ActionKind.ROBOT_TASK, 1, 0.4)
        self.gripper(OPEN, OPEN)

    def put(self, **values):
        for name, value in values.items():
            self.dut.GetInputPort(name).FixValue(self.context, value)

    def moves(self, kind, index, fraction):
        self.put(motion_progress=[float(kind), index, fraction])

    def gripper(self, commanded, measured):
        self.put(gripper_position=commanded, gripper_state=[measured, 0.0])

    def look(self, duration=0.01):
        for _ in range(round(duration / 0.01)):
            self.context.SetTime(self.context.get_time() + 0.01)
            self.context.SetDiscreteState(self.dut.EvalUniquePeriodicDiscreteUpdate(self.context))

    def acknowledge(self):
        self.put(ack=1.0)
        self.look()
        self.put(ack=0.0)
        self.look()

    def out(self, name):
        return self.dut.GetOutputPort(name).Eval(self.context)[0]

    @property
    def line(self):
        return self.dut.describe(self.context)


@pytest.fixture
def bench(dut):
    return Bench(dut)


@pytest.mark.parametrize("error", [0.0, -0.004, 0.004])
def test_what_is_held_is_no_fault_however_long(bench, error):
    bench.gripper(CLOSED, CUBE + error)
    bench.look(3.0)
    assert (bench.out("fault"), bench.out("num_lost"), bench.line) == (0, 0, "")


@pytest.mark.parametrize(
    ("kind", "index", "name", "width"),
    [
        (ActionKind.ROBOT_TASK, 2, "cube_2", 0.04),
        (ActionKind.ROBOT_TASK, 6, "cube_2", 0.04),  # cubes take turns
        (ActionKind.PREPARE, 1, "chair_side", 0.032),
        (ActionKind.PREPARE, 3, "allen_key_2", 0.024),
        (ActionKind.JOINT, 1, "chair_side", 0.032),
        (ActionKind.HOME_ABORTED, 2, "allen_key_1", 0.024),
    ],
)
def test_a_gripper_that_closes_on_nothing_is_a_fault(bench, kind, index, name, width):
    bench.moves(kind, index, 0.4)
    bench.gripper(width - 0.016, width)
    bench.look(0.5)
    assert bench.out("fault") == 0
    bench.gripper(width - 0.016, width - 0.006)
    bench.look(CONFIRMATION - 0.01)
    assert bench.out("fault") == 0
    bench.look(0.03)
    assert (bench.out("fault"), bench.out("num_lost")) == (1, 1)
    assert f"does not hold {name}: its fingers are {1e3 * (width - 0.006):.0f} mm apart instead of" in bench.line
    anew = kind in (ActionKind.ROBOT_TASK, ActionKind.PREPARE)
    assert bench.line.endswith("it is fetched anew" if anew else "the action goes on without it")


def test_it_is_silent_while_the_gripper_moves(bench):
    """The fingers are behind their command, as a real hand's are."""
    for k in range(100):
        commanded = max(OPEN - 0.001 * k, CLOSED)
        bench.gripper(commanded, max(OPEN - 0.001 * max(k - 40, 0), CUBE))
        bench.look()
    for k in range(60):
        bench.gripper(min(CLOSED + 0.001 * (k + 1), OPEN), CUBE - 0.01)
        bench.look()
    assert bench.out("num_lost") == 0


def test_fingers_that_do_not_close_are_a_fault_after_the_settle_time(bench):
    bench.gripper(CLOSED, OPEN)
    bench.look(0.99 + CONFIRMATION)
    assert bench.out("fault") == 0
    bench.look(0.03)
    assert bench.out("fault") == 1
    assert "60 mm apart instead of 40" in bench.line


def test_a_status_that_lies_is_not_believed(bench):
    bench.gripper(CLOSED, CUBE)
    for _ in range(20):
        bench.gripper(CLOSED, 0.0)
        bench.look(0.1)
        bench.gripper(CLOSED, CUBE)
        bench.look(0.1)
    assert bench.out("num_lost") == 0


@pytest.mark.parametrize("kind", [ActionKind.HOME, ActionKind.NONE])
def test_where_nothing_is_meant_to_be_held_any_width_will_do(bench, kind):
    bench.moves(kind, 1, 0.4)
    bench.gripper(0.0, 0.0)
    bench.look(2.0)
    assert bench.out("num_lost") == 0


def test_what_is_lost_on_the_way_is_said_once_until_the_gripper_opens(bench):
    bench.gripper(CLOSED, CUBE)
    bench.look(2.0)
    bench.gripper(CLOSED, CLOSED)
    bench.look(2.0)
    assert (bench.out("fault"), bench.out("num_lost")) == (1, 1)
    bench.acknowledge()
    bench.look(2.0)
    assert (bench.out("fault"), bench.out("num_lost"), bench.line) == (0, 1, "")
    bench.gripper(OPEN, OPEN)
    bench.look()
    bench.gripper(CLOSED, CLOSED)
    bench.look(0.2)
    assert (bench.out("fault"), bench.out("num_lost")) == (1, 2)


def test_an_acknowledgement_that_stays_on_releases_nothing(bench):
    bench.put(ack=1.0)
    bench.look()
    bench.gripper(CLOSED, CLOSED)
    bench.look(0.5)
    assert bench.out("fault") == 1


def test_what_cannot_be_fetched_anew_is_said_so(bench):
    bench.moves(ActionKind.PREPARE, 1, 1.0)
    bench.gripper(0.016, 0.016)
    bench.look(0.2)
    assert bench.line.endswith("see to it by hand, then acknowledge: the action goes on without it")


def test_a_width_that_is_too_old_is_not_judged(bench):
    """As where there is no gripper: zeros, infinitely old."""
    bench.put(gripper_age=np.inf)
    bench.gripper(CLOSED, 0.0)
    bench.look(3.0)
    assert bench.out("fault") == 0
    bench.put(gripper_age=0.4)
    bench.look(0.2)
    assert bench.out("fault") == 1


def test_a_fault_from_outside_passes_through(bench):
    bench.put(fault=1.0)
    assert (bench.out("fault"), bench.out("num_lost"), bench.line) == (1, 0, "")
    bench.put(fault=0.0)
    assert bench.out("fault") == 0


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("grasp_tolerance=0", r"safety\.grasp_tolerance: must be > 0 \[m\], is 0"),
        (
            "grasp_tolerance=0.016",
            r"safety\.grasp_tolerance: must be less than workcell\.gripper_squeeze, 0\.016 \[m\]",
        ),
        ("grasp_settle_time=-1", r"safety\.grasp_settle_time: must be > 0 \[s\], is -1"),
    ],
)
def test_settings_that_cannot_be_used_are_named(override, line):
    with pytest.raises(InputError, match=line):
        load_scenario("ikea_chair", (f"safety.{override}",))


def test_the_tolerance_is_the_settings(chair):
    bench = Bench(GraspMonitor(replace(chair.safety, grasp_tolerance=0.01), chair.workcell))
    bench.gripper(CLOSED, CUBE - 0.009)
    bench.look(2.0)
    assert bench.out("fault") == 0
    bench.gripper(CLOSED, CUBE - 0.011)
    bench.look(0.2)
    assert bench.out("fault") == 1
