"""The FR3, through Franka's own Python package pylibfranka (server version 10)."""

from typing import Any

from pace_drake.driver.robot import ConnectionLost, Cycle, MotionAborted, RobotMode, RobotState
from pace_drake.errors import InputError


def one_line(error: Exception) -> str:
    """Returns an error's message in one line, without the name of the library."""
    return " ".join(str(error).split()).removeprefix("libfranka: ")


class Fr3:
    """See ``pace_drake.driver.robot.Robot``."""

    def __init__(self, ip: str, *, realtime: bool = True) -> None:
        """Imports the package.

        Args:
            ip: address of the robot.
            realtime: whether a real-time kernel is required.

        Raises:
            InputError: the package is absent.
        """
        try:
            import pylibfranka
        except ImportError as error:
            raise InputError(f"the FR3 needs pylibfranka: pip install 'pace_drake[driver]' ({error})") from None
        self._package: Any = pylibfranka
        self._ip, self._realtime = ip, realtime
        self._robot: Any = None
        self._modes: dict[Any, RobotMode] = {
            mode: RobotMode(int(mode.value)) for mode in pylibfranka.RobotMode.__members__.values()
        }

    def connect(self) -> None:
        """See ``Robot``."""
        config = self._package.RealtimeConfig
        try:
            self._robot = self._package.Robot(self._ip, config.kEnforce if self._realtime else config.kIgnore)
        except self._package.RealtimeException as error:
            raise InputError(f"{one_line(error)} --no-realtime does without.") from error
        except self._package.NetworkException as error:
            raise ConnectionLost(one_line(error)) from error
        except (RuntimeError, self._package.FrankaException) as error:
            raise InputError(f"robot at {self._ip}: {one_line(error)}") from error

    def read(self) -> RobotState:
        """See ``Robot``."""
        try:
            return RobotState.of(self._robot.read_once(), self._modes)
        except (RuntimeError, self._package.FrankaException) as error:
            raise ConnectionLost(one_line(error)) from error

    def control(self, cycle: Cycle) -> None:
        """See ``Robot``."""
        package, finished = self._package, False
        try:
            motion = self._robot.start_joint_position_control(package.ControllerMode.JointImpedance)
            while not finished:
                state, period = motion.readOnce()
                position, finished = cycle(RobotState.of(state, self._modes), period.to_sec())
                command = package.JointPositions(position)
                command.motion_finished = finished
                motion.writeOnce(command)
        except package.RealtimeException as error:
            raise InputError(f"{one_line(error)} --no-realtime does without.") from error
        except package.NetworkException as error:
            raise ConnectionLost(one_line(error)) from error
        except (package.ControlException, package.CommandException, package.InvalidOperationException) as error:
            raise MotionAborted(one_line(error)) from error

    def recover(self) -> None:
        """See ``Robot``."""
        try:
            self._robot.automatic_error_recovery()
        except self._package.NetworkException as error:
            raise ConnectionLost(one_line(error)) from error
        except self._package.CommandException as error:
            raise MotionAborted(one_line(error)) from error

    def close(self) -> None:
        """See ``Robot``."""
        self._robot = None
