"""Components: their names and tags, and what each action is about."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations.components import component_index, components, flat
from pace_drake.stations.tags import TAGS, tags_of
from pace_drake.stations.workcell import Pose, Workcell
from pace_drake.task import ActionKind


def test_names_in_order():
    cubes = ("cube_1", "cube_2", "cube_3", "cube_4")
    names = [component.name for component in components(Workcell())]
    assert names == [*cubes, "chair_side", "allen_key_1", "allen_key_2"]


@pytest.mark.parametrize(
    ("kind", "index", "component"),
    [
        (ActionKind.ROBOT_TASK, 1, "cube_1"),
        (ActionKind.ROBOT_TASK, 6, "cube_2"),
        (ActionKind.PREPARE, 1, "chair_side"),
        (ActionKind.PREPARE, 2, "allen_key_1"),
        (ActionKind.PREPARE, 4, "allen_key_1"),
        (ActionKind.JOINT, 1, None),
        (ActionKind.HOLD, 1, None),
        (ActionKind.NONE, 0, None),
    ],
)
def test_what_an_action_looks_for(kind, index, component):
    number = component_index(Workcell(), kind, index)
    assert (None if number is None else components(Workcell())[number].name) == component


def test_cubes_and_keys_are_taken_cyclically_whatever_their_number():
    workcell = replace(Workcell(), cubes=[Pose()] * 3, allen_keys=[Pose()])
    tasks = [component_index(workcell, ActionKind.ROBOT_TASK, i) for i in range(1, 8)]
    assert tasks == [0, 1, 2, 0, 1, 2, 0]
    assert [component_index(workcell, ActionKind.PREPARE, i) for i in range(1, 5)] == [3, 4, 4, 4]


@pytest.mark.parametrize("yaw", [-3.0, -pi / 2, 0.0, 0.4, 2.9])
def test_pose_and_flat_are_inverse(yaw):
    for component in components(Workcell()):
        X_WO = component.pose(np.array([0.3, -0.2, yaw]))
        np.testing.assert_allclose(flat(X_WO), [0.3, -0.2, yaw], atol=1e-12)
        assert X_WO.translation()[2] == component.nominal.translation[2]
        np.testing.assert_allclose(X_WO.rotation().matrix()[:, 2], [0.0, 0.0, 1.0], atol=1e-12)  # it lies flat


def test_a_component_nominally_lies_in_the_middle_of_its_zone():
    for component in components(Workcell()):
        nominal = component.nominal.to_rigid_transform()
        assert component.pose(component.located).IsNearlyEqualTo(nominal, 1e-12)


def test_the_gripper_comes_from_above_and_closes_across_the_component():
    """Its fingers, which move along its y axis, meet the component where that is as wide as the grasp says."""
    for component in components(Workcell()):
        for yaw in component.grasp.yaws:
            R_OG = component.grasp.X_OG(yaw).rotation().matrix()
            np.testing.assert_allclose(R_OG[:, 2], [0.0, 0.0, -1.0], atol=1e-12)
            np.testing.assert_allclose(component.grasp.X_OG(yaw).translation(), component.grasp.p_OG)
            np.testing.assert_allclose(R_OG[:, 0], [np.cos(yaw), np.sin(yaw), 0.0], atol=1e-12)
    across = {"chair_side": [1.0, 0.0, 0.0], "allen_key": [0.0, 1.0, 0.0]}  # of the rail and of the handle
    for component in components(Workcell()):
        if component.model in across:
            (yaw,) = component.grasp.yaws
            closing = component.grasp.X_OG(yaw).rotation().matrix()[:, 1]
            assert abs(closing @ across[component.model]) == pytest.approx(1.0)
    assert len(components(Workcell())[0].grasp.yaws) == 4  # a cube looks the same from each side


def test_every_component_has_a_camera_of_the_workcell():
    assert {component.camera for component in components(Workcell())} <= set(Workcell().cameras)


def test_ids_are_unique_and_have_a_picture():
    ids = [tag.id for tags in TAGS.values() for tag in tags]
    assert len(set(ids)) == len(ids)
    assert all(resource_path(f"models/tags/tag36h11_{number:02d}.png") for number in ids)


def test_labels_do_not_overlap_where_the_chair_side_is_gripped():
    for tag in TAGS["chair_side"]:
        assert abs(tag.p_OT[1]) - 1.25 * tag.size / 2 > 0.04


def test_more_cubes_than_tags_are_refused_by_name():
    many = replace(Workcell(), cubes=[Pose()] * 9)
    with pytest.raises(InputError, match="cube_9: carries no tag"):
        tags_of(component.name for component in components(many))
