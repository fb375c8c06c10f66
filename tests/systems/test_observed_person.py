"""ObservedPerson: joint actions are over when the robot's part in them is, whatever happens to its commands."""

import pytest

from pace_drake.systems.observed_person import ObservedPerson
from pace_drake.task import ActionKind
from tests.systems.forced import force_update


class Bench:
    def __init__(self):
        self.dut = ObservedPerson()
        self.context = self.dut.CreateDefaultContext()
        self.see(ActionKind.NONE, 0, 0, done=0)

    def see(self, kind, index, sequence, *, done, ready=0, at=0):
        for name, value in (
            ("robot_action", [kind, index, sequence]),
            ("motion_done", [done]),
            ("joint_ready", [ready]),
            ("human_joint", [at]),
        ):
            self.dut.GetInputPort(name).FixValue(self.context, [float(v) for v in value])
        force_update(self.dut, self.context)
        return self["joints_done"]

    def __getitem__(self, output):
        return self.dut.GetOutputPort(output).Eval(self.context)[0]


@pytest.fixture
def dut():
    return Bench()


def test_counts_joint_motions_that_are_done(dut):
    assert dut.see(ActionKind.PREPARE, 1, 4, done=4) == 0
    assert dut.see(ActionKind.JOINT, 1, 5, done=4) == 0
    assert dut.see(ActionKind.JOINT, 1, 5, done=5) == 1
    assert dut.see(ActionKind.JOINT, 1, 5, done=5) == 1
    assert dut.see(ActionKind.HOME, 1, 6, done=6) == 1
    assert dut.see(ActionKind.ROBOT_TASK, 2, 7, done=7) == 1
    assert dut.see(ActionKind.JOINT, 2, 8, done=8) == 2


def test_an_assistance_that_was_aborted_finishes_nothing(dut):
    assert dut.see(ActionKind.PREPARE, 1, 1, done=1) == 0
    assert dut.see(ActionKind.HOME_ABORTED, 1, 2, done=2) == 0


def test_a_command_that_is_issued_again_finishes_as_well(dut):
    assert dut.see(ActionKind.JOINT, 1, 5, done=4) == 0
    assert dut.see(ActionKind.HOLD, 0, 5, done=4) == 0
    assert dut.see(ActionKind.JOINT, 1, 6, done=4) == 0
    assert dut.see(ActionKind.JOINT, 1, 6, done=6) == 1


def test_a_motion_that_ends_as_it_is_held_finishes_when_the_robot_goes_on(dut):
    assert dut.see(ActionKind.JOINT, 1, 5, done=4) == 0
    assert dut.see(ActionKind.HOLD, 0, 5, done=5) == 0
    assert dut.see(ActionKind.JOINT, 1, 5, done=5) == 1


def test_waits_at_a_joint_action_until_the_robot_is_in_it(dut):
    dut.see(ActionKind.ROBOT_TASK, 1, 1, done=0, at=0)
    assert dut["human_waiting"] == 0
    dut.see(ActionKind.PREPARE, 1, 2, done=1, at=1)
    assert dut["human_waiting"] == 1
    dut.see(ActionKind.JOINT, 1, 3, done=2, ready=1, at=1)
    assert dut["human_waiting"] == 0
    dut.see(ActionKind.HOLD, 0, 3, done=2, ready=0, at=1)
    assert dut["human_waiting"] == 1


def test_does_not_wait_at_a_joint_action_that_is_over(dut):
    # After the last one the ActionMonitor stays at it.
    dut.see(ActionKind.JOINT, 2, 3, done=3, ready=2, at=2)
    dut.see(ActionKind.HOME, 2, 4, done=3, ready=0, at=2)
    assert dut["human_waiting"] == 0


def test_an_episode_begins_with_none_done(dut):
    dut.see(ActionKind.JOINT, 1, 5, done=5)
    dut.dut.set_episode(dut.context, None)
    assert dut["joints_done"] == 0
