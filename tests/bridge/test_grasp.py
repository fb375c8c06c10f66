"""A gripper that closes on nothing, on hardware: its status says so (the peer is OURS)."""

from dataclasses import replace

import pytest

from pace_drake.evaluate.event_log import EventRecorder
from pace_drake.safety.command_gate import GateMode
from pace_drake.task import ActionKind
from tests.bridge.rig import ACKNOWLEDGE, STOP, Rig


@pytest.fixture
def empty(parts):
    """The robot sorts, and there is nothing between its fingers."""
    rig = Rig(*parts, policy="never_assist")
    rig.rows = []
    rig.present = False
    rig.begin(EventRecorder(lambda time, kind, **values: rig.rows.append((kind, values.get("name")))))
    return rig


def test_a_grasp_of_nothing_stops_the_arm_on_its_path_and_is_tried_anew(empty):
    rig = empty
    rig.run_until(lambda: rig.leaf == "FAULT").run(2.0)
    (told,) = [line for line in rig.lines if line.startswith(("fault", "stop:"))]
    assert told == next(f"fault: {name}" for kind, name in rig.rows if kind == "fault")
    assert told.startswith("fault: the gripper does not hold cube_")
    assert told.endswith("mm apart instead of 40; put it where it belongs, then acknowledge: it is fetched anew")
    assert rig.session.at_rest
    assert rig.session.gate_mode == GateMode.FOLLOWING  # braked on its path, which is held
    kind, index = rig.action()
    assert kind == ActionKind.ROBOT_TASK
    fraction = rig.fraction()
    rig.present = True
    rig.session.press(ACKNOWLEDGE)  # once is enough
    rig.run_until(lambda: rig.leaf == "ROBOT_TASK")
    rig.run_until(lambda: rig.fraction() < fraction - 0.05)
    rig.run(0.5)
    assert rig.peer.width > 0.05  # open again
    rig.run_until(lambda: rig.fraction() < 0.01)
    rig.run_until(lambda: rig.fraction() > fraction + 0.05, 30.0)
    assert rig.action() == (kind, index)
    rig.run_until(lambda: rig.action() != (kind, index), 30.0)
    assert len([line for line in rig.lines if line.startswith(("fault", "stop:"))]) == 1
    check = rig.check()
    assert check.kept, check
    assert check.tracking < 0.02


def test_another_grasp_of_nothing_is_told_again(empty):
    rig = empty
    for count in (1, 2):
        rig.run_until(lambda: rig.leaf == "FAULT", 60.0).run(1.0)
        assert len([line for line in rig.lines if line.startswith("fault")]) == count
        rig.session.press(ACKNOWLEDGE)
        rig.run(1.0)
    assert [kind for kind, _ in rig.rows].count("fault") == 2


def test_an_operators_stop_on_the_way_back_is_obeyed(empty):
    rig = empty
    rig.run_until(lambda: rig.leaf == "FAULT").run(1.0)
    rig.present = True
    rig.session.press(ACKNOWLEDGE)
    rig.run(2.0)
    fraction = rig.fraction()
    rig.session.press(STOP)
    rig.run(1.0)
    held = rig.fraction()
    assert rig.run(1.0).fraction() == held
    assert 0.0 < held < fraction
    rig.resume()
    rig.run_until(lambda: rig.fraction() < held - 0.02)
    rig.run_until(lambda: rig.fraction() > 0.5, 30.0)
    assert rig.check().kept


def test_without_a_gripper_that_reports_nothing_changes(parts):
    """As with `pace driver --hand none`."""
    rig = Rig(*parts, policy="never_assist")
    status = rig.scenario.lcm.hand_status_channel
    rig.network.tamper = lambda channel, data: [] if channel == status else [data]
    rig.begin()
    rig.run_until(lambda: rig.leaf == "ROBOT_TASK")
    rig.run_until(lambda: rig.fraction() > 0.9)
    assert [line for line in rig.lines if line.startswith(("fault", "stop:"))] == []


def test_the_check_can_be_switched_off(parts):
    scenario, people, motions = parts
    rig = Rig(
        replace(scenario, safety=replace(scenario.safety, grasp_check=False)), people, motions, policy="never_assist"
    )
    rig.present = False
    rig.begin()
    rig.run_until(lambda: rig.leaf == "ROBOT_TASK")
    rig.run_until(lambda: rig.fraction() > 0.9)
    assert rig.leaf == "ROBOT_TASK"
