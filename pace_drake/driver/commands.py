"""CommandReceiver: which of the commands on the channel are taken, and why the others are not."""

import time
from collections.abc import Callable

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status

from pace_drake.driver.config import DriverConfig
from pace_drake.driver.limits import UsableLimits
from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.link import Lcm


class CommandReceiver:
    """Takes position commands by the rules of the TRI driver, and some more.

    Dropped are: bytes that are no command; a stamp further than ``expiry`` from the wall clock, past or future; any
    mode but POSITION alone; other than 7 positions and no velocities or torques; what is not a finite number; targets
    outside the position limits; duplicates and what comes out of order. Also a first command further than
    ``start_tolerance`` from the measured position: after `open` (start, recovery, reconnection) and after ``silence``.
    """

    def __init__(
        self,
        lcm: Lcm,
        channel: str,
        limits: UsableLimits,
        config: DriverConfig,
        *,
        clock: Callable[[], float] = time.time,
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Subscribes; until `open` every command is dropped.

        Args:
            lcm: where the commands come from.
            channel: their channel.
            limits: of the positions.
            config: what is accepted.
            clock: wall clock [s] that the stamps are compared with.
            steady_clock: clock [s] that measures silence.
        """
        self._limits, self._config, self._clock, self._steady_clock = limits, config, clock, steady_clock
        self._closed = "the driver is not connected to the robot yet"
        self._measured = np.zeros(7)
        self._last = -np.inf  # [s] steady clock at the last command taken
        self._num_taken = 0
        # Stamps are compared with the clock here, so a clock set back need not lock a sender out for long.
        restart = round(2e6 * config.expiry)
        self._inbox = Inbox(lcm, channel, lcmt_panda_command, restart=restart, check=self._check)

    @property
    def num_dropped(self) -> int:
        """Commands that could not be used so far."""
        return self._inbox.num_bad

    @property
    def last_dropped(self) -> str:
        """What was wrong with the last of those."""
        return self._inbox.last_bad

    def open(self) -> None:
        """Takes commands from now on, the first of them near the measured position."""
        self._closed, self._last = "", -np.inf

    def close(self, why: str) -> None:
        """Drops all commands from now on."""
        self._closed = why

    def take(self, measured: np.ndarray) -> tuple[np.ndarray, float] | None:
        """Returns position (7) [rad] and stamp [s] of the newest command, if one has come since the last call.

        Args:
            measured: the measured position (7) [rad], from which the next first command must not be far.
        """
        self._measured = measured
        if self._inbox.num_good == self._num_taken:
            return None
        self._num_taken = self._inbox.num_good
        command = self._inbox.newest
        return np.array(command.joint_position), 1e-6 * command.utime

    def _check(self, command: lcmt_panda_command) -> str:
        if self._closed:
            return self._closed
        ahead = 1e-6 * command.utime - self._clock()
        if abs(ahead) > self._config.expiry:
            return f"stamped {abs(ahead):.3f} s in the {'future' if ahead > 0 else 'past'}"
        if command.control_mode_expected != lcmt_panda_status.CONTROL_MODE_POSITION:
            return f"expects control mode {command.control_mode_expected}: only position (1) is available"
        sizes = (command.num_joint_position, command.num_joint_velocity, command.num_joint_torque)
        if sizes != (7, 0, 0):
            return "has {} positions, {} velocities and {} torques: 7, 0 and 0 are wanted".format(*sizes)
        position = np.array(command.joint_position)
        if not np.all(np.isfinite(position)):
            return "has a position that is not a finite number"
        if outside := self._limits.outside(position):
            return outside
        now = self._steady_clock()
        if now - self._last > self._config.silence:
            distance = np.abs(position - self._measured)
            joint = int(distance.argmax())
            if distance[joint] > self._config.start_tolerance:
                return (
                    f"first command is {distance[joint]:.3f} rad from the measured position at joint {joint + 1}, "
                    f"more than {self._config.start_tolerance:g} rad"
                )
        self._last = now
        return ""
