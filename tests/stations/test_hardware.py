from collections.abc import Callable

import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status
from pydrake.common.value import AbstractValue
from pydrake.common.yaml import yaml_load_typed
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from pace_drake.errors import InputError
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.panda_peer import START_UTIME, PandaPeer
from pace_drake.stations.hardware import LcmLoop, StatusMonitor, make_hardware_station

Q0 = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
PERIOD = 0.005  # [s] of the peer's status

INPUTS = {"panda.position": 7, "gripper.position": 1, "p_WH": 3}
OUTPUTS = {
    "panda.position_measured": 7,
    "panda.velocity_estimated": 7,
    "panda.torque_external": 7,
    "gripper.state_measured": 2,
    "robot_mode": 1,
    "status_age": 1,
    "num_status": 1,
}


def hold(position: np.ndarray) -> PiecewisePolynomial:
    return PiecewisePolynomial(position)


def move(start: np.ndarray, end: np.ndarray, duration: float) -> PiecewisePolynomial:
    """Returns a joint trajectory from rest to rest."""
    breaks, samples = [0.0, duration], np.column_stack([start, end])
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(breaks, samples, np.zeros(7), np.zeros(7))


class Rig:
    """A trajectory and a width -> the station -> a peer, on one memq:// queue."""

    def __init__(self, trajectory: PiecewisePolynomial, *, width: float = 0.08, clock_skew: float = 0.0) -> None:
        self.config = LcmConfig(url="memq://")
        self.lcm = DrakeLcm(self.config.url)
        self.peer = PandaPeer(self.lcm, Q0, config=self.config, status_rate=1.0 / PERIOD)
        self.sent: list[bytes] = []  # on either command channel, whether the peer accepts it or not
        for channel in (self.config.panda_command_channel, self.config.hand_command_channel):
            self.lcm.Subscribe(channel, self.sent.append)
        builder = DiagramBuilder()
        self.station: Diagram = builder.AddSystem(
            make_hardware_station(self.config, self.lcm, clock=lambda: self.peer.wall_clock() + clock_skew)
        )
        source = builder.AddSystem(TrajectorySource(trajectory))
        builder.Connect(source.get_output_port(), self.station.GetInputPort("panda.position"))
        source = builder.AddSystem(ConstantVectorSource([width]))
        builder.Connect(source.get_output_port(), self.station.GetInputPort("gripper.position"))
        self.simulator = Simulator(builder.Build())
        self.loop = LcmLoop(self.simulator, self.lcm, self.config, clock=self.peer.elapsed, poll_timeout=0.0)

    @property
    def context(self) -> Context:
        return self.simulator.get_context()

    def output(self, name: str) -> np.ndarray:
        return self.station.GetOutputPort(name).Eval(self.station.GetMyContextFromRoot(self.context))

    def start(self) -> "Rig":
        self.peer.step(0.0)
        self.loop.initialize(timeout=0.0)
        return self

    def run(self, duration: float, after_step: Callable[[], None] = lambda: None) -> None:
        for _ in range(round(duration / PERIOD)):
            self.peer.step(PERIOD)
            self.loop.step()
            after_step()


@pytest.fixture(scope="module")
def moved() -> Rig:
    """The rig after a move of 0.3 rad in every joint and a closing of the hand to 20 mm."""
    trajectory = move(Q0, Q0 + 0.3, 2.0)
    rig = Rig(trajectory, width=0.02).start()
    rig.errors = []  # type: ignore[attr-defined]
    rig.run(
        2.5,
        lambda: rig.errors.append(  # type: ignore[attr-defined]
            np.abs(rig.peer.position - trajectory.value(rig.context.get_time()).ravel()).max()
        ),
    )
    return rig


@pytest.fixture(scope="module")
def held() -> Rig:
    """A rig whose reference stays at the initial position; tests advance it and leave it running."""
    return Rig(hold(Q0)).start()


def test_ports_are_those_of_every_station(held: Rig) -> None:
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


def test_no_command_of_a_move_is_rejected(moved: Rig) -> None:
    assert moved.peer.num_rejected == 0
    assert moved.peer.num_accepted >= 490


def test_first_command_of_a_move_is_the_measured_position(moved: Rig) -> None:
    np.testing.assert_array_equal(moved.peer.commands[0], Q0)


def test_hand_is_commanded_once_and_measured(moved: Rig) -> None:
    assert moved.peer.num_hand_accepted == 1
    assert moved.peer.width == pytest.approx(0.02)
    np.testing.assert_allclose(moved.output("gripper.state_measured"), [0.02, 0.0])


def test_arm_in_motion_is_measured() -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0)).start()
    rig.run(1.0)
    velocity = rig.output("panda.velocity_estimated")
    np.testing.assert_allclose(velocity, np.full(7, 0.225), atol=0.005)  # 1.5 * 0.3 rad / 2 s at half-way
    np.testing.assert_array_equal(velocity, rig.peer.velocity)


def test_hand_in_motion_is_measured() -> None:
    rig = Rig(hold(Q0), width=0.02).start()
    rig.run(0.3)
    width, rate = rig.output("gripper.state_measured")
    assert 0.02 < width < 0.08
    assert rate == pytest.approx(0.005)


def test_runs_are_equal_bit_for_bit(moved: Rig) -> None:
    again = Rig(move(Q0, Q0 + 0.3, 2.0), width=0.02).start()
    again.run(2.5)
    assert again.sent == moved.sent


def test_nothing_is_sent_before_the_first_status() -> None:
    rig = Rig(hold(Q0))
    rig.simulator.AdvanceTo(1.0)
    rig.lcm.HandleSubscriptions(0)
    assert rig.sent == []
    assert rig.output("num_status") == [0.0]
    assert rig.output("status_age") == [np.inf]
    assert rig.output("robot_mode") == [lcmt_panda_status.kOther]
    # The same diagram sends as soon as a status is there.
    rig.peer.step(0.0)
    rig.lcm.HandleSubscriptions(0)
    rig.simulator.AdvanceTo(1.1)
    rig.lcm.HandleSubscriptions(0)
    np.testing.assert_array_equal(rig.peer.commands[0], Q0)


def test_wrong_start_sends_nothing() -> None:
    rig = Rig(hold(Q0 + 0.1))
    with pytest.raises(InputError, match="start the motion from the measured position"):
        rig.start()
    rig.lcm.HandleSubscriptions(0)
    assert rig.peer.num_accepted == rig.peer.num_rejected == 0


def test_external_torque_has_drakes_sign(held: Rig) -> None:
    held.peer.torque_external = np.arange(1.0, 8.0)
    held.run(2 * PERIOD)
    np.testing.assert_array_equal(held.output("panda.torque_external"), -np.arange(1.0, 8.0))


def test_robot_mode_other_than_move_stops_the_commands(held: Rig) -> None:
    held.run(2 * PERIOD)
    held.peer.robot_mode = lcmt_panda_status.kReflex
    held.run(2 * PERIOD)
    assert held.output("robot_mode") == [lcmt_panda_status.kReflex]
    before = held.peer.num_accepted
    held.run(0.1)
    assert held.peer.num_accepted == before
    held.peer.robot_mode = lcmt_panda_status.kMove
    held.run(0.1)
    assert held.output("robot_mode") == [lcmt_panda_status.kMove]
    assert held.peer.num_accepted > before


def test_silence_ages_the_status_and_stops_the_commands(held: Rig) -> None:
    held.run(2 * PERIOD)
    num_status = held.output("num_status")[0]
    assert held.output("status_age")[0] <= 2 * PERIOD
    held.peer.silent = True
    held.run(0.1)
    assert held.output("status_age")[0] == pytest.approx(0.1, abs=2 * PERIOD)
    before = held.peer.num_accepted
    held.run(0.1)
    assert held.peer.num_accepted == before
    assert held.output("status_age")[0] == pytest.approx(0.2, abs=2 * PERIOD)
    assert held.output("num_status")[0] == num_status
    held.peer.silent = False
    held.run(4 * PERIOD)
    assert held.output("num_status")[0] == num_status + 4.0
    assert held.output("status_age")[0] <= 2 * PERIOD
    assert held.peer.num_accepted > before


def test_silence_under_way_closes_the_start_gate() -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0)).start()
    rig.run(0.5)
    rig.peer.silent = True
    rig.run(0.5)
    last = rig.peer.commands[-1]
    rig.peer.silent = False
    with pytest.raises(InputError, match="PANDA_COMMAND not sent"):
        rig.run(0.1)
    rig.peer.step(0.1)
    np.testing.assert_array_equal(rig.peer.commands[-1], last)
    np.testing.assert_allclose(rig.peer.position, last, atol=1e-6)  # held, as the driver does


def test_status_age_runs_with_time_alone() -> None:
    dut = StatusMonitor(lcmt_panda_status, ["robot_mode"])
    status = lcmt_panda_status()
    status.utime, status.robot_mode = 12345, lcmt_panda_status.kMove
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.get_input_port().FixValue(context, AbstractValue.Make(status))
    assert dut.GetOutputPort("status_age").Eval(context) == [np.inf]
    simulator.Initialize()
    values = {}
    for time in (0.0, 0.25):
        context.SetTime(time)
        values[time] = [dut.GetOutputPort(name).Eval(context)[0] for name in ("num_status", "status_age")]
    assert values == {0.0: [1.0, 0.0], 0.25: [1.0, 0.25]}
    assert dut.GetOutputPort("robot_mode").Eval(context) == [lcmt_panda_status.kMove]


def test_duplicate_status_is_not_fresh(held: Rig) -> None:
    held.run(2 * PERIOD)
    held.peer.silent = True
    status = lcmt_panda_status()
    status.utime, status.num_joints, status.robot_mode = 12345, 7, lcmt_panda_status.kMove
    for name in lcmt_panda_status.__slots__:
        if name.startswith("joint_"):
            setattr(status, name, [0.0] * 7)
    status.joint_position = Q0.tolist()
    num_status = held.output("num_status")[0]
    for _ in range(20):
        held.lcm.Publish(held.config.panda_status_channel, status.encode())
        held.run(PERIOD)
    assert held.output("num_status")[0] == num_status + 1.0
    assert held.output("status_age")[0] == pytest.approx(0.1, abs=2 * PERIOD)
    held.peer.silent = False


@pytest.mark.parametrize("clock_skew", [0.2, -0.2])
def test_skewed_clock_moves_nothing(clock_skew: float) -> None:
    rig = Rig(move(Q0, Q0 + 0.3, 2.0), clock_skew=clock_skew).start()
    rig.run(0.2)
    rig.peer.step(0.0)
    assert rig.peer.num_accepted == 0
    assert rig.peer.num_rejected >= 35
    np.testing.assert_array_equal(rig.peer.position, Q0)


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
    assert held.context.get_time() == pytest.approx(held.peer.elapsed())


def test_loop_needs_a_status_and_a_start() -> None:
    rig = Rig(hold(Q0))
    with pytest.raises(RuntimeError, match="initialize first"):
        rig.loop.step()
    with pytest.raises(InputError, match="no PANDA_STATUS message on 'memq://' within 0 s"):
        rig.loop.initialize(timeout=0.0)
    assert rig.sent == []


def test_config_from_yaml() -> None:
    config = yaml_load_typed(schema=LcmConfig, data="url: memq://\ncommand_rate: 400", defaults=LcmConfig())
    assert config == LcmConfig(url="memq://", command_rate=400.0)
    with pytest.raises(RuntimeError, match="comand_rate"):
        yaml_load_typed(schema=LcmConfig, data="comand_rate: 400", defaults=LcmConfig())


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("command_rate", 0.0),
        ("hand_command_rate", -1.0),
        ("status_timeout", float("nan")),
        ("start_tolerance", float("inf")),
        ("panda_status_channel", ""),
    ],
)
def test_unusable_setting_is_named(field: str, value: object) -> None:
    config = LcmConfig(**{field: value})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"lcm.{field} is"):
        make_hardware_station(config, DrakeLcm("memq://"))
