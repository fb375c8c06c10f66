from collections.abc import Callable

import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_status
from pydrake.common.yaml import yaml_load_typed
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from pace_drake.errors import InputError
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.panda_peer import START_UTIME, PandaPeer
from pace_drake.lcm.watchdog import Trouble
from pace_drake.safety.command_gate import GateMode
from pace_drake.stations.hardware import HardwareStation, LcmLoop

Q0 = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
PERIOD = 0.005  # [s] of the peer's status
START = 0.2  # [s] at which trajectories begin

INPUTS = {"panda.position": 7, "gripper.position": 1, "p_WH": 3, "ack": 1, "stop": 1, "fault": 1, "stalled": 1}
OUTPUTS = {
    "panda.position_measured": 7,
    "panda.velocity_estimated": 7,
    "panda.torque_external": 7,
    "gripper.state_measured": 2,
    "gripper.status_age": 1,
    "robot_mode": 1,
    "status_age": 1,
    "num_status": 1,
    "gate_mode": 1,
    "stop": 1,
    "fault": 1,
    "trouble": 1,
}


def hold(position: np.ndarray) -> PiecewisePolynomial:
    return PiecewisePolynomial(position)


def move(start: np.ndarray, end: np.ndarray, duration: float) -> PiecewisePolynomial:
    """A joint trajectory from rest to rest, which begins at START."""
    breaks, samples = [START, START + duration], np.column_stack([start, end])
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(breaks, samples, np.zeros(7), np.zeros(7))


class Rig:
    """A trajectory and a width -> the station -> a peer, on one memq:// queue; the operator is the test."""

    def __init__(
        self, trajectory: PiecewisePolynomial, *, width: float = 0.08, clock_skew: float = 0.0, **settings: object
    ) -> None:
        self.config = LcmConfig(url="memq://", **settings)  # type: ignore[arg-type]
        self.lcm = DrakeLcm(self.config.url)
        self.peer = PandaPeer(self.lcm, Q0, config=self.config, status_rate=1.0 / PERIOD)
        self.sent: list[bytes] = []  # on either command channel, whether the peer accepts it or not
        for channel in (self.config.panda_command_channel, self.config.hand_command_channel):
            self.lcm.Subscribe(channel, self.sent.append)
        builder = DiagramBuilder()
        self.station = builder.AddSystem(
            HardwareStation(self.config, self.lcm, clock=lambda: self.peer.wall_clock() + clock_skew)
        )
        # The path stands still until the operator's leave has brought the arm there.
        self.source = builder.AddSystem(TrajectorySource(trajectory))
        builder.Connect(self.source.get_output_port(), self.station.GetInputPort("panda.position"))
        source = builder.AddSystem(ConstantVectorSource([width]))
        builder.Connect(source.get_output_port(), self.station.GetInputPort("gripper.position"))
        for name in ("ack", "stop", "fault", "stalled"):
            builder.ExportInput(self.station.GetInputPort(name), name)
        self.simulator = Simulator(builder.Build())
        self.loop = LcmLoop(self.simulator, self.lcm, self.station, clock=self.peer.elapsed, poll_timeout=0.0)

    @property
    def context(self) -> Context:
        return self.simulator.get_context()

    def output(self, name: str) -> np.ndarray:
        return self.station.GetOutputPort(name).Eval(self.station.GetMyContextFromRoot(self.context))

    def fix(self, name: str, value: float) -> None:
        port = self.simulator.get_system().GetInputPort(name)
        port.FixValue(self.simulator.get_mutable_context(), value)

    @property
    def mode(self) -> GateMode:
        return GateMode(int(self.output("gate_mode")[0]))

    @property
    def trouble(self) -> Trouble:
        return Trouble(int(self.output("trouble")[0]))

    @property
    def message(self) -> str:
        return self.station.describe_trouble(self.context)

    def start(self) -> "Rig":
        self.peer.step(0.0)
        self.loop.initialize(timeout=0.0)
        return self

    def acknowledge(self) -> None:
        self.fix("ack", 1.0)
        self.run(0.1)
        self.fix("ack", 0.0)
        self.run(PERIOD)

    def follow(self) -> "Rig":
        self.start()
        self.acknowledge()
        assert self.mode == GateMode.FOLLOWING
        return self

    def run(self, duration: float, after_step: Callable[[], None] = lambda: None) -> None:
        for _ in range(round(duration / PERIOD)):
            self.peer.step(PERIOD)
            self.loop.step()
            after_step()


@pytest.fixture(scope="module")
def moved() -> Rig:
    """The rig after a move of 0.3 rad in every joint and a closing of the gripper to 20 mm."""
    trajectory = move(Q0, Q0 + 0.3, 2.0)
    rig = Rig(trajectory, width=0.02).follow()
    rig.errors = []  # type: ignore[attr-defined]
    rig.run(
        2.5,
        lambda: rig.errors.append(  # type: ignore[attr-defined]
            np.abs(rig.peer.position - trajectory.value(rig.context.get_time()).ravel()).max()
        ),
    )
    return rig


@pytest.fixture
def held() -> Rig:
    """A rig that follows a path which stands still."""
    return Rig(hold(Q0)).follow()


def test_ports_are_those_of_every_station_and_the_operators(held: Rig) -> None:
    station = held.station
    inputs = [station.get_input_port(i) for i in range(station.num_input_ports())]
    outputs = [station.get_output_port(i) for i in range(station.num_output_ports())]
    assert {port.get_name(): port.size() for port in inputs} == INPUTS
    assert {port.get_name(): port.size() for port in outputs} == OUTPUTS
    assert station.get_name() == "station"


def test_move_is_tracked(moved: Rig) -> None:
    errors = np.array(moved.errors)  # type: ignore[attr-defined]
    assert len(errors) == 500
    assert 1e-4 < errors.max() < 0.005  # the peer lags, so exactly 0 would be no tracking at all
    assert errors[-1] < 1e-4
    np.testing.assert_allclose(moved.peer.position, Q0 + 0.3, atol=1e-4)
    np.testing.assert_allclose(moved.output("panda.position_measured"), moved.peer.position)
    assert moved.trouble == Trouble.NONE
    assert moved.message == ""


def test_no_command_of_a_move_is_rejected(moved: Rig) -> None:
    assert moved.peer.num_rejected == 0
    assert moved.peer.num_accepted >= 490


def test_first_command_of_a_move_is_the_measured_position(moved: Rig) -> None:
    np.testing.assert_array_equal(moved.peer.commands[0], Q0)


def test_gripper_is_commanded_once_and_measured(moved: Rig) -> None:
    assert moved.peer.num_hand_accepted == 1
    assert moved.peer.width == pytest.approx(0.02)
    np.testing.assert_allclose(moved.output("gripper.state_measured"), [0.02, 0.0])


def test_arm_in_motion_is_measured() -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0)).follow()
    rig.run(1.0 + START - rig.context.get_time())
    velocity = rig.output("panda.velocity_estimated")
    np.testing.assert_allclose(velocity, np.full(7, 0.225), atol=0.005)  # 1.5 * 0.3 rad / 2 s at half-way
    np.testing.assert_array_equal(velocity, rig.peer.velocity)


def test_gripper_in_motion_is_measured() -> None:
    rig = Rig(hold(Q0), width=0.02).follow()
    rig.run(0.2)
    width, rate = rig.output("gripper.state_measured")
    assert 0.02 < width < 0.08
    assert rate == pytest.approx(0.005)


def test_runs_are_equal_bit_for_bit(moved: Rig) -> None:
    again = Rig(move(Q0, Q0 + 0.3, 2.0), width=0.02).follow()
    again.run(2.5)
    assert again.sent == moved.sent


def test_nothing_is_sent_without_leave() -> None:
    rig = Rig(hold(Q0), width=0.02).start()
    rig.run(1.0)
    rig.peer.step(0.0)
    assert rig.sent == []
    assert (rig.mode, rig.trouble, rig.output("stop"), rig.output("fault")) == (GateMode.SILENT, Trouble.OFF_PATH, 1, 0)
    rig.acknowledge()
    assert rig.output("stop") == 0
    np.testing.assert_array_equal(rig.peer.commands[0], Q0)


def test_before_the_first_status_all_is_zero_and_nothing_is_sent() -> None:
    rig = Rig(hold(Q0))
    rig.fix("ack", 1.0)
    rig.simulator.AdvanceTo(1.0)
    rig.lcm.HandleSubscriptions(0)
    assert rig.sent == []
    assert rig.output("num_status") == [0.0]
    assert rig.output("status_age") == [np.inf]
    assert rig.output("robot_mode") == [lcmt_panda_status.kOther]
    assert rig.trouble == Trouble.OFF_PATH


def test_arm_off_its_path_is_led_there_slowly() -> None:
    rig = Rig(hold(Q0 + 0.1))
    rig.start()
    rig.acknowledge()
    assert rig.mode == GateMode.JOINING
    assert rig.output("stop") == 1
    np.testing.assert_array_equal(rig.peer.commands[0], Q0)
    rig.run(2.0)
    assert rig.mode == GateMode.FOLLOWING
    np.testing.assert_allclose(rig.peer.position, Q0 + 0.1, atol=1e-6)
    assert 0.19 < np.abs(np.diff(rig.peer.commands, axis=0)).max() / PERIOD < 0.22  # a tenth of 2.175 rad/s


def test_external_torque_has_drakes_sign(held: Rig) -> None:
    held.peer.torque_external = np.arange(1.0, 8.0)
    held.run(2 * PERIOD)
    np.testing.assert_array_equal(held.output("panda.torque_external"), -np.arange(1.0, 8.0))


@pytest.mark.parametrize(
    ("mode", "trouble", "fault"),
    [
        (lcmt_panda_status.kReflex, Trouble.ROBOT, 1),
        (lcmt_panda_status.kAutomaticErrorRecovery, Trouble.ROBOT, 1),
        (lcmt_panda_status.kIdle, Trouble.ROBOT, 1),
        (lcmt_panda_status.kUserStopped, Trouble.MODE, 0),
        (lcmt_panda_status.kGuiding, Trouble.MODE, 0),
    ],
)
def test_robot_mode_other_than_move_silences_until_acknowledged(
    held: Rig, mode: int, trouble: Trouble, fault: int
) -> None:
    held.peer.robot_mode = mode
    held.run(2 * PERIOD)
    assert (held.trouble, held.output("stop"), held.output("fault")) == (trouble, 1, fault)
    assert "robot mode is" in held.message
    held.acknowledge()  # too early
    held.run(0.1)
    before = held.peer.num_accepted
    held.peer.robot_mode = lcmt_panda_status.kMove
    held.run(0.5)
    assert (held.trouble, held.peer.num_accepted) == (trouble, before)
    held.acknowledge()
    assert (held.trouble, held.mode) == (Trouble.NONE, GateMode.FOLLOWING)
    assert held.peer.num_accepted > before


def test_silence_ages_the_status_and_silences_until_acknowledged(held: Rig) -> None:
    num_status = held.output("num_status")[0]
    assert held.output("status_age")[0] <= 2 * PERIOD
    held.peer.silent = True
    held.run(0.1)
    assert held.output("status_age")[0] == pytest.approx(0.1, abs=2 * PERIOD)
    assert (held.trouble, held.output("fault")) == (Trouble.NO_STATUS, 1)
    assert "no PANDA_STATUS for 0.1" in held.message
    before = held.peer.num_accepted
    held.run(0.1)
    assert held.output("status_age")[0] == pytest.approx(0.2, abs=2 * PERIOD)
    assert held.output("num_status")[0] == num_status
    held.peer.silent = False
    held.run(4 * PERIOD)
    assert held.output("num_status")[0] == num_status + 4.0
    assert held.output("status_age")[0] <= 2 * PERIOD
    assert (held.trouble, held.peer.num_accepted) == (Trouble.NO_STATUS, before)
    held.acknowledge()
    assert held.trouble == Trouble.NONE


def test_silence_under_way_leads_back_to_the_path() -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0)).follow()
    rig.run(0.5)
    rig.peer.silent = True
    rig.run(0.5)
    last = rig.peer.commands[-1]
    rig.peer.step(0.1)
    np.testing.assert_allclose(rig.peer.position, last, atol=1e-6)  # held, as the driver does
    rig.peer.silent = False
    rig.run(2.0)
    np.testing.assert_array_equal(rig.peer.commands[-1], last)
    rig.acknowledge()
    assert rig.mode == GateMode.JOINING
    rig.run(3.0)
    assert rig.mode == GateMode.FOLLOWING
    np.testing.assert_allclose(rig.peer.position, Q0 + 0.3, atol=1e-6)


def bad_status(rig: Rig, **changes: object) -> bytes:
    """A status of the peer's that is new, but for what is changed."""
    status = lcmt_panda_status()
    status.utime, status.num_joints, status.robot_mode = round(1e6 * rig.peer.wall_clock()) + 1, 7, 2
    for name in lcmt_panda_status.__slots__:
        if name.startswith("joint_"):
            setattr(status, name, [0.0] * 7)
    status.joint_position = Q0.tolist()
    for name, value in changes.items():
        setattr(status, name, value)
    return status.encode()


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"joint_position": [np.nan] * 7}, "joint_position is not finite"),
        ({"joint_torque_external": [np.inf] * 7}, "joint_torque_external is not finite"),
        ({"control_command_success_rate": np.nan}, "control_command_success_rate is not finite"),
        ({"num_joints": 6}, "joint_position has 6 joints instead of 7"),
    ],
)
def test_status_that_cannot_be_used_is_no_status(held: Rig, changes: dict[str, object], what: str) -> None:
    held.peer.silent = True
    for _ in range(20):
        held.lcm.Publish(held.config.panda_status_channel, bad_status(held, **changes))
        held.run(PERIOD)
    assert held.trouble == Trouble.NO_STATUS
    assert f"20 messages could not be used, the last because it {what}" in held.message.replace("because it is", "is")


@pytest.mark.parametrize(
    ("width", "speed", "taken"),
    [
        (0.0, 0.0, True),
        (39.9, -100.0, True),
        (-0.1, 5.0, True),
        (np.nan, 0.0, False),
        (91.0, 0.0, False),
        (-6.0, 0.0, False),
        (1e-200, 0.0, False),
        (40.0, 1e5, False),
    ],
)
def test_gripper_status_that_is_no_grippers_is_dropped(held: Rig, width: float, speed: float, taken: bool) -> None:
    held.peer.silent = True
    held.run(4 * PERIOD)
    before = held.output("gripper.state_measured").copy()
    status = lcmt_schunk_wsg_status()
    status.utime = START_UTIME + 10_000_000
    status.actual_position_mm, status.actual_speed_mm_per_s = width, speed
    held.lcm.Publish(held.config.hand_status_channel, status.encode())
    held.run(PERIOD)
    expected = 1e-3 * np.array([width, speed]) if taken else before
    np.testing.assert_allclose(held.output("gripper.state_measured"), expected)
    assert (held.output("gripper.status_age")[0] < 3 * PERIOD) == taken


def test_duplicate_and_older_status_is_not_fresh(held: Rig) -> None:
    held.peer.silent = True
    status = bad_status(held)
    num_status = held.output("num_status")[0]
    older = bytearray(status)
    older[15] ^= 1  # the last byte of the stamp: 1 us less or more
    for _ in range(20):
        held.lcm.Publish(held.config.panda_status_channel, status)
        held.run(PERIOD)
        held.lcm.Publish(held.config.panda_status_channel, bytes(older))
        held.run(PERIOD)
    assert held.output("num_status")[0] <= num_status + 2.0
    assert held.trouble == Trouble.NO_STATUS


@pytest.mark.parametrize("clock_skew", [0.2, -0.2])
def test_skewed_clock_is_a_fault_that_moves_nothing(clock_skew: float) -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0), clock_skew=clock_skew).start()
    rig.run(0.5)
    assert (rig.trouble, rig.output("fault")) == (Trouble.CLOCK, 1)
    assert f"{clock_skew:+.3f} s ahead" in rig.message
    rig.acknowledge()
    assert rig.sent == []
    assert rig.trouble == Trouble.CLOCK


def test_a_status_that_is_read_late_is_no_skew(held: Rig) -> None:
    """A look that comes late makes the clocks seem apart; the least of the last fifty messages counts."""
    late = lcmt_panda_status.decode(bad_status(held))
    held.peer.step(0.0)
    late.utime, late.control_command_success_rate = late.utime - 200_000, 1.0
    skew = held.station.status.GetOutputPort("clock_skew")
    context = held.station.status.GetMyContextFromRoot(held.context)
    held.station.status.inbox.newest, held.station.status.inbox.num_good = (
        late,
        held.station.status.inbox.num_good + 1,
    )
    held.simulator.AdvanceTo(held.context.get_time() + 0.001)
    assert skew.Eval(context)[0] == pytest.approx(0.0, abs=0.01)
    assert held.trouble == Trouble.NONE


def test_an_acknowledgement_given_before_the_trouble_does_not_end_it(held: Rig) -> None:
    held.fix("ack", 1.0)
    held.run(0.1)
    held.peer.robot_mode = lcmt_panda_status.kReflex
    held.run(0.1)
    held.peer.robot_mode = lcmt_panda_status.kMove
    held.run(0.1)
    assert (held.trouble, held.mode) == (Trouble.ROBOT, GateMode.SILENT)


def test_no_finger_moves_before_the_arm_is_on_its_path() -> None:
    rig = Rig(hold(Q0 + 0.3), width=0.02).start()
    rig.acknowledge()
    rig.run(0.5)
    assert rig.mode == GateMode.JOINING
    assert rig.peer.num_hand_accepted == 0
    rig.run(4.0)
    assert rig.peer.num_hand_accepted == 1


@pytest.mark.parametrize("phase", [0.3, 0.7])
def test_the_ticks_settle_on_the_status(phase: float) -> None:
    """Wherever the clock begins between two status messages, they come to lie on the ticks."""
    rig = Rig(hold(Q0)).start()
    rig.loop._time_offset += phase * PERIOD
    rig.run(1.5)
    beside = (rig.peer.elapsed() + rig.loop._time_offset) / PERIOD
    assert abs(beside - round(beside)) < 0.02


def test_joint_that_does_not_follow_is_a_fault(held: Rig) -> None:
    rig = Rig(move(Q0, Q0 + 0.5, 2.0)).follow()
    rig.peer.blocked[3] = True
    rig.run(2.0)
    assert rig.trouble == Trouble.TRACKING
    assert "joint 4 is +0.1" in rig.message
    assert rig.mode in (GateMode.BRAKING, GateMode.SILENT)
    assert rig.peer.commands[-1][3] - Q0[3] < 0.2  # the path ends 0.5 rad away


def test_arm_near_a_joint_limit_is_a_fault(held: Rig) -> None:
    held.peer.position[6], held.peer.blocked[6] = 2.89, True
    held.run(2 * PERIOD)
    assert held.trouble == Trouble.JOINT_LIMIT
    assert "joint 7 is at 2.890 rad" in held.message


def test_low_success_rate_stops(held: Rig) -> None:
    held.peer.success_rate = 0.7
    held.run(2 * PERIOD)
    assert (held.trouble, held.output("stop"), held.output("fault")) == (Trouble.SUCCESS_RATE, 1, 0)
    assert "70 % of its commands" in held.message
    assert held.mode == GateMode.FOLLOWING  # which holds the path, that the chart holds


def test_jump_of_the_path_is_refused_before_it_is_sent() -> None:
    jump = PiecewisePolynomial.ZeroOrderHold([0.0, 0.5, 1.0], np.column_stack([Q0, Q0 + 0.2, Q0 + 0.2]))
    rig = Rig(jump).follow()
    rig.run(1.0)
    assert (rig.trouble, rig.output("fault")) == (Trouble.REFUSED, 1)
    assert "was refused: it would exceed the velocity limit" in rig.message
    np.testing.assert_array_equal(np.unique(rig.peer.commands, axis=0), [Q0])
    rig.acknowledge()  # the operator may lead the arm to where the path has jumped
    rig.run(3.0)
    assert (rig.trouble, rig.mode) == (Trouble.NONE, GateMode.FOLLOWING)
    np.testing.assert_allclose(rig.peer.position, Q0 + 0.2, atol=1e-6)


def test_another_sender_is_a_fault(held: Rig) -> None:
    command = lcmt_panda_command()
    command.utime = 1
    held.lcm.Publish(held.config.panda_command_channel, command.encode())
    held.run(2 * PERIOD)
    assert (held.trouble, held.output("fault")) == (Trouble.OTHER_SENDER, 1)
    assert held.message == "somebody else sends on PANDA_COMMAND: stop the other program"


def test_stop_and_fault_from_outside_pass(held: Rig) -> None:
    for name in ("stop", "fault"):
        held.fix(name, 1.0)
        assert held.output(name) == 1
        held.fix(name, 0.0)
        assert held.output(name) == 0


def test_time_that_the_process_loses_is_left_out_and_stops_a_moving_arm() -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0)).follow()
    rig.run(0.5)
    rig.peer.step(0.0)
    before, position = rig.context.get_time(), rig.peer.commands[-1]
    rig.peer.step(0.3)
    rig.loop.step()
    assert rig.context.get_time() == pytest.approx(before + 0.02, abs=1e-5)
    assert rig.loop.stalled == pytest.approx(0.28, abs=1e-5)
    rig.run(0.1)
    np.testing.assert_array_equal(rig.peer.commands[-1], position)
    assert (rig.trouble, rig.output("fault"), rig.mode) == (Trouble.STALL, 1, GateMode.SILENT)


def test_time_lost_at_rest_is_no_trouble(held: Rig) -> None:
    held.peer.step(0.3)
    held.loop.step()
    held.run(2 * PERIOD)
    assert held.trouble == Trouble.NONE


@pytest.mark.parametrize(
    "change",
    [
        {"control_mode_expected": 3},
        {"control_mode_expected": 0},
        {"num_joint_velocity": 7, "joint_velocity": [0.0] * 7},
        {"num_joint_torque": 7, "joint_torque": [0.0] * 7},
        {"num_joint_position": 6, "joint_position": [0.0] * 6},
        {},
    ],
)
def test_peer_wants_the_position_bit_and_nothing_else(change: dict[str, object]) -> None:
    lcm = DrakeLcm("memq://")
    peer = PandaPeer(lcm, Q0)
    command = lcmt_panda_command()
    command.utime = START_UTIME
    command.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION
    command.num_joint_position, command.joint_position = 7, Q0.tolist()
    for name, value in change.items():
        setattr(command, name, value)
    lcm.Publish("PANDA_COMMAND", command.encode())
    peer.step(0.0)
    assert (peer.num_accepted, peer.num_rejected) == ((0, 1) if change else (1, 0))


def test_loop_says_how_many_status_came(held: Rig) -> None:
    held.peer.step(3 * PERIOD)
    assert held.loop.step() == 3
    assert held.loop.step() == 0
    assert held.context.get_time() == pytest.approx(held.peer.elapsed(), abs=1e-5)


def test_loop_needs_a_status_and_a_start() -> None:
    rig = Rig(hold(Q0))
    with pytest.raises(RuntimeError, match="initialize first"):
        rig.loop.step()
    with pytest.raises(InputError, match="no usable PANDA_STATUS message within 0 s"):
        rig.loop.initialize(timeout=0.0)
    assert rig.sent == []


def test_config_from_yaml() -> None:
    config = yaml_load_typed(schema=LcmConfig, data="url: memq://\ncommand_rate: 250", defaults=LcmConfig())
    assert config == LcmConfig(url="memq://", command_rate=250.0)
    with pytest.raises(RuntimeError, match="comand_rate"):
        yaml_load_typed(schema=LcmConfig, data="comand_rate: 250", defaults=LcmConfig())


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("command_rate", 0.0),
        ("command_rate", 400.0),
        ("hand_command_rate", -1.0),
        ("status_timeout", float("nan")),
        ("start_tolerance", float("inf")),
        ("min_success_rate", 1.1),
        ("panda_status_channel", ""),
        ("robot", "ur5"),
    ],
)
def test_unusable_setting_is_named(field: str, value: object) -> None:
    config = LcmConfig(**{field: value})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"lcm.{field}: "):
        HardwareStation(config, DrakeLcm("memq://"))
