"""Senders of the arm's and the gripper's commands: silent until the operator lets them speak."""

import time
from collections.abc import Callable

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_command
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.errors import InputError
from pace_drake.lcm.link import Lcm
from pace_drake.ports import declare_input, declare_output
from pace_drake.safety.command_gate import CommandGate, GateInput, GateMode, GateState
from pace_drake.safety.joint_limits import NUM_JOINTS


class PandaCommandSender(LeafSystem):
    """Publishes what a CommandGate lets pass as ``lcmt_panda_command``, as the position-mode driver wants it.

    A command carries the POSITION bit alone, empty velocity and torque arrays, and the wall clock as ``utime``: the
    driver drops what differs from its own clock by more than 0.1 s, past or future. (Drake's own
    ``PandaCommandSender`` stamps the context time: a diagram that starts at t = 0 never moves a robot.)

    Inputs:
        position (7) [rad]: the reference.
        position_measured (7) [rad]: of the last status.
        status_age (1) [s]: time since the last status; infinite before the first.
        robot_mode (1): libfranka's robot mode of the last status; 2 = Move.
        fault (1): brakes, while it is not 0.
        enable (1): the operator's leave to move: its rising edge counts; unconnected, never.
        stalled (1) [s]: time that this process has lost so far; unconnected, none.

    Outputs:
        following (1): 1 while the reference is what is sent.
        gate_mode (1): see ``GateMode``.
        refusal (2): why the last command that was refused was (``Refusal``), and at which joint [1-based]; 0 none.
        num_refusals (1), num_losses (1): how often a command was refused, and time was lost while the arm moved.
        command (7) [rad]: sent last, while gate_mode is not SILENT.

    State:
        That of the gate (``GateState.vector``), and stalled [s] at the last tick.

    Events:
        update, every ``gate.period``: sends one command, if the gate sends one at this tick. (A publish event of the
            same instant belongs to the end of the step before: where an input changes between two advances, it would
            send something else than what the update remembers.)

    Args:
        lcm: where the commands are published.
        gate: what lets them pass.
        channel: LCM channel of the commands.
        status_timeout: [s] largest status_age on which a command is sent.
        max_stall: [s] that may be lost between two ticks of a moving arm.
        clock: wall clock [s since the Unix epoch] that stamps the commands.
    """

    def __init__(
        self,
        lcm: Lcm,
        gate: CommandGate,
        *,
        channel: str = "PANDA_COMMAND",
        status_timeout: float = 0.05,
        max_stall: float = 0.05,
        clock: Callable[[], float] = time.time,
    ) -> None:
        super().__init__()
        self._lcm, self._gate, self._channel, self._clock = lcm, gate, channel, clock
        self._status_timeout, self._max_stall = status_timeout, max_stall
        self._position = declare_input(self, "position", NUM_JOINTS)
        self._measured = declare_input(self, "position_measured", NUM_JOINTS)
        self._status_age = declare_input(self, "status_age")
        self._robot_mode = declare_input(self, "robot_mode")
        self._fault = declare_input(self, "fault")
        self._enable = declare_input(self, "enable")
        self._stalled = declare_input(self, "stalled")
        self.DeclareDiscreteState(np.append(GateState().vector(), 0.0))
        state = {self.xd_ticket()}
        declare_output(self, "following", lambda c: self.state(c).mode == GateMode.FOLLOWING, state)
        declare_output(self, "gate_mode", lambda c: self.state(c).mode, state)
        declare_output(self, "refusal", lambda c: [self.state(c).refusal, self.state(c).joint], state, size=2)
        declare_output(self, "num_refusals", lambda c: self.state(c).num_refusals, state)
        declare_output(self, "num_losses", lambda c: self.state(c).num_losses, state)
        declare_output(self, "command", lambda c: self.state(c).position, state, size=NUM_JOINTS)
        self.DeclarePeriodicDiscreteUpdateEvent(gate.period, 0.0, self.Update)

    @staticmethod
    def state(context: Context) -> GateState:
        """What the gate remembers."""
        return GateState.from_vector(context.get_discrete_state_vector().value()[:-1])

    def Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Sends the command of this instant and remembers it."""
        stalled = self._stalled.Eval(context)[0] if self._stalled.HasValue(context) else 0.0
        stalled_before = context.get_discrete_state_vector().value()[-1]
        seen = GateInput(
            reference=self._position.Eval(context),
            measured=self._measured.Eval(context),
            ready=bool(
                self._status_age.Eval(context)[0] <= self._status_timeout
                and self._robot_mode.Eval(context)[0] == lcmt_panda_status.kMove
            ),
            fault=bool(self._fault.HasValue(context) and self._fault.Eval(context)[0]),
            enable=bool(self._enable.HasValue(context) and self._enable.Eval(context)[0]),
            lost=bool(stalled - stalled_before > self._max_stall),
        )
        after = self._gate.tick(self.state(context), seen)
        discrete_state.set_value(0, np.append(after.vector(), stalled))
        if after.mode == GateMode.SILENT:
            return
        message = lcmt_panda_command()
        message.utime = int(self._clock() * 1e6)
        message.num_joint_position = NUM_JOINTS
        message.joint_position = after.position.tolist()
        message.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION
        self._lcm.Publish(self._channel, message.encode())


class GripperCommandSender(LeafSystem):
    """Publishes the gripper's commanded width as ``lcmt_schunk_wsg_command``.

    The driver opens by a move and closes by a grasp with the given force; it ignores repeated identical commands, so
    the period only bounds the delay. Nothing is sent unless the gripper's status is fresh and the arm follows its path:
    no finger moves before the operator has let the arm move, nor during a fault. The width is a set point, not a
    trajectory.

    Inputs:
        position (1) [m]: commanded width between the fingers.
        status_age (1) [s]: time since the last gripper status arrived; infinite before the first.
        following (1): whether the arm follows its path.

    Events:
        publish, every ``1 / rate`` seconds: sends one command.

    Raises (from the publish event):
        InputError: the commanded width is not finite.

    Args:
        lcm: where the commands are published.
        channel: LCM channel of the commands.
        rate: [Hz] commands per second of context time.
        status_timeout: [s] largest status_age on which a command is sent.
        force: [N] grasp force when closing.
        clock: wall clock [s since the Unix epoch] that stamps the commands.
    """

    def __init__(
        self,
        lcm: Lcm,
        *,
        channel: str = "PANDA_HAND_COMMAND",
        rate: float = 10.0,
        status_timeout: float = 0.5,
        force: float = 40.0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        super().__init__()
        self._lcm, self._channel, self._force, self._clock = lcm, channel, force, clock
        self._status_timeout = status_timeout
        self._position = declare_input(self, "position")
        self._status_age = declare_input(self, "status_age")
        self._following = declare_input(self, "following")
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self.Publish)

    def Publish(self, context: Context) -> None:
        """Sends the command of this instant."""
        fresh = self._status_age.Eval(context)[0] <= self._status_timeout
        if not (fresh and self._following.Eval(context)[0]):
            return
        width = float(self._position.Eval(context)[0])
        if not np.isfinite(width):
            raise InputError(f"{self._channel} not sent: the commanded width is {width}")
        message = lcmt_schunk_wsg_command()
        message.utime = int(self._clock() * 1e6)
        message.target_position_mm = 1e3 * width
        message.force = self._force
        self._lcm.Publish(self._channel, message.encode())
