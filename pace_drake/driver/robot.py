"""What the driver needs of a robot; one small class for each of libfranka's Python packages meets it."""

import dataclasses as dc
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, Protocol

PERIOD = 0.001  # [s] of a control cycle


class RobotMode(IntEnum):
    """libfranka's robot modes, the values of ``lcmt_panda_status.robot_mode``."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


@dc.dataclass(slots=True)
class RobotState:
    """The state of a robot; each sequence has 7 entries, named as in libfranka."""

    q: Sequence[float]  # [rad]
    dq: Sequence[float]  # [rad/s]
    tau_J: Sequence[float]  # [Nm]
    q_d: Sequence[float]  # [rad]
    dq_d: Sequence[float]  # [rad/s]
    ddq_d: Sequence[float]  # [rad/s^2]
    tau_J_d: Sequence[float]  # [Nm]
    tau_ext: Sequence[float]  # [Nm] tau_ext_hat_filtered, in libfranka's sign
    success_rate: float  # of control commands, 0 to 1
    mode: RobotMode
    time: float  # [s] of the robot's clock

    @classmethod
    def of(cls, state: Any, modes: dict[Any, RobotMode]) -> "RobotState":
        """Returns a copy of libfranka's RobotState, whichever package wrapped it.

        Args:
            state: the package's RobotState.
            modes: what its robot modes are called here.
        """
        return cls(
            *(state.q, state.dq, state.tau_J, state.q_d, state.dq_d, state.ddq_d, state.tau_J_d),
            state.tau_ext_hat_filtered,
            state.control_command_success_rate,
            modes[state.robot_mode],
            state.time.to_sec(),
        )


class MotionAborted(Exception):
    """The robot ended the motion, or refused a command; the message is its reason in one line."""


class ConnectionLost(Exception):
    """The robot does not answer; the message says why in one line."""


#: Gets the state and the time since the last cycle [s]; returns the next position (7) [rad] and if it is the last one.
Cycle = Callable[[RobotState, float], tuple[Sequence[float], bool]]


class Robot(Protocol):
    """A robot in joint position mode. Every method but `close` may raise ConnectionLost."""

    def connect(self) -> None:
        """Connects.

        Raises:
            InputError: it can never succeed: a package is absent, or the robot speaks another version.
        """

    def read(self) -> RobotState:
        """Waits for the next state and returns it."""

    def control(self, cycle: Cycle) -> None:
        """Calls `cycle` every millisecond, until it says that the position was the last one.

        (A callback, since libfranka before 0.10 has nothing else.)

        Raises:
            MotionAborted: the robot ended the motion, or did not begin it.
        """

    def recover(self) -> None:
        """Recovers from a reflex; it takes up to some seconds.

        Raises:
            MotionAborted: the robot did not recover.
        """

    def close(self) -> None:
        """Disconnects."""
