"""TruePoses: the plant's poses, in order, and never old."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import BodyIndex

from pace_drake.systems.true_poses import TruePoses


@pytest.fixture(scope="module")
def dut():
    return TruePoses([BodyIndex(2), BodyIndex(0)])


def test_poses_of_the_chosen_bodies_in_order(dut):
    context = dut.CreateDefaultContext()
    X_WB = [RigidTransform(RollPitchYaw(0, 0, np.pi), [1, 2, 3]), RigidTransform(), RigidTransform([4, 5, 6])]
    dut.GetInputPort("body_poses").FixValue(context, Value[list[RigidTransform]](X_WB))
    poses = dut.GetOutputPort("component_poses").Eval(context).reshape(2, 7)
    np.testing.assert_allclose(poses, [[1, 0, 0, 0, 4, 5, 6], [0, 0, 0, 1, 1, 2, 3]], atol=1e-15)
    context.SetTime(7.0)
    np.testing.assert_equal(dut.GetOutputPort("component_ages").Eval(context), [0.0, 0.0])
