import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_command
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from pace_drake.lcm.command_sender import GripperCommandSender, PandaCommandSender
from pace_drake.safety.command_gate import CommandGate, GateMode, Refusal
from pace_drake.safety.joint_limits import JOINT_LIMITS

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


@pytest.fixture
def panda() -> Bench:
    lcm = DrakeLcm("memq://")
    gate = CommandGate(limits=JOINT_LIMITS["fer"], period=0.01)
    return Bench(PandaCommandSender(lcm, gate, channel="C", clock=lambda: WALL_CLOCK), lcm, "C")


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
        "enable": 1.0,
        **other,
    }


def test_command_is_what_the_driver_wants(panda: Bench) -> None:
    panda.start(**ready()).AdvanceTo(0.055)
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
        {"enable": 0.0},
        {"fault": 1.0},
        {"position": np.full(7, np.nan)},
        {"position_measured": np.full(7, np.nan)},
    ],
)
def test_nothing_is_sent_unless_all_is_well(panda: Bench, inputs: dict[str, object]) -> None:
    panda.start(**ready(**inputs)).AdvanceTo(0.1)
    assert panda.sent() == []


def test_unconnected_it_has_no_leave(panda: Bench) -> None:
    inputs = ready()
    del inputs["enable"]
    panda.start(**inputs).AdvanceTo(0.1)
    assert panda.sent() == []


def test_what_is_remembered_is_what_was_sent_when_an_input_changes_at_a_tick(panda: Bench) -> None:
    simulator = panda.start(**ready(enable=0.0))
    simulator.AdvanceTo(0.05)  # at a tick
    panda.fix(simulator, enable=1.0, position=Q0 + 0.01)
    simulator.AdvanceTo(0.105)
    sent = [lcmt_panda_command.decode(data).joint_position for data in panda.sent()]
    np.testing.assert_array_equal(sent[0], Q0)
    np.testing.assert_array_equal(sent[-1], panda.dut.GetOutputPort("command").Eval(simulator.get_context()))
    assert len(sent) == 6


def test_gate_is_put_out(panda: Bench) -> None:
    simulator = panda.start(**ready())
    simulator.AdvanceTo(0.105)
    panda.fix(simulator, position=Q0 + 1.0)
    simulator.AdvanceTo(0.125)

    def output(name: str) -> list[float]:
        return panda.dut.GetOutputPort(name).Eval(simulator.get_context()).tolist()

    assert output("gate_mode") == [GateMode.BRAKING]
    assert output("following") == [0.0]
    assert output("refusal") == [Refusal.VELOCITY, 1.0]
    assert output("num_refusals") == [1.0]
    np.testing.assert_array_equal(output("command"), Q0)


def test_gripper_command(gripper: Bench) -> None:
    gripper.start(position=0.035, status_age=0.1, following=1.0).AdvanceTo(0.25)
    sent = gripper.sent()
    assert len(sent) == 3
    command = lcmt_schunk_wsg_command.decode(sent[0])
    assert command.utime == 1_700_000_000_250_000
    assert command.target_position_mm == pytest.approx(35.0)
    assert command.force == 20.0


@pytest.mark.parametrize(("status_age", "following"), [(np.inf, 1.0), (0.51, 1.0), (np.nan, 1.0), (0.1, 0.0)])
def test_gripper_sends_nothing_unless_fresh_and_the_arm_follows(
    gripper: Bench, status_age: float, following: float
) -> None:
    gripper.start(position=0.035, status_age=status_age, following=following).AdvanceTo(0.25)
    assert gripper.sent() == []


def test_gripper_refuses_nan(gripper: Bench) -> None:
    with pytest.raises(ValueError, match="the commanded width is nan"):
        gripper.start(position=np.nan, status_age=0.1, following=1.0).Initialize()
    assert gripper.sent() == []
