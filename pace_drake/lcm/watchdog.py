"""Watchdog: what is wrong with the robot, its driver, the network or this process, and what follows from it."""

from enum import IntEnum

import numpy as np
from drake import lcmt_panda_status
from pydrake.systems.framework import Context, DiscreteValues, InputPort, LeafSystem

from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.inbox import Inbox
from pace_drake.ports import declare_input, declare_output
from pace_drake.safety.command_gate import GateMode, Refusal
from pace_drake.safety.joint_limits import JOINT_LIMITS, NUM_JOINTS


class Trouble(IntEnum):
    """What is wrong. Before STALL it is a ``stop``: the path is held and goes on after an acknowledgement. From there
    on it is a ``fault``: the arm brakes at once, and the operator's leave leads it back to its path first."""

    NONE = 0
    OFF_PATH = 1
    """The arm is not on its path (yet); not latched."""
    MODE = 2
    """Somebody has stopped the robot or guides it by hand."""
    SUCCESS_RATE = 3
    STALL = 4
    CLOCK = 5
    NO_STATUS = 6
    ROBOT = 7
    """A reflex, its recovery, or no motion possible."""
    TRACKING = 8
    JOINT_LIMIT = 9
    REFUSED = 10
    OTHER_SENDER = 11


_FIRST_FAULT = Trouble.STALL
_MODE_NAMES = {
    lcmt_panda_status.kOther: "Other",
    lcmt_panda_status.kIdle: "Idle",
    lcmt_panda_status.kMove: "Move",
    lcmt_panda_status.kGuiding: "Guiding",
    lcmt_panda_status.kReflex: "Reflex",
    lcmt_panda_status.kUserStopped: "UserStopped",
    lcmt_panda_status.kAutomaticErrorRecovery: "AutomaticErrorRecovery",
}
_REFUSALS = {
    Refusal.NOT_FINITE: "it is not finite",
    Refusal.POSITION: "the arm could not stop within its position limit",
    Refusal.VELOCITY: "it would exceed the velocity limit",
    Refusal.ACCELERATION: "it would exceed the acceleration limit",
    Refusal.JERK: "it would exceed the jerk limit",
    Refusal.TOO_FAR: "the arm is too far from its path; bring it nearer by hand",
    Refusal.OBSTRUCTED: "the straight way to the path is not free; bring the arm nearer by hand",
}


class Watchdog(LeafSystem):
    """Turns trouble into ``stop`` or ``fault``, each in the statechart, until it is over and acknowledged.

    Inputs:
        status_age (1) [s], robot_mode (1), success_rate (1), clock_skew (1) [s], position_measured (7) [rad]: of
            PandaStatusReceiver.
        gate_mode (1), num_refusals (1), refusal (2), num_losses (1), command (7) [rad]: of PandaCommandSender.
        stop, fault, ack (1 each): from outside; unconnected, never.

    Outputs:
        stop (1): 1 for the stop from outside, while the arm is not on its path, and for trouble that calls for it.
        fault (1): 1 for the fault from outside, and for trouble that calls for it.
        trouble (1): see ``Trouble``.

    State:
        [trouble latched, ack, refusals, messages of other senders and losses of time, each at the last look].

    Events:
        update: at every step. Trouble latches; an ``ack`` that rises releases it if it is over.

    Args:
        config: validated settings.
        others: messages of other senders on the command channel.
    """

    def __init__(self, config: LcmConfig, others: Inbox) -> None:
        super().__init__()
        self._config, self._others = config, others
        self._limits = JOINT_LIMITS[config.robot]
        self.DeclareDiscreteState(5)

        def inputs(*names: str, size: int = 1) -> list[InputPort]:
            return [declare_input(self, name, size) for name in names]

        self._age, self._mode, self._success, self._skew = inputs(
            "status_age", "robot_mode", "success_rate", "clock_skew"
        )
        self._gate_mode, self._num_refusals, self._num_losses = inputs("gate_mode", "num_refusals", "num_losses")
        self._refusal = declare_input(self, "refusal", 2)
        self._measured, self._command = inputs("position_measured", "command", size=NUM_JOINTS)
        self._stop, self._fault, self._ack = inputs("stop", "fault", "ack")
        seen = {self.all_input_ports_ticket(), self.xd_ticket(), self.time_ticket()}
        # The others read this one, which Drake works out once for all of them.
        self._trouble_port = declare_output(self, "trouble", self._calc_trouble, seen)
        declare_output(self, "stop", self._calc_stop, seen)
        declare_output(self, "fault", self._calc_fault, seen)
        self.DeclarePerStepDiscreteUpdateEvent(self.Update)

    @staticmethod
    def _optional(port: InputPort, context: Context) -> float:
        return port.Eval(context)[0] if port.HasValue(context) else 0.0

    def _present(self, context: Context) -> Trouble:
        """What is wrong now, the gravest first."""
        config, mode = self._config, int(self._mode.Eval(context)[0])
        gate_mode = self._gate_mode.Eval(context)[0]
        sends = gate_mode != GateMode.SILENT
        _, _, refusals, _, losses = context.get_discrete_state_vector().value()
        age, measured = self._age.Eval(context)[0], self._measured.Eval(context)
        if age == np.inf:
            return Trouble.OFF_PATH
        if self._num_refusals.Eval(context)[0] > refusals:
            return Trouble.REFUSED
        if self._num_losses.Eval(context)[0] > losses:
            return Trouble.STALL
        if age > config.status_timeout:
            return Trouble.NO_STATUS
        if np.any(self._beyond(measured) > 0):
            return Trouble.JOINT_LIMIT
        if sends and np.max(np.abs(self._error(context))) > config.max_tracking_error:
            return Trouble.TRACKING
        if mode in (lcmt_panda_status.kUserStopped, lcmt_panda_status.kGuiding):
            return Trouble.MODE
        if mode != lcmt_panda_status.kMove:
            return Trouble.ROBOT
        if abs(self._skew.Eval(context)[0]) > config.max_clock_skew:
            return Trouble.CLOCK
        if sends and self._success.Eval(context)[0] < config.min_success_rate:
            return Trouble.SUCCESS_RATE
        return Trouble.NONE if gate_mode == GateMode.FOLLOWING else Trouble.OFF_PATH

    @property
    def num_messages_of_others(self) -> int:
        """How many commands somebody else has sent."""
        return self._others.num_good + self._others.num_old + self._others.num_bad

    def _beyond(self, measured: np.ndarray) -> np.ndarray:
        """(7) [rad] how far beyond the position limits, less the margin, the arm is."""
        return self._limits.beyond(measured, self._config.limit_margin)

    def _error(self, context: Context) -> np.ndarray:
        return self._command.Eval(context) - self._measured.Eval(context)

    def _calc_trouble(self, context: Context) -> float:
        """The graver of what is latched and what is present."""
        return max(context.get_discrete_state_vector().GetAtIndex(0), self._present(context))

    def _trouble(self, context: Context) -> Trouble:
        return Trouble(int(self._trouble_port.Eval(context)[0]))

    def _calc_stop(self, context: Context) -> float:
        off_path = self._gate_mode.Eval(context)[0] != GateMode.FOLLOWING
        return float(bool(self._optional(self._stop, context)) or off_path or self._trouble(context) != Trouble.NONE)

    def _calc_fault(self, context: Context) -> float:
        return float(bool(self._optional(self._fault, context)) or self._trouble(context) >= _FIRST_FAULT)

    def Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Latches what is wrong, or releases it."""
        latched, ack_before, _, others, _ = context.get_discrete_state_vector().value()
        present, ack = self._present(context), self._optional(self._ack, context)
        if self.num_messages_of_others > others:
            present = Trouble.OTHER_SENDER
        if present > Trouble.OFF_PATH:
            latched = max(latched, present)
        elif ack and not ack_before:
            latched = Trouble.NONE
        discrete_state.set_value(
            0,
            [
                latched,
                ack,
                self._num_refusals.Eval(context)[0],
                self.num_messages_of_others,
                self._num_losses.Eval(context)[0],
            ],
        )

    def describe(self, context: Context, status: Inbox) -> str:
        """One line that says what is wrong now and what to do; empty if nothing is.

        Args:
            context: of this system.
            status: where the arm's status arrives.
        """
        config, trouble = self._config, self._trouble(context)
        if trouble in (Trouble.NONE, Trouble.OFF_PATH):
            return ""
        measured, error = self._measured.Eval(context), self._error(context)
        beyond = self._beyond(measured)
        refusal, joint = (int(value) for value in self._refusal.Eval(context))
        mode = _MODE_NAMES.get(int(self._mode.Eval(context)[0]), "unknown")
        worst, nearest = int(np.argmax(np.abs(error))), int(np.argmax(beyond))
        bad = f"; {status.num_bad} messages could not be used, the last because it {status.last_bad}"
        return {
            Trouble.MODE: f"robot mode is {mode}: release the robot, then acknowledge",
            Trouble.SUCCESS_RATE: f"the robot takes {100 * self._success.Eval(context)[0]:.0f} % of its commands in "
            f"time (at least {100 * config.min_success_rate:.0f} % are wanted): see network and real-time kernel",
            Trouble.STALL: f"this process fell more than {1e3 * config.max_stall:.0f} ms behind while the arm moved: "
            "close other programs, then acknowledge",
            Trouble.CLOCK: f"this machine's clock is {self._skew.Eval(context)[0]:+.3f} s ahead of the driver's, which "
            "drops commands that are 0.1 s old: synchronise the clocks",
            Trouble.NO_STATUS: f"no {status.channel} for {self._age.Eval(context)[0]:.2f} s: look after the driver and "
            f"the network{bad if status.num_bad else ''}",
            Trouble.ROBOT: f"robot mode is {mode}: look what it has touched, let the driver recover, then acknowledge",
            Trouble.TRACKING: f"joint {worst + 1} is {error[worst]:+.3f} rad off its command (at most "
            f"{config.max_tracking_error:g}): look what holds it",
            Trouble.JOINT_LIMIT: f"joint {nearest + 1} is at {measured[nearest]:.3f} rad, less than "
            f"{config.limit_margin:g} from its limit: guide the arm away by hand",
            Trouble.REFUSED: f"a command {f'of joint {joint} ' if joint else ''}was refused: "
            f"{_REFUSALS.get(Refusal(refusal), 'see above')}",
            Trouble.OTHER_SENDER: f"somebody else sends on {self._others.channel}: stop the other program",
        }[trouble]
