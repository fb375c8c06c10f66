"""Of the vendors' packages: what can be had without a robot. Nothing here speaks the FER's protocol (version 5)."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from pace_drake.driver.robot import ConnectionLost, MotionAborted, RobotMode, RobotState
from pace_drake.errors import InputError

pytest.importorskip("pylibfranka", reason="needs the extra 'driver'")
pytest.importorskip("panda_py", reason="needs the extra 'driver'")

from pace_drake.driver import fer, fr3
from pace_drake.driver.hand import FrankaHand

NOBODY = "127.0.99.99"  # no robot listens there


@pytest.mark.parametrize(
    "robot", [fr3.Fr3(NOBODY, realtime=False), fer.Fer(NOBODY, realtime=False), FrankaHand(NOBODY)]
)
def test_nobody_there(robot):
    with pytest.raises(ConnectionLost) as raised:
        robot.connect()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("robot", [fr3.Fr3(NOBODY), fer.Fer(NOBODY)])
def test_all_modes_are_known(robot):
    assert sorted(robot._modes.values()) == sorted(RobotMode)


@pytest.mark.parametrize(
    ("module", "make"), [("pylibfranka", fr3.Fr3), ("panda_py", fer.Fer), ("panda_py", FrankaHand)]
)
def test_an_absent_package_is_named_with_the_extra(monkeypatch, module, make):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"pace_drake\[driver\]"):
        make(NOBODY)


#: Answers one connection as a robot of another version does. A process, since libfranka holds Python's lock meanwhile.
ANSWER = """
import socket, sys
listener = socket.create_server((sys.argv[1], 1337))
print("ready", flush=True)
connection, _ = listener.accept()
header = connection.recv(100)[:8]
# Command and id as asked, size 16, status 1 (incompatible version), version.
connection.sendall(header + (16).to_bytes(4, "little") + bytes([1, 0, int(sys.argv[2]), 0]))
"""


@pytest.mark.parametrize(("make", "version"), [(fr3.Fr3, 5), (fer.Fer, 10)])
def test_a_robot_of_the_other_version_is_an_error_and_no_reason_to_try_again(make, version):
    address = f"127.0.99.{version}"
    with subprocess.Popen([sys.executable, "-c", ANSWER, address, str(version)], stdout=subprocess.PIPE) as other:
        try:
            assert other.stdout.readline() == b"ready\n"
            with pytest.raises(InputError, match=r"(?i)version"):
                make(address, realtime=False).connect()
        finally:
            other.kill()


class FakeLibfranka:
    """Stands for panda-python's Robot, which cannot be made without a robot. Its JointPositions are the real ones."""

    def __init__(self, modes, error: Exception | None = None, reachable: bool = True) -> None:
        self.error, self.reachable, self.commands, self.arguments = error, reachable, [], {}
        seven = [0.5] * 7
        self.state = SimpleNamespace(
            **{name: seven for name in ("q", "dq", "tau_J", "q_d", "dq_d", "ddq_d", "tau_J_d")},
            tau_ext_hat_filtered=[1.0] * 7,
            control_command_success_rate=0.75,
            robot_mode=modes.kMove,
            time=SimpleNamespace(to_sec=lambda: 12.5),
        )

    def control_joint_position(self, callback, mode, **arguments) -> None:
        self.arguments = {"mode": mode, **arguments}
        if self.error:
            raise self.error
        while not self.commands or not self.commands[-1].motion_finished:
            self.commands.append(callback(self.state, SimpleNamespace(to_sec=lambda: 0.001)))

    def automatic_error_recovery(self) -> None:
        if self.error:
            raise self.error

    def read_once(self):
        if not self.reachable:
            raise RuntimeError("libfranka: UDP receive: Timeout")
        return self.state


def fer_with(**arguments) -> tuple[fer.Fer, FakeLibfranka]:
    robot = fer.Fer(NOBODY, realtime=False)
    robot._robot = FakeLibfranka(robot._package.RobotMode, **arguments)
    return robot, robot._robot


def test_fer_control_passes_states_and_positions_and_ends():
    robot, behind = fer_with()
    seen: list[RobotState] = []

    def cycle(state: RobotState, period: float):
        seen.append(state)
        assert period == 0.001
        return [0.1 * len(seen)] * 7, len(seen) == 3

    robot.control(cycle)
    assert [command.q[0] for command in behind.commands] == pytest.approx([0.1, 0.2, 0.3])
    assert [command.motion_finished for command in behind.commands] == [False, False, True]
    assert behind.arguments["limit_rate"] is False
    assert (seen[0].mode, seen[0].time, seen[0].success_rate) == (RobotMode.MOVE, 12.5, 0.75)
    assert seen[0].tau_ext == [1.0] * 7


@pytest.mark.parametrize("call", [lambda robot: robot.control(None), lambda robot: robot.recover()])
def test_fer_tells_an_aborted_motion_from_a_lost_connection(call):
    error = RuntimeError("libfranka: Move command aborted:\n motion aborted by reflex!")
    with pytest.raises(MotionAborted, match=r"^Move command aborted: motion aborted by reflex!$"):
        call(fer_with(error=error)[0])
    with pytest.raises(ConnectionLost, match="Timeout"):
        call(fer_with(error=error, reachable=False)[0])


def test_fer_wants_a_realtime_kernel_unless_told_otherwise():
    robot = fer.Fer(NOBODY)
    if robot._package.has_realtime_kernel():
        pytest.skip("there is one")
    with pytest.raises(InputError, match="--no-realtime"):
        robot.control(lambda state, period: ([0.0] * 7, True))


def test_fr3_without_a_realtime_kernel_says_what_to_do():
    robot = fr3.Fr3(NOBODY)
    real = robot._package

    def refuse(ip: str, config) -> None:
        assert config == real.RealtimeConfig.kEnforce
        raise real.RealtimeException("libfranka: Running kernel does not have realtime capabilities.")

    names = ("RealtimeConfig", "RealtimeException", "NetworkException", "FrankaException")
    robot._package = SimpleNamespace(Robot=refuse, **{name: getattr(real, name) for name in names})
    with pytest.raises(InputError, match=r"capabilities. --no-realtime does without"):
        robot.connect()
