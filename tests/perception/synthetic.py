"""Pictures of tags without a renderer: warped by the camera's own formula, with the depth of the plane they lie in."""

import numpy as np

from pace_drake.perception import PinholeCamera, UprightPose
from pace_drake.resources import resource_path
from tests.rendering import require_opencv

WIDTH, HEIGHT, FOCAL_LENGTH = 960, 720, 1100.0  # [px]
_FINER = 3  # drawn this many times larger, then averaged


def camera_above(x: float = 0.0, y: float = 0.0, z: float = 0.8, tilt: float = 0.0) -> PinholeCamera:
    """Looks straight down, or tilted [rad] towards +y; the picture's x axis is the world's."""
    c, s = np.cos(tilt), np.sin(tilt)
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    X_WC[:3, 3] = x, y, z
    K = np.array([[FOCAL_LENGTH, 0, (WIDTH - 1) / 2], [0, FOCAL_LENGTH, (HEIGHT - 1) / 2], [0, 0, 1]])
    return PinholeCamera(K, X_WC)


def picture(camera, tags, poses, roll=0.0):
    """Colour and depth of components (name -> UprightPose) with tags (name -> tags), all in one plane.

    Args:
        camera: that takes it.
        tags: of the components.
        poses: of the components.
        roll: [rad] by which everything is turned about the world's x axis through the mean of the tags.
    """
    cv2 = require_opencv()
    color = np.full((HEIGHT * _FINER, WIDTH * _FINER), 190, dtype=np.uint8)
    c, s = np.cos(roll), np.sin(roll)
    corners_W = {tag.id: poses[name].to_world(tag.corners()) for name in poses for tag in tags[name]}
    pivot = np.vstack(list(corners_W.values())).mean(axis=0)
    R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    for number, corners in corners_W.items():
        centre = corners.mean(axis=0)
        with_margin = (centre + 1.25 * (corners - centre) - pivot) @ R.T + pivot
        pixels = camera.project(with_margin)
        tag = cv2.imread(str(resource_path(f"models/tags/tag36h11_{number:02d}.png")), cv2.IMREAD_GRAYSCALE)
        edge = tag.shape[0]
        # Pixel centres have integer coordinates: the outermost edges are half a pixel outside.
        source = np.array([[0, 0], [edge, 0], [edge, edge], [0, edge]], dtype=np.float32) - 0.5
        target = (_FINER * (pixels + 0.5) - 0.5).astype(np.float32)
        H = cv2.getPerspectiveTransform(source, target)
        size = color.shape[1::-1]
        warped = cv2.warpPerspective(tag, H, size, flags=cv2.INTER_LINEAR)
        mask = cv2.warpPerspective(np.full_like(tag, 255), H, size, flags=cv2.INTER_NEAREST) > 0
        color[mask] = warped[mask]
    small = color.reshape(HEIGHT, _FINER, WIDTH, _FINER).mean(axis=(1, 3)).round().astype(np.uint8)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()])) @ camera.X_WC[:3, :3].T
    normal = R @ [0.0, 0.0, 1.0]
    depth = (normal @ (pivot - camera.X_WC[:3, 3])) / (rays @ normal)
    return np.dstack([small] * 3), depth.reshape(HEIGHT, WIDTH).astype(np.float32)


def pose(x: float, y: float, z: float, yaw: float) -> UprightPose:
    return UprightPose(np.array([x, y, z]), yaw)
