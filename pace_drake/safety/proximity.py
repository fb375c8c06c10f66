"""How near, and how fast, the parts of an arm come to a person's limbs: capsules, closed forms, compiled.

A part or limb is a capsule: a segment with a radius; a segment of no length is a sphere. All of it stands in one file,
because numba's cache does not notice that a function in another file has changed.
"""

from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
from numba import njit

#: Points of a part whose speed is looked at: its axis' ends, and the one nearest to the limb.
NUM_POINTS = 3


@dataclass(frozen=True)
class ArmCapsules:
    """An arm as revolute joints about the z axes of their frames, and capsules on its links."""

    joints: np.ndarray
    """(7, 3, 4) [-, m] pose of each joint's frame in the link before it, at joint position 0."""
    links: np.ndarray
    """(I,) link of each capsule; 0: the base, in the world frame."""
    segments: np.ndarray
    """(I, 2, 3) [m] ends of each capsule's axis in its link's frame."""
    radii: np.ndarray
    """(I,) [m]."""


@dataclass(frozen=True)
class Approach:
    """What ``approach`` finds: I parts, J limbs, K postures, ``NUM_POINTS`` points of a part."""

    distance: np.ndarray
    """(I, J) [m] between surfaces at the first posture; negative inside."""
    length: np.ndarray
    """(K, I, J) [m] between axes."""
    speed: np.ndarray
    """(K, I, J, NUM_POINTS) [m/s]."""
    towards: np.ndarray
    """(K, I, J, NUM_POINTS) [m/s] the part of it towards the limb."""


def approach(
    arm: ArmCapsules, positions: np.ndarray, velocities: np.ndarray, limbs: np.ndarray, limb_radii: np.ndarray
) -> Approach:
    """Returns distances now, and speeds at postures along the path ahead.

    Args:
        arm: its shape.
        positions: (K, 7) [rad] postures, the present one first.
        velocities: (K, 7) [rad/s] there.
        limbs: (J, 2, 3) [m] ends of the limbs' axes in world.
        limb_radii: (J,) [m].
    """
    return Approach(
        *_approach(arm.joints, arm.links, arm.segments, arm.radii, positions, velocities, limbs, limb_radii)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_points(a, b, c, d):
    """Returns (s, t) in [0, 1]: the nearest points of segments a-b and c-d are a + s (b - a) and c + t (d - c).

    C. Ericson, Real-Time Collision Detection, 2005, Sec. 5.1.9.
    """
    aa = bb = ab = ar = br = 0.0
    for x in range(3):
        u, v, r = b[x] - a[x], d[x] - c[x], a[x] - c[x]
        aa += u * u
        bb += v * v
        ab += u * v
        ar += u * r
        br += v * r
    if aa <= 1e-12 and bb <= 1e-12:
        return 0.0, 0.0
    if aa <= 1e-12:
        return 0.0, min(max(br / bb, 0.0), 1.0)
    if bb <= 1e-12:
        return min(max(-ar / aa, 0.0), 1.0), 0.0
    determinant = aa * bb - ab * ab
    s = min(max((ab * br - ar * bb) / determinant, 0.0), 1.0) if determinant > 1e-12 else 0.0
    t = (ab * s + br) / bb
    if t < 0.0:
        return min(max(-ar / aa, 0.0), 1.0), 0.0
    if t > 1.0:
        return min(max((ab - ar) / aa, 0.0), 1.0), 1.0
    return s, t


@njit(cache=True, nogil=True, error_model="numpy")
def _approach(joints, links, segments, radii, positions, velocities, limbs, limb_radii):
    num_postures, num_joints = positions.shape
    num_parts, num_limbs = len(radii), len(limb_radii)
    distance = np.empty((num_parts, num_limbs))
    length = np.empty((num_postures, num_parts, num_limbs))
    speed = np.empty((num_postures, num_parts, num_limbs, 3))
    towards = np.empty((num_postures, num_parts, num_limbs, 3))
    R, p = np.zeros((num_joints + 1, 3, 3)), np.zeros((num_joints + 1, 3))
    omega, v = np.zeros((num_joints + 1, 3)), np.zeros((num_joints + 1, 3))
    for x in range(3):
        R[0, x, x] = 1.0
    ends, points, rates = np.empty((2, 3)), np.empty((3, 3)), np.empty((3, 3))
    way, arm_ = np.empty(3), np.empty(3)
    for k in range(num_postures):
        for m in range(num_joints):
            cosine, sine, rate = cos(positions[k, m]), sin(positions[k, m]), velocities[k, m]
            for x in range(3):
                way[x] = 0.0
                for y in range(3):
                    way[x] += R[m, x, y] * joints[m, y, 3]
                first = second = third = 0.0
                for y in range(3):
                    first += R[m, x, y] * joints[m, y, 0]
                    second += R[m, x, y] * joints[m, y, 1]
                    third += R[m, x, y] * joints[m, y, 2]
                R[m + 1, x, 0] = first * cosine + second * sine
                R[m + 1, x, 1] = second * cosine - first * sine
                R[m + 1, x, 2] = third
                p[m + 1, x] = p[m, x] + way[x]
                omega[m + 1, x] = omega[m, x] + third * rate
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                v[m + 1, x] = v[m, x] + omega[m, y] * way[z] - omega[m, z] * way[y]
        for i in range(num_parts):
            link = links[i]
            for e in range(2):
                for x in range(3):
                    ends[e, x] = p[link, x]
                    for y in range(3):
                        ends[e, x] += R[link, x, y] * segments[i, e, y]
            for j in range(num_limbs):
                s, _ = nearest_points(ends[0], ends[1], limbs[j, 0], limbs[j, 1])
                for x in range(3):
                    points[0, x], points[1, x] = ends[0, x], ends[1, x]
                    points[2, x] = ends[0, x] + s * (ends[1, x] - ends[0, x])
                for e in range(3):
                    for x in range(3):
                        arm_[x] = points[e, x] - p[link, x]
                    for x in range(3):
                        y, z = (x + 1) % 3, (x + 2) % 3
                        rates[e, x] = v[link, x] + omega[link, y] * arm_[z] - omega[link, z] * arm_[y]
                    _, t = nearest_points(points[e], points[e], limbs[j, 0], limbs[j, 1])
                    square = gap = along = 0.0
                    for x in range(3):
                        to_limb = limbs[j, 0, x] + t * (limbs[j, 1, x] - limbs[j, 0, x]) - points[e, x]
                        gap += to_limb * to_limb
                        along += to_limb * rates[e, x]
                        square += rates[e, x] * rates[e, x]
                    gap, size = sqrt(gap), sqrt(square)
                    speed[k, i, j, e] = size
                    # Axes that touch have no direction between them: any motion may be towards.
                    towards[k, i, j, e] = along / gap if gap > 1e-9 else size
                    if e == 2:
                        length[k, i, j] = gap
                        if k == 0:
                            distance[i, j] = gap - radii[i] - limb_radii[j]
    return distance, length, speed, towards
