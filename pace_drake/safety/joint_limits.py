"""What the joints of the arms may do, as their makers publish it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

NUM_JOINTS = 7


@dataclass(frozen=True)
class JointLimits:
    """Limits of an arm's seven joints, as the robot itself enforces them; each (7).

    The largest velocity towards a position limit q_max is min(velocity, sqrt(2 deceleration (q_max - q)) - offset), and
    likewise at the lower one. That is the FR3's own rule; the FER has none.
    """

    lower: np.ndarray
    """[rad]"""
    upper: np.ndarray
    """[rad]"""
    velocity: np.ndarray
    """[rad/s]"""
    acceleration: np.ndarray
    """[rad/s^2]"""
    jerk: np.ndarray
    """[rad/s^3]"""
    velocity_offset: np.ndarray
    """[rad/s]"""
    deceleration: np.ndarray
    """[rad/s^2]"""

    def beyond(self, position: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """[rad] how far positions (..., 7) [rad] are beyond their limits less a margin [rad]; inside, negative."""
        return np.maximum(self.lower + margin - position, position - self.upper + margin)


def _limits(*rows: Sequence[float]) -> JointLimits:
    return JointLimits(*(np.array(row, dtype=float) for row in rows))


#: FER: Franka's documentation of the Panda ("Robot and interface specifications"), as in ``models/panda.urdf``.
#: FR3: its URDF (``limit`` and ``position_based_velocity_limits``), read as franka-sim 1.1.7 repeats it with the source
#: (``franka_sim/limits/tables.py``).
JOINT_LIMITS = {
    "fer": _limits(
        (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
        (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
        (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
        (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
        (0.0,) * 7,
        (np.inf,) * 7,
    ),
    "fr3": _limits(
        (-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
        (2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
        (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
        (10.0,) * 7,
        (5000.0,) * 7,
        (0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35),
        (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0),
    ),
}
