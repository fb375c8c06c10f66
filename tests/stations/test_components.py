"""Components: their names and tags, and what each action is about."""

from dataclasses import replace

import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations.components import component_index, components
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
