"""A test peer with the LCM contract of a Panda driver. It is OURS: neither a robot nor anybody's driver."""

import math

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_command, lcmt_schunk_wsg_status

from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.link import Lcm

START_UTIME = 1_700_000_000_000_000  # [us] the peer's clock at construction; nothing like a context time
LOW_PASS = 30.0  # [Hz] cutoff of the driver's filter of commanded positions
HAND_PERIOD = 100_000  # [us] loop period of the hand driver
HAND_SPEED = 0.1  # [m/s] how fast the peer's fingers move


class PandaPeer:
    """Answers commands with a first-order joint response and publishes status, in position mode.

    NOT a robot: no dynamics, no limits, no reflexes. Time passes in `step` alone, so that runs are
    deterministic. Of the TRI driver's rules it keeps these: a command whose ``utime`` differs from the clock
    by more than 0.1 s is dropped; the POSITION bit alone and empty velocity and torque arrays are wanted (the
    real driver exits, the peer counts a rejection); when commands stop the last position is held;
    ``control_mode`` is never set; the hand ignores repeated identical commands.

    Attributes:
        position: joint position (7) [rad].
        width: width between the fingers [m].
        between: width of what is between the fingers [m], on which they close no further; 0: nothing.
        robot_mode: robot mode to report.
        torque_external: external torque (7) [Nm] to report, in libfranka's sign.
        success_rate: share of commands in time [-] to report.
        blocked: joints (7) that something holds.
        silent: True while no status is published.
        num_accepted, num_rejected: arm commands since construction.
        num_hand_accepted: hand commands since construction that were not repetitions.
        commands: the arm commands accepted, each (7) [rad].
    """

    def __init__(
        self,
        lcm: Lcm,
        position: np.ndarray,
        *,
        config: LcmConfig | None = None,
        status_rate: float = 200.0,
        width: float = 0.08,
        expiry: float = 0.1,
        start_utime: int = START_UTIME,
    ) -> None:
        """Subscribes to the commands.

        Args:
            lcm: the LCM interface of the station (a ``memq://`` queue is private to one object).
            position: initial joint position (7) [rad].
            config: channels; None: the defaults.
            status_rate: status messages per second [Hz].
            width: initial width between the fingers [m].
            expiry: largest |clock - utime| of a command [s].
            start_utime: its wall clock at construction [us].
        """
        self.position = np.array(position, dtype=float)
        self.velocity = np.zeros(7)
        self.width = width
        self.between = 0.0
        self.robot_mode = lcmt_panda_status.kMove
        self.torque_external = np.zeros(7)
        self.success_rate = 1.0
        self.blocked = np.zeros(7, dtype=bool)
        self.silent = False
        self.num_accepted = 0
        self.num_rejected = 0
        self.num_hand_accepted = 0
        self.commands: list[np.ndarray] = []
        self._lcm = lcm
        self._config = config or LcmConfig()
        self._expiry = round(1e6 * expiry)  # [us]
        self._start_utime = start_utime
        self._status_period = round(1e6 / status_rate)  # [us]
        self._elapsed = 0  # [us]
        self._next_status = 0  # [us]
        self._next_hand_status = 0  # [us]
        self._target = self.position.copy()
        self._hand_command = (1e3 * width, 0.0)  # target [mm], force [N]
        lcm.Subscribe(self._config.panda_command_channel, self._handle_command)
        lcm.Subscribe(self._config.hand_command_channel, self._handle_hand_command)

    def elapsed(self) -> float:
        """Returns the time since construction [s]: the steady clock for ``LcmLoop``."""
        return 1e-6 * self._elapsed

    def wall_clock(self) -> float:
        """Returns the peer's wall clock [s]: the clock that stamps commands in ``HardwareStation``."""
        return 1e-6 * (self._start_utime + self._elapsed)

    def hold(self) -> None:
        """Forgets the last command and holds the position, as a driver does that has been started anew."""
        self._target = self.position.copy()

    def step(self, duration: float) -> None:
        """Takes the pending commands, lets `duration` [s] pass and publishes the status due by its end."""
        self._lcm.HandleSubscriptions(0)
        end = self._elapsed + round(1e6 * duration)
        while True:
            due = min(self._next_status, self._next_hand_status, end)
            self._move(due)
            if due == self._next_status:
                self._next_status += self._status_period
                self._publish_status()
            if due == self._next_hand_status:
                self._next_hand_status += HAND_PERIOD
                self._publish_hand_status()
            if due == end and end < min(self._next_status, self._next_hand_status):
                return

    def _move(self, elapsed: int) -> None:
        dt = 1e-6 * (elapsed - self._elapsed)
        if dt == 0.0:
            return
        self._elapsed = elapsed
        # Exact for a first-order response to a constant command.
        step = (1.0 - math.exp(-2.0 * math.pi * LOW_PASS * dt)) * (self._target - self.position)
        step[self.blocked] = 0.0
        self.position += step
        self.velocity = step / dt
        self.width += float(np.clip(self._target_width() - self.width, -HAND_SPEED * dt, HAND_SPEED * dt))

    def _target_width(self) -> float:
        """[m] to which the fingers go."""
        return max(1e-3 * self._hand_command[0], self.between)

    def _publish_status(self) -> None:
        message = lcmt_panda_status()
        message.utime = self._start_utime + self._elapsed
        message.num_joints = 7
        message.joint_position = self.position.tolist()
        message.joint_position_desired = self._target.tolist()
        message.joint_velocity = self.velocity.tolist()
        message.joint_torque_external = self.torque_external.tolist()
        for name in ("velocity_desired", "acceleration_desired", "torque", "torque_desired"):
            setattr(message, f"joint_{name}", [0.0] * 7)
        message.control_command_success_rate = self.success_rate
        message.robot_mode = self.robot_mode
        message.robot_utime = self._elapsed
        if not self.silent:
            self._lcm.Publish(self._config.panda_status_channel, message.encode())

    def _publish_hand_status(self) -> None:
        message = lcmt_schunk_wsg_status()
        message.utime = self._start_utime + self._elapsed
        message.actual_position_mm = 1e3 * self.width
        # The TRI hand driver reports this speed for any motion.
        message.actual_speed_mm_per_s = 5.0 if abs(self._target_width() - self.width) > 1e-9 else 0.0
        if not self.silent:
            self._lcm.Publish(self._config.hand_status_channel, message.encode())

    def _handle_command(self, data: bytes) -> None:
        command = lcmt_panda_command.decode(data)
        if (
            abs(self._start_utime + self._elapsed - command.utime) > self._expiry
            or command.control_mode_expected != lcmt_panda_status.CONTROL_MODE_POSITION
            or (command.num_joint_position, command.num_joint_velocity, command.num_joint_torque) != (7, 0, 0)
        ):
            self.num_rejected += 1
            return
        self.num_accepted += 1
        self._target = np.array(command.joint_position)
        self.commands.append(self._target)

    def _handle_hand_command(self, data: bytes) -> None:
        command = lcmt_schunk_wsg_command.decode(data)
        if (command.target_position_mm, command.force) == self._hand_command:
            return
        self.num_hand_accepted += 1
        self._hand_command = (command.target_position_mm, command.force)
