import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_command
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from pace_drake.errors import InputError
from pace_drake.lcm.command_sender import GripperCommandSender, PandaCommandSender

WALL_CLOCK = 1_700_000_000.25  # [s]
Q0 = np.array([0.0, -0.4, 0.1, -2.2, 0.0, 1.8, 0.8])


class Bench:
    """A sender with fixed inputs, and the messages that it sent."""

    def __init__(self, dut: LeafSystem, lcm: DrakeLcm, channel: str) -> None:
        self.dut = dut
        self.lcm = lcm
        self.received: list[bytes] = []
        lcm.Subscribe(channel, self.received.append)

    def start(self, **inputs: object) -> Simulator:
        self.lcm.HandleSubscriptions(0)
        self.received.clear()
        simulator = Simulator(self.dut)
        self.fix(simulator, **inputs)
        return simulator

    def fix(self, simulator: Simulator, **inputs: object) -> None:
        for name, value in inputs.items():
            port = self.dut.GetInputPort(name)
            port.FixValue(simulator.get_mutable_context(), np.atleast_1d(np.asarray(value, dtype=float)))

    def sent(self) -> list[bytes]:
        self.received.clear()
        self.lcm.HandleSubscriptions(0)
        return list(self.received)


@pytest.fixture(scope="module")
def panda() -> Bench:
    lcm = DrakeLcm("memq://")
    dut = PandaCommandSender(
        lcm, channel="C", rate=100.0, status_timeout=0.05, start_tolerance=0.01, clock=lambda: WALL_CLOCK
    )
    return Bench(dut, lcm, "C")


@pytest.fixture(scope="module")
def gripper() -> Bench:
    lcm = DrakeLcm("memq://")
    dut = GripperCommandSender(lcm, channel="G", rate=10.0, status_timeout=0.5, force=20.0, clock=lambda: WALL_CLOCK)
    return Bench(dut, lcm, "G")


def ready(**other: object) -> dict[str, object]:
    return {
        "position": Q0,
        "position_measured": Q0,
        "status_age": 0.0,
        "robot_mode": lcmt_panda_status.kMove,
        **other,
    }


def test_command_is_what_the_driver_wants(panda: Bench) -> None:
    panda.start(**ready()).AdvanceTo(0.05)
    sent = panda.sent()
    assert len(sent) == 6
    for data in sent:
        command = lcmt_panda_command.decode(data)
        assert command.utime == 1_700_000_000_250_000
        assert command.control_mode_expected == lcmt_panda_status.CONTROL_MODE_POSITION == 1
        assert (command.num_joint_position, command.num_joint_velocity, command.num_joint_torque) == (7, 0, 0)
        np.testing.assert_array_equal(command.joint_position, Q0)


@pytest.mark.parametrize(
    "inputs",
    [
        {"status_age": np.inf},
        {"status_age": 0.051},
        {"status_age": np.nan},
        {"robot_mode": lcmt_panda_status.kOther},
        {"robot_mode": lcmt_panda_status.kReflex},
        {"robot_mode": lcmt_panda_status.kUserStopped},
    ],
)
def test_nothing_is_sent_unless_fresh_and_in_move(panda: Bench, inputs: dict[str, object]) -> None:
    panda.start(**ready(**inputs)).AdvanceTo(0.1)
    assert panda.sent() == []


def test_first_command_equals_measured_position(panda: Bench) -> None:
    commanded = Q0 + 0.009
    panda.start(**ready(position=commanded)).AdvanceTo(0.05)
    first, *later = (lcmt_panda_command.decode(data).joint_position for data in panda.sent())
    np.testing.assert_array_equal(first, Q0)
    assert len(later) == 5
    for position in later:
        np.testing.assert_array_equal(position, commanded)


@pytest.mark.parametrize("offset", [0.011, -0.5])
def test_wrong_start_is_refused_in_one_line(panda: Bench, offset: float) -> None:
    commanded = Q0.copy()
    commanded[2] += offset
    with pytest.raises(InputError, match="C not sent: joint 3 is commanded") as raised:
        panda.start(**ready(position=commanded)).Initialize()
    assert "\n" not in str(raised.value)
    assert panda.sent() == []


@pytest.mark.parametrize(("name", "gap"), [("status_age", 0.2), ("robot_mode", lcmt_panda_status.kGuiding)])
def test_start_gate_applies_again_after_a_gap(panda: Bench, name: str, gap: float) -> None:
    simulator = panda.start(**ready())
    simulator.AdvanceTo(0.105)  # between two events, so that the publish and the update of each agree
    assert panda.sent() != []
    panda.fix(simulator, **{name: gap})
    simulator.AdvanceTo(0.205)
    assert panda.sent() == []
    # The reference went on meanwhile.
    panda.fix(simulator, **ready(position=Q0 + 0.3))
    with pytest.raises(InputError, match="C not sent"):
        simulator.AdvanceTo(0.3)
    assert panda.sent() == []


def test_started_sender_follows_a_lagging_robot(panda: Bench) -> None:
    simulator = panda.start(**ready())
    simulator.AdvanceTo(0.1)
    panda.sent()
    panda.fix(simulator, position=Q0 + 0.1)
    simulator.AdvanceTo(0.2)
    np.testing.assert_array_equal(lcmt_panda_command.decode(panda.sent()[-1]).joint_position, Q0 + 0.1)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["position", "position_measured"])
def test_non_finite_start_is_refused(panda: Bench, name: str, value: float) -> None:
    position = Q0.copy()
    position[6] = value
    with pytest.raises(ValueError, match="is not finite"):
        panda.start(**ready(**{name: position})).Initialize()
    assert panda.sent() == []


def test_nan_is_refused_under_way(panda: Bench) -> None:
    simulator = panda.start(**ready())
    simulator.AdvanceTo(0.1)
    panda.sent()
    panda.fix(simulator, position=np.full(7, np.nan))
    with pytest.raises(ValueError, match="commanded position"):
        simulator.AdvanceTo(0.2)
    assert panda.sent() == []


def test_gripper_command(gripper: Bench) -> None:
    gripper.start(position=0.035, status_age=0.1).AdvanceTo(0.25)
    sent = gripper.sent()
    assert len(sent) == 3
    command = lcmt_schunk_wsg_command.decode(sent[0])
    assert command.utime == 1_700_000_000_250_000
    assert command.target_position_mm == pytest.approx(35.0)
    assert command.force == 20.0


@pytest.mark.parametrize("status_age", [np.inf, 0.51, np.nan])
def test_gripper_sends_nothing_unless_fresh(gripper: Bench, status_age: float) -> None:
    gripper.start(position=0.035, status_age=status_age).AdvanceTo(0.25)
    assert gripper.sent() == []


def test_gripper_refuses_nan(gripper: Bench) -> None:
    with pytest.raises(ValueError, match="commanded width nan is not finite"):
        gripper.start(position=np.nan, status_age=0.1).Initialize()
    assert gripper.sent() == []
