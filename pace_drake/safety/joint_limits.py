"""What the joints of the arms may do, as their makers publish it."""

from dataclasses import dataclass

import numpy as np

NUM_JOINTS = 7


@dataclass(frozen=True)
class JointLimits:
    """Limits of an arm's seven joints, each (7)."""

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


def _limits(lower: list, upper: list, velocity: list, acceleration: list, jerk: list) -> JointLimits:
    return JointLimits(*(np.array(values, dtype=float) for values in (lower, upper, velocity, acceleration, jerk)))


#: By the name of the arm: FER is the Franka Emika Robot, the Panda; both from the FCI documentation ("Robot and
#: interface specifications"). The FR3's velocity limits fall towards its position limits; these are the largest, and
#: its driver keeps the rest.
JOINT_LIMITS = {
    "fer": _limits(
        [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
        [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
        [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61],
        [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
        [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0],
    ),
    "fr3": _limits(
        [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159],
        [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159],
        [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26],
        [10.0] * 7,
        [5000.0] * 7,
    ),
}
