"""Senders of the arm's and the hand's commands: silent until there is a fresh status to start from."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_command
from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Context, DiscreteValues, InputPort, LeafSystem

from pace_drake.errors import InputError

NUM_JOINTS = 7


def _eval(port: InputPort, context: Context) -> np.ndarray:
    value: Any = port.Eval(context)  # Drake's stubs say object.
    return value


class PandaCommandSender(LeafSystem):
    """Publishes the arm's commanded position as ``lcmt_panda_command``, as the position-mode driver wants it.

    A command carries the POSITION bit alone, empty velocity and torque arrays, and the wall clock as
    ``utime``: the driver drops what differs from its own clock by more than 0.1 s, past or future. (Drake's
    own ``PandaCommandSender`` stamps the context time: a diagram that starts at t = 0 never moves a robot.)

    The start gate. Nothing is sent unless the status is fresh and the robot is in Move mode. The first
    command after that state is reached IS the measured position, and it is sent only if the commanded
    position lies within `start_tolerance` of it; otherwise InputError is raised and nothing is sent. The gate
    applies again after every gap in the status and after every stay outside Move: the driver holds the last
    position in the meantime, while the diagram's reference may have gone on.

    Inputs:
        position (7) [rad] commanded joint position.
        position_measured (7) [rad] joint position of the last status.
        status_age (1) [s] time since the last status arrived; infinite before the first.
        robot_mode (1) libfranka's robot mode of the last status; 2 = Move. It and `status_age` must come from
            discrete state and time alone, as those of ``StatusMonitor`` do; see Events.

    State:
        started (1) 1 if the command of the last period was sent, so that the gate has been passed.

    Events:
        Publish, every ``1 / rate`` seconds: sends one command.
        Update, at the same instants: it sees the same values of `status_age` and `robot_mode` as the publish
        before it, since discrete updates of one instant all read the values before them.

    Raises (from the publish event):
        InputError: the start gate is closed.
        ValueError: a commanded or measured position is not finite.
    """

    def __init__(
        self,
        lcm: DrakeLcmInterface,
        *,
        channel: str = "PANDA_COMMAND",
        rate: float = 200.0,
        status_timeout: float = 0.05,
        start_tolerance: float = 0.01,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Declares ports and events.

        Args:
            lcm: where the commands are published.
            channel: LCM channel of the commands.
            rate: commands per second of context time [Hz].
            status_timeout: largest `status_age` on which a command is sent [s].
            start_tolerance: largest \\|commanded - measured\\| of a joint at the first command [rad].
            clock: wall clock [s since the Unix epoch] that stamps the commands.
        """
        LeafSystem.__init__(self)
        self._lcm = lcm
        self._channel = channel
        self._status_timeout = status_timeout
        self._start_tolerance = start_tolerance
        self._clock = clock
        self._position = self.DeclareVectorInputPort("position", NUM_JOINTS)
        self._position_measured = self.DeclareVectorInputPort("position_measured", NUM_JOINTS)
        self._status_age = self.DeclareVectorInputPort("status_age", 1)
        self._robot_mode = self.DeclareVectorInputPort("robot_mode", 1)
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self.Publish)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self.Update)

    def Publish(self, context: Context) -> None:
        """Sends the command of this instant, or the measured position if it is the first."""
        if not self._may_send(context):
            return
        position = _eval(self._position, context)
        if not np.all(np.isfinite(position)):
            raise ValueError(f"{self._channel} not sent: commanded position {position} is not finite")
        if context.get_discrete_state_vector().GetAtIndex(0) == 0.0:
            position = self._check_start(position, _eval(self._position_measured, context))
        message = lcmt_panda_command()
        message.utime = int(self._clock() * 1e6)
        message.num_joint_position = NUM_JOINTS
        message.joint_position = position.tolist()
        message.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION
        self._lcm.Publish(self._channel, message.encode())

    def Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Remembers whether the publish event of this instant sent a command."""
        discrete_state.get_mutable_vector().SetAtIndex(0, float(self._may_send(context)))

    def _may_send(self, context: Context) -> bool:
        return bool(
            _eval(self._status_age, context)[0] <= self._status_timeout
            and _eval(self._robot_mode, context)[0] == lcmt_panda_status.kMove
        )

    def _check_start(self, position: np.ndarray, position_measured: np.ndarray) -> np.ndarray:
        """Returns `position_measured`, once `position` is known to be near it."""
        if not np.all(np.isfinite(position_measured)):
            raise ValueError(f"{self._channel} not sent: measured position {position_measured} is not finite")
        error = np.abs(position - position_measured)
        joint = int(np.argmax(error))
        if error[joint] > self._start_tolerance:
            raise InputError(
                f"{self._channel} not sent: joint {joint + 1} is commanded to {position[joint]:.4f} rad but "
                f"measured at {position_measured[joint]:.4f} rad (the first command may differ by "
                f"{self._start_tolerance:g} rad): start the motion from the measured position"
            )
        return position_measured


class GripperCommandSender(LeafSystem):
    """Publishes the hand's commanded width as ``lcmt_schunk_wsg_command``.

    The hand driver opens by a move and closes by a grasp with the given force; it ignores repeated identical
    commands, so the period only bounds the delay. Nothing is sent unless the hand's status is fresh. The
    width is a set point, not a trajectory: the start gate of the arm does not apply.

    Inputs:
        position (1) [m] commanded width between the fingers.
        status_age (1) [s] time since the last hand status arrived; infinite before the first.

    Events:
        Publish, every ``1 / rate`` seconds: sends one command.

    Raises (from the publish event):
        ValueError: the commanded width is not finite.
    """

    def __init__(
        self,
        lcm: DrakeLcmInterface,
        *,
        channel: str = "PANDA_HAND_COMMAND",
        rate: float = 10.0,
        status_timeout: float = 0.5,
        force: float = 40.0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Declares ports and events.

        Args:
            lcm: where the commands are published.
            channel: LCM channel of the commands.
            rate: commands per second of context time [Hz].
            status_timeout: largest `status_age` on which a command is sent [s].
            force: grasp force when closing [N].
            clock: wall clock [s since the Unix epoch] that stamps the commands.
        """
        LeafSystem.__init__(self)
        self._lcm = lcm
        self._channel = channel
        self._status_timeout = status_timeout
        self._force = force
        self._clock = clock
        self._position = self.DeclareVectorInputPort("position", 1)
        self._status_age = self.DeclareVectorInputPort("status_age", 1)
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self.Publish)

    def Publish(self, context: Context) -> None:
        """Sends the command of this instant."""
        if not _eval(self._status_age, context)[0] <= self._status_timeout:  # so written for NaN
            return
        width = float(_eval(self._position, context)[0])
        if not np.isfinite(width):
            raise ValueError(f"{self._channel} not sent: commanded width {width} is not finite")
        message = lcmt_schunk_wsg_command()
        message.utime = int(self._clock() * 1e6)
        message.target_position_mm = 1e3 * width
        message.force = self._force
        self._lcm.Publish(self._channel, message.encode())
