"""How much of what a robot's joints can do the driver uses."""

import dataclasses as dc

import numpy as np

from pace_drake.safety.joint_limits import JointLimits

_MARGIN = 0.02  # [rad] targets keep this far from the robot's position limits
_SHARE = 0.99  # of the robot's velocity, acceleration and jerk limits is used
_BRAKING_SHARE = 0.7  # of the acceleration limit is counted on for braking before a position limit
_VELOCITY_MARGIN = 0.05  # [rad/s] below the robot's own velocity limit near a position limit
_LOOKAHEAD = 0.004  # [s] how far ahead that limit is read: the velocity cannot follow it at once


@dc.dataclass(frozen=True)
class UsableLimits:
    """Limits inside those of the robot, each (7); see ``JointLimits``."""

    lower: np.ndarray  # [rad] of targets
    upper: np.ndarray  # [rad] of targets
    velocity: np.ndarray  # [rad/s]
    acceleration: np.ndarray  # [rad/s^2]
    jerk: np.ndarray  # [rad/s^3]
    velocity_offset: np.ndarray  # [rad/s]
    deceleration: np.ndarray  # [rad/s^2]
    margin: float  # [rad] from the limits of targets to those of the robot

    def velocity_bounds(self, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least and greatest velocity, each (7) [rad/s], at a position (7) [rad] passed at a velocity."""
        ahead = position + _LOOKAHEAD * velocity

        def towards(distance: np.ndarray) -> np.ndarray:
            root = np.sqrt(2.0 * self.deceleration * np.maximum(distance + self.margin, 0.0))
            # Never quite zero: ruckig wants a velocity to come back with.
            return np.clip(root - self.velocity_offset, 0.01, self.velocity)

        return -towards(ahead - self.lower), towards(self.upper - ahead)

    def outside(self, position: np.ndarray) -> str:
        """Returns which joint of a target (7) [rad] lies outside; empty if none does."""
        for joint, (q, lower, upper) in enumerate(zip(position, self.lower, self.upper, strict=True), start=1):
            if not lower <= q <= upper:
                return f"joint {joint} at {q:.4f} rad is outside {lower:.4f} to {upper:.4f} rad"
        return ""


def usable(limits: JointLimits) -> UsableLimits:
    """Returns what the driver uses of the robot's limits, a little less."""
    return UsableLimits(
        lower=limits.lower + _MARGIN,
        upper=limits.upper - _MARGIN,
        velocity=_SHARE * limits.velocity,
        acceleration=_SHARE * limits.acceleration,
        jerk=_SHARE * limits.jerk,
        velocity_offset=limits.velocity_offset + _VELOCITY_MARGIN,
        deceleration=np.minimum(limits.deceleration, _BRAKING_SHARE * limits.acceleration),
        margin=_MARGIN,
    )
