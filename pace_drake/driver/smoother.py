"""Smoother: from commands that come in steps to positions that the robot accepts every millisecond."""

from collections import deque

import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

from pace_drake.driver.limits import UsableLimits
from pace_drake.driver.robot import PERIOD

#: Weights of the moving average: 10 ms, taken twice.
_WEIGHTS = np.convolve(np.full(10, 0.1), np.full(10, 0.1))
_STREAM = 0.05  # [s] commands further apart are steps
_ON_THE_WAY = 3  # positions sent that the robot may be at
_SAME = 1.5e-6  # [rad] the robot reports in single precision; and goes so far astray when one command is late
_PATIENCE = 1.5  # how many intervals between commands pass before the sender counts as standing still


class Smoother:
    """Follows a stream of commanded positions within the limits of velocity, acceleration and jerk.

    1. Between two commands the target moves linearly, over the interval between their stamps.
    2. While it moves with v, it is led by v^2 / (2 a) + v a / (2 j), the way in which the joint stops: ruckig plans to
       stop at its target, and so keeps up with the stream instead of lagging by that way. (ruckig can be given a
       velocity to arrive with; tried, it swings to and fro whenever it is a little ahead.)
    3. ruckig takes one step of the fastest motion that stops at the target.
    4. A moving average over 10 ms, taken twice, takes away the acceleration that alternates at the rate of the
       commands, and leaves so little jerk that a single lost or late command is made up for within the limits. It
       keeps all limits, since an average of permitted values is permitted, and the one near position limits as well,
       which is concave.

    When a command is lost on its way, the robot goes on with constant acceleration. From where it says it is then,
    and no longer where it was sent, the motion must go on: see `follow`.
    """

    def __init__(self, limits: UsableLimits, position: np.ndarray) -> None:
        """Starts at rest.

        Args:
            limits: what not to exceed.
            position: where it starts (7) [rad].
        """
        self._limits = limits
        self._ruckig, self._input, self._output = Ruckig(7, PERIOD), InputParameter(7), OutputParameter(7)
        self._input.synchronization = Synchronization.No  # synchronized, all joints would lag as much as the slowest
        self._input.max_acceleration = limits.acceleration
        self._input.max_jerk = limits.jerk
        self._input.current_position = self._input.target_position = position
        self._recent = np.tile(np.asarray(position, dtype=float), (len(_WEIGHTS), 1))
        self._sent: deque[np.ndarray] = deque([np.array(position, dtype=float)], _ON_THE_WAY)
        self._target = self._commanded = np.array(position, dtype=float)
        self._velocity = np.zeros(7)  # [rad/s] of the target
        self._stamp = -np.inf  # [s] of the last command
        self._since = 0  # cycles since it
        self._interval = 0  # cycles between the last two; 0: a step
        self._braking = False

    def command(self, position: np.ndarray, stamp: float) -> None:
        """Takes a command.

        Args:
            position: where to go (7) [rad], inside the limits.
            stamp: the sender's time [s].
        """
        position = np.clip(position, self._limits.lower, self._limits.upper)
        interval = stamp - self._stamp
        streaming = 0.0 < interval <= _STREAM
        velocity = (position - self._commanded) / interval if streaming else np.zeros(7)
        # What the joint cannot do is a jump of the command, and no motion to keep up with.
        self._velocity = np.where(np.abs(velocity) < self._limits.velocity, velocity, 0.0)
        self._interval = max(1, round(interval / PERIOD)) if streaming else 0
        self._target = self._current_target()
        self._commanded, self._stamp, self._since = position, stamp, 0

    def follow(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> bool:
        """Goes on from the robot's desired motion, if that is none of the positions that `step` last returned.

        Args:
            position: the robot's desired position (7) [rad].
            velocity: its velocity (7) [rad/s].
            acceleration: its acceleration (7) [rad/s^2].

        Returns:
            Whether it had to.
        """
        if any(np.abs(position - sent).max() < _SAME for sent in self._sent):
            return False
        velocity = np.clip(velocity, -self._limits.velocity, self._limits.velocity)
        acceleration = np.clip(acceleration, -self._limits.acceleration, self._limits.acceleration)
        # The parabola whose moving average has this position, velocity and acceleration now.
        times = PERIOD * np.arange(len(_WEIGHTS))[:, None]  # [s]
        times -= _WEIGHTS @ times
        parabola = velocity * times + acceleration * (times**2 - _WEIGHTS @ times**2) / 2.0
        self._recent = position + parabola
        self._input.current_position = self._recent[-1]
        self._input.current_velocity = velocity + acceleration * times[-1]
        self._input.current_acceleration = acceleration
        return True

    def brake(self) -> None:
        """From now on stops as fast as the limits allow, whatever was commanded."""
        self._braking = True
        self._input.control_interface = ControlInterface.Velocity
        self._input.target_velocity = np.zeros(7)

    def at_rest(self) -> bool:
        """Returns whether it stands still."""
        return bool(np.all(np.ptp(self._recent, axis=0) < 1e-9))

    def step(self, cycles: int = 1) -> np.ndarray:
        """Returns the position (7) [rad] of the next cycle.

        Args:
            cycles: how many have passed since the last step; more than one if some were lost.
        """
        limits, request = self._limits, self._input
        self._since += cycles
        if not self._braking:
            velocity = np.zeros(7)
            if self._since <= _PATIENCE * self._interval:
                velocity = self._velocity
            lead = velocity * (np.abs(velocity) / limits.acceleration + limits.acceleration / limits.jerk) / 2.0
            target = self._current_target()
            # A robot that starts outside the limits is held there.
            lower, upper = np.minimum(limits.lower, target), np.maximum(limits.upper, target)
            request.target_position = np.clip(target + lead, lower, upper)
            request.min_velocity, request.max_velocity = limits.velocity_bounds(
                np.array(request.current_position), np.array(request.current_velocity)
            )
        result = self._ruckig.update(request, self._output)
        if result not in (Result.Working, Result.Finished):
            raise RuntimeError(f"ruckig cannot go on: {result}")
        self._output.pass_to_input(request)
        self._recent = np.vstack((self._recent[1:], self._output.new_position))
        position = _WEIGHTS @ self._recent
        self._sent.append(position)
        return position

    def _current_target(self) -> np.ndarray:
        share = self._since / self._interval if self._interval else 1.0
        return self._commanded if share >= 1.0 else self._target + share * (self._commanded - self._target)
