"""A robot of our own for the driver's tests: it goes exactly where it is sent, in a time of its own."""

from collections.abc import Callable

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status
from pydrake.lcm import DrakeLcm

from pace_drake.driver.arm import ArmDriver
from pace_drake.driver.config import DriverConfig
from pace_drake.driver.limits import usable
from pace_drake.driver.robot import PERIOD, Cycle, RobotMode, RobotState
from pace_drake.lcm.config import LcmConfig
from pace_drake.safety.joint_limits import JOINT_LIMITS

FR3 = JOINT_LIMITS["fr3"]

START = np.array([0.0, 0.3, 0.0, -1.57, 0.0, 1.57, 0.785])  # [rad]
EPOCH = 1_700_000_000.0  # [s] wall clock when the robot's clock is 0


class FakeRobot:
    """Meets ``pace_drake.driver.robot.Robot``. ``each_cycle`` is called before every state and may raise."""

    def __init__(self, each_cycle: Callable[[], None] = lambda: None) -> None:
        self.q = START.copy()
        self.mode = RobotMode.IDLE
        self.cycles = 0
        self.each_cycle = each_cycle
        self.calls: list[str] = []
        self.sent: list[np.ndarray] = []

    @property
    def time(self) -> float:
        return PERIOD * self.cycles

    def state(self) -> RobotState:
        self.cycles += 1
        self.each_cycle()
        zero = [0.0] * 7
        tau_ext = [0.1 * joint for joint in range(7)]
        return RobotState(self.q, zero, zero, self.q, zero, zero, zero, tau_ext, 0.9, self.mode, self.time)

    def connect(self) -> None:
        self.calls.append("connect")

    def read(self) -> RobotState:
        return self.state()

    def control(self, cycle: Cycle) -> None:
        self.calls.append("control")
        self.mode, finished = RobotMode.MOVE, False
        while not finished:
            position, finished = cycle(self.state(), PERIOD)
            self.q = np.array(position)
            self.sent.append(self.q)
        self.mode = RobotMode.IDLE

    def recover(self) -> None:
        self.calls.append("recover")
        self.mode = RobotMode.IDLE

    def close(self) -> None:
        self.calls.append("close")

    def reflex(self, error: Exception) -> None:
        self.mode = RobotMode.REFLEX
        raise error


def make_command(utime: int, position, mode: int = lcmt_panda_status.CONTROL_MODE_POSITION) -> lcmt_panda_command:
    message = lcmt_panda_command()
    message.utime, message.control_mode_expected = utime, mode
    message.joint_position = list(position)
    message.num_joint_position = len(message.joint_position)
    return message


class Rig:
    """A driver on a fake robot, and what it says."""

    def __init__(self, config: DriverConfig | None = None) -> None:
        self.robot = FakeRobot(self._each_cycle)
        self.lcm = DrakeLcm("memq://")
        self.reports: list[str] = []
        self.statuses: list[lcmt_panda_status] = []
        self.script: Callable[[int], None] = lambda cycle: None
        self.driver = ArmDriver(
            self.robot,
            self.lcm,
            usable(FR3),
            channels=LcmConfig(),
            config=config or DriverConfig(),
            report=self.reports.append,
            clock=lambda: EPOCH + self.robot.time,
            steady_clock=lambda: self.robot.time,
            sleep=self._sleep,
        )
        self.lcm.Subscribe("PANDA_STATUS", lambda data: self.statuses.append(lcmt_panda_status.decode(data)))

    def _each_cycle(self) -> None:
        self.script(self.robot.cycles)

    def _sleep(self, duration: float) -> None:
        self.robot.cycles += round(duration / PERIOD)

    def send(self, position, age: float = 0.0) -> None:
        utime = round(1e6 * (EPOCH + self.robot.time - age))
        self.lcm.Publish("PANDA_COMMAND", make_command(utime, position).encode())

    def run(self, script: Callable[[int], None], cycles: int) -> None:
        """Runs; ``script`` is called with the number of the cycle before every one."""
        self.script = script
        self.driver.run(lambda: self.robot.cycles >= cycles)
        self.lcm.HandleSubscriptions(0)

    def modes(self) -> list[int]:
        """Returns the robot modes in the order in which they were reported."""
        modes = [status.robot_mode for status in self.statuses]
        return [mode for k, mode in enumerate(modes) if k == 0 or mode != modes[k - 1]]
