"""What the joints of the two robots can do."""

import dataclasses as dc

import numpy as np

from pace_drake.errors import InputError

_MARGIN = 0.02  # [rad] targets keep this far from the robot's position limits
_SHARE = 0.99  # of the robot's velocity, acceleration and jerk limits is used
_BRAKING_SHARE = 0.7  # of the acceleration limit is counted on for braking before a position limit
_VELOCITY_MARGIN = 0.05  # [rad/s] below the robot's own velocity limit near a position limit
_LOOKAHEAD = 0.004  # [s] how far ahead that limit is read: the velocity cannot follow it at once


@dc.dataclass(frozen=True)
class JointLimits:
    """Limits of the seven joints, as the robot itself enforces them; each field is a sequence of 7.

    The largest velocity towards a position limit q_max is min(velocity, sqrt(2 deceleration (q_max - q)) - offset), and
    likewise at the lower one. That is the FR3's own rule. The FER has none: for it, it merely is what can be braked.
    """

    lower: tuple[float, ...]  # [rad]
    upper: tuple[float, ...]  # [rad]
    velocity: tuple[float, ...]  # [rad/s]
    acceleration: tuple[float, ...]  # [rad/s^2]
    jerk: tuple[float, ...]  # [rad/s^3]
    velocity_offset: tuple[float, ...] = (0.0,) * 7  # [rad/s]
    deceleration: tuple[float, ...] = (np.inf,) * 7  # [rad/s^2]

    def usable(self) -> "UsableLimits":
        """Returns what the driver uses of them, a little less."""
        return UsableLimits(
            lower=np.array(self.lower) + _MARGIN,
            upper=np.array(self.upper) - _MARGIN,
            velocity=_SHARE * np.array(self.velocity),
            acceleration=_SHARE * np.array(self.acceleration),
            jerk=_SHARE * np.array(self.jerk),
            velocity_offset=np.array(self.velocity_offset) + _VELOCITY_MARGIN,
            deceleration=np.minimum(self.deceleration, _BRAKING_SHARE * np.array(self.acceleration)),
            margin=_MARGIN,
        )


@dc.dataclass(frozen=True)
class UsableLimits:
    """Limits inside those of the robot, each (7); see `JointLimits`."""

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


#: Franka's documentation of the Panda ("Robot and interface specifications", FER) and libfranka 0.9
#: ``rate_limiting.h`` (kMaxJointVelocity, -Acceleration, -Jerk).
FER = JointLimits(
    lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    velocity=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    acceleration=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    jerk=(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
)
#: The FR3's URDF (``limit`` and ``position_based_velocity_limits``), the same as libfranka 0.21 ``rate_limiting.h``;
#: both read as they are repeated, with the source, in franka-sim 1.1.7 (``franka_sim/limits/tables.py``).
FR3 = JointLimits(
    lower=(-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
    upper=(2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
    velocity=(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    acceleration=(10.0,) * 7,
    jerk=(5000.0,) * 7,
    velocity_offset=(0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35),
    deceleration=(6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0),
)


def limits_of(robot: str) -> JointLimits:
    """Returns the limits of ``fr3`` or ``fer``.

    Raises:
        InputError: there is no such robot.
    """
    known = {"fr3": FR3, "fer": FER}
    if robot not in known:
        raise InputError(f"robot {robot!r} is unknown: choose {' or '.join(known)}")
    return known[robot]
