"""The pose of something that stands or lies as it should: a position and a yaw."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class UprightPose:
    """X_WO of a component O whose z axis is the world's."""

    p_WO: np.ndarray
    """(3,) [m]."""
    yaw: float
    """[rad] in (-pi, pi]."""

    def wxyz_xyz(self) -> np.ndarray:
        """(7,) quaternion qw qx qy qz [-], then x y z [m], as Drake orders a floating body's positions."""
        return np.array([np.cos(self.yaw / 2), 0.0, 0.0, np.sin(self.yaw / 2), *self.p_WO])

    def to_world(self, p_O: np.ndarray) -> np.ndarray:
        """Points (n, 3) [m] of the component in the world frame."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return p_O @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + self.p_WO


def fit_upright_pose(p_OQ: np.ndarray, p_WQ: np.ndarray, weights: np.ndarray) -> tuple[UprightPose, float]:
    """The pose that brings points of a component nearest to where they were measured, in weighted least squares.

    Args:
        p_OQ: (n, 3) [m] the points in the component's frame, n >= 2.
        p_WQ: (n, 3) [m] the same points, measured.
        weights: (n,) > 0.

    Returns:
        The pose, and the points' root mean square distance [m] from it.
    """
    w = weights / weights.sum()
    mean_O, mean_W = w @ p_OQ, w @ p_WQ
    o, m = p_OQ - mean_O, p_WQ - mean_W
    # Rotation about z alone has this closed form.
    yaw = float(np.arctan2(w @ (o[:, 0] * m[:, 1] - o[:, 1] * m[:, 0]), w @ (o[:, 0] * m[:, 0] + o[:, 1] * m[:, 1])))
    turned = UprightPose(np.zeros(3), yaw)
    pose = UprightPose(mean_W - turned.to_world(mean_O[None])[0], yaw)
    residual = np.linalg.norm(pose.to_world(p_OQ) - p_WQ, axis=1)
    return pose, float(np.sqrt(w @ residual**2))
