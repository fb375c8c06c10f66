"""Components found in a colour and a depth picture by the AprilTags on them."""

from collections.abc import Mapping, Sequence

import numpy as np

from pace_drake.perception.camera import PinholeCamera
from pace_drake.perception.opencv import import_opencv
from pace_drake.perception.tag import Tag
from pace_drake.perception.upright_pose import UprightPose, fit_upright_pose

_MIN_DEPTH_SHARE = 0.5  # of a tag's pixels that must have a depth for it to be used
_INNER = 0.9  # share of a tag's edge within which depth is taken, away from the edges of what it lies on
_MAX_RESIDUAL = 0.01  # [m] rms; tags that fit their component worse are misread, or not on it


class ComponentDetector:
    """Finds the poses of components that lie or stand upright.

    Corners of tags come from OpenCV's AprilTag detector and refinement. Depth says where the tag's plane is: the plane
    is fitted to the depths inside the tag, and the corners' rays are cut with it. Where depth is missing, the corners
    are those of the pose from IPPE for squares (Collins and Bartoli 2014), of whose two solutions the more upright one
    holds. All corners of all tags of a component, weighted by their tag's area in the picture, give one position and
    yaw. A tag whose plane is tilted more than ``max_tilt`` is not used: its component is held, or has fallen over.

    Args:
        tags: of each component, by name; ids are unique.
        max_tilt: [rad] of a tag's plane out of the horizontal, as depth has it.

    Raises:
        InputError: OpenCV is not installed.
        ValueError: two tags have the same id.
    """

    def __init__(self, tags: Mapping[str, Sequence[Tag]], max_tilt: float = 0.25) -> None:
        self._cv2 = import_opencv()
        self._tags = {name: tuple(of) for name, of in tags.items()}
        ids = [tag.id for of in self._tags.values() for tag in of]
        if len(set(ids)) < len(ids):
            raise ValueError(f"every tag needs an id of its own, are {sorted(ids)}")
        self._min_up = np.cos(max_tilt)
        aruco = self._cv2.aruco
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = aruco.CORNER_REFINE_APRILTAG
        # Cells of 2 to 4 pixels in a noisy picture: sampled finely and away from their edges, and no edge is sought in
        # noise, which takes five times as long.
        parameters.perspectiveRemovePixelPerCell = 8
        parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
        parameters.aprilTagMinWhiteBlackDiff = 20
        self._detector = aruco.ArucoDetector(aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11), parameters)

    def find_tags(self, color: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Ids and corners (4, 2) [px] of all tags in a picture.

        Args:
            color: (height, width, 3 or 4) uint8, red green blue.
        """
        cv2 = self._cv2
        gray = cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGB2GRAY)
        corners, ids, _ = self._detector.detectMarkers(gray)
        if ids is None:
            return []
        found = [
            (int(number), np.asarray(quad, dtype=float)[0]) for number, quad in zip(ids.ravel(), corners, strict=True)
        ]
        return sorted(found, key=lambda tag: (tag[0], *tag[1].ravel()))

    def detect(self, color: np.ndarray, depth: np.ndarray | None, camera: PinholeCamera) -> dict[str, UprightPose]:
        """Poses of the components that are seen; one that is not in the result was not seen.

        Args:
            color: (height, width, 3 or 4) uint8, red green blue.
            depth: (height, width) [m] along the camera's z axis, covering ``color``; not finite or 0 where unknown.
                None: there is no depth at all.
            camera: that took both.
        """
        found = self.find_tags(color)
        poses = {}
        for name, tags in self._tags.items():
            p_OQ, p_WQ, weights = [], [], []
            for tag in tags:
                for number, corners in found:
                    if number != tag.id:
                        continue
                    measured = self._corners_in_world(tag, corners, depth, camera)
                    if measured is not None:
                        p_OQ.append(tag.corners())
                        p_WQ.append(measured)
                        weights.append(np.full(4, _area(corners)))
            if p_OQ:
                pose, residual = fit_upright_pose(np.vstack(p_OQ), np.vstack(p_WQ), np.concatenate(weights))
                if residual <= _MAX_RESIDUAL:
                    poses[name] = pose
        return poses

    def _corners_in_world(
        self, tag: Tag, corners: np.ndarray, depth: np.ndarray | None, camera: PinholeCamera
    ) -> np.ndarray | None:
        """p_WQ (4, 3) [m] of the corners; None if the tag does not face up."""
        plane = None if depth is None else self._plane(corners, depth, camera)
        if plane is None:
            return camera.to_world(self._corners_by_ippe(tag, corners, camera))
        # The plane's normal points away from the camera, so down.
        up = -(camera.X_WC[2, :3] @ plane) / np.linalg.norm(plane)
        if up < self._min_up:
            return None
        rays = camera.rays(corners)
        return camera.to_world(rays / (rays @ plane)[:, None])

    def _plane(self, corners: np.ndarray, depth: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
        """n (3) [1/m] of the plane n . p_C = 1 through the tag; None if too few of its pixels have a depth."""
        centre = corners.mean(axis=0)
        inner = centre + _INNER * (corners - centre)
        low = np.maximum(np.floor(inner.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(inner.max(axis=0)).astype(int) + 1, depth.shape[1::-1])
        mask = np.zeros((high - low)[::-1], dtype=np.uint8)
        self._cv2.fillConvexPoly(mask, np.round(inner - low).astype(np.int32), 1)
        rows, columns = np.nonzero(mask)
        z = depth[rows + low[1], columns + low[0]]
        valid = np.isfinite(z) & (z > 0)
        if valid.sum() < max(_MIN_DEPTH_SHARE * len(z), 3):
            return None
        # On a plane the inverse depth is linear in the ray: 1 / z = n . ray.
        rays = camera.rays(np.column_stack([columns, rows])[valid] + low)
        return np.linalg.lstsq(rays, 1 / z[valid], rcond=None)[0]

    def _corners_by_ippe(self, tag: Tag, corners: np.ndarray, camera: PinholeCamera) -> np.ndarray:
        """p_CQ (4, 3) [m] of the more upright of the two poses that the picture allows."""
        cv2 = self._cv2
        h = tag.size / 2
        p_TQ = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            p_TQ, corners, camera.intrinsics, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        poses = [(cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(rotations, translations, strict=True)]
        R_CT, p_CT = max(poses, key=lambda pose: camera.X_WC[2, :3] @ pose[0][:, 2])
        return p_TQ @ R_CT.T + p_CT


def _area(corners: np.ndarray) -> float:
    """[px^2] of a quadrilateral (4, 2)."""
    a, b = corners[2] - corners[0], corners[3] - corners[1]
    return abs(float(a[0] * b[1] - a[1] * b[0])) / 2
