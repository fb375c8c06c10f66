"""What must be known of a camera to measure with it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PinholeCamera:
    """A camera C without distortion whose colour and depth pictures cover each other; z forward, x right, y down."""

    intrinsics: np.ndarray
    """(3, 3) [px] matrix K; pixel centres have integer coordinates."""
    X_WC: np.ndarray
    """(4, 4) pose in the world frame."""

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Directions (n, 3) in C with z = 1 through pixels (n, 2)."""
        K = self.intrinsics
        return np.column_stack([(pixels - K[:2, 2]) / [K[0, 0], K[1, 1]], np.ones(len(pixels))])

    def to_world(self, p_C: np.ndarray) -> np.ndarray:
        """Points (n, 3) [m] in the world frame."""
        return p_C @ self.X_WC[:3, :3].T + self.X_WC[:3, 3]

    def project(self, p_W: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of points (n, 3) [m] in the world frame."""
        p_C = (p_W - self.X_WC[:3, 3]) @ self.X_WC[:3, :3]
        homogeneous = p_C @ self.intrinsics.T
        return homogeneous[:, :2] / homogeneous[:, 2:]
