"""UprightPose: as Drake writes poses, and fitted to points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pace_drake.perception import UprightPose
from pace_drake.perception.upright_pose import fit_upright_pose


def test_the_quaternion_turns_as_the_pose_does():
    pose = UprightPose(np.array([1.0, 2.0, 3.0]), 2.4)
    points = np.random.default_rng(0).normal(size=(5, 3))
    w, x, y, z, *p = pose.wxyz_xyz()
    np.testing.assert_allclose(pose.to_world(points), Rotation.from_quat([x, y, z, w]).apply(points) + p)


@pytest.mark.parametrize("yaw", [-3.1, -1.0, 0.0, 0.7, 3.1])
def test_exact_points_give_the_exact_pose(yaw):
    rng = np.random.default_rng(1)
    truth, points = UprightPose(rng.normal(size=3), yaw), rng.normal(size=(8, 3))
    pose, residual = fit_upright_pose(points, truth.to_world(points), rng.uniform(1, 2, 8))
    np.testing.assert_allclose(pose.p_WO, truth.p_WO, atol=1e-12)
    assert pose.yaw == pytest.approx(yaw, abs=1e-12)
    assert residual == pytest.approx(0.0, abs=1e-12)


def test_no_other_pose_is_nearer_to_noisy_points():
    rng = np.random.default_rng(2)
    points, weights = rng.normal(size=(8, 3)), rng.uniform(1, 5, 8)
    measured = UprightPose(rng.normal(size=3), 0.5).to_world(points) + 0.1 * rng.normal(size=(8, 3))
    pose, residual = fit_upright_pose(points, measured, weights)

    def distance(pose):
        return np.sqrt(weights @ np.sum((pose.to_world(points) - measured) ** 2, axis=1) / weights.sum())

    assert residual == pytest.approx(distance(pose))
    for _ in range(50):
        other = UprightPose(pose.p_WO + 0.02 * rng.normal(size=3), pose.yaw + 0.02 * rng.normal())
        assert distance(other) > residual
