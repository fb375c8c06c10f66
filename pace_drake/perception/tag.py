"""One AprilTag on a component."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Tag:
    """An AprilTag of the family 36h11 that lies on a component O, facing along the component's +z."""

    id: int
    p_OT: tuple[float, float, float]
    """[m] the tag's centre in the component's frame."""
    size: float
    """[m] edge of the black square; the white margin around it is one cell, an eighth of it, wide."""
    yaw: float = 0.0
    """[rad] of the printed tag about the component's z; at 0 its upper edge lies towards +y."""

    def corners(self) -> np.ndarray:
        """p_OQ (4, 3) [m] of the black square's corners, in OpenCV's order: clockwise from the printed upper left."""
        h = self.size / 2
        p_TQ = np.array([[-h, h], [h, h], [h, -h], [-h, -h]])
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.asarray(self.p_OT) + np.column_stack([p_TQ @ np.array([[c, s], [-s, c]]), np.zeros(4)])
