"""The FER (Franka Emika Robot, "Panda"), through panda-python's binding of libfranka 0.9 (server version 5)."""

from typing import Any

from pace_drake.driver.fr3 import one_line
from pace_drake.driver.robot import ConnectionLost, Cycle, MotionAborted, RobotMode, RobotState
from pace_drake.errors import InputError

_NO_CUTOFF = 1000.0  # [Hz] libfranka's kMaxCutoffFrequency: its low-pass is off, the positions are smooth already


def import_libfranka() -> Any:
    """Returns panda-python's module ``libfranka``.

    Raises:
        InputError: the package is absent.
    """
    try:
        from panda_py import libfranka
    except ImportError as error:
        raise InputError(f"this needs panda-python: pip install 'pace_drake[driver]' ({error})") from None
    return libfranka


class Fer:
    """See ``pace_drake.driver.robot.Robot``.

    The binding turns all errors of libfranka into RuntimeError. Whether a failed command or motion means that the
    connection is lost is found out by asking for the state.
    """

    def __init__(self, ip: str, *, realtime: bool = True) -> None:
        """Imports the package; see ``Fr3``."""
        self._package = import_libfranka()
        self._ip, self._realtime = ip, realtime
        self._robot: Any = None
        self._modes: dict[Any, RobotMode] = {
            mode: RobotMode(int(mode)) for mode in self._package.RobotMode.__members__.values()
        }

    def connect(self) -> None:
        """See ``Robot``."""
        config = self._package.RealtimeConfig
        try:
            self._robot = self._package.Robot(self._ip, config.kEnforce if self._realtime else config.kIgnore)
        except RuntimeError as error:
            message = one_line(error)
            if "version" in message.lower():
                raise InputError(f"robot at {self._ip}: {message}") from error
            raise ConnectionLost(message) from error

    def read(self) -> RobotState:
        """See ``Robot``."""
        try:
            return RobotState.of(self._robot.read_once(), self._modes)
        except RuntimeError as error:
            raise ConnectionLost(one_line(error)) from error

    def control(self, cycle: Cycle) -> None:
        """See ``Robot``."""
        package = self._package
        if self._realtime and not package.has_realtime_kernel():
            # libfranka would say so in an error that cannot be told from others.
            raise InputError("no real-time kernel is running; --no-realtime does without")

        def callback(state: Any, period: Any) -> Any:
            position, finished = cycle(RobotState.of(state, self._modes), period.to_sec())
            command = package.JointPositions(position)
            command.motion_finished = finished
            return command

        self._call(
            lambda: self._robot.control_joint_position(
                callback, package.ControllerMode.kJointImpedance, limit_rate=False, cutoff_frequency=_NO_CUTOFF
            )
        )

    def recover(self) -> None:
        """See ``Robot``."""
        self._call(lambda: self._robot.automatic_error_recovery())

    def close(self) -> None:
        """See ``Robot``."""
        self._robot = None

    def _call(self, call: Any) -> None:
        try:
            call()
        except RuntimeError as error:
            self.read()
            raise MotionAborted(one_line(error)) from error
