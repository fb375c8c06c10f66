"""The station's cameras: they see the tags where they are, and render only when asked."""

import numpy as np
import pytest

from pace_drake.perception import ComponentDetector
from pace_drake.stations.camera import pinhole_camera
from pace_drake.stations.components import components
from pace_drake.stations.plant import make_plant_station
from pace_drake.stations.tags import tags_of
from pace_drake.stations.workcell import Workcell
from tests.rendering import require_opencv, require_rendering


@pytest.fixture(scope="module")
def station():
    require_rendering()
    return make_plant_station(Workcell(), cameras=True)


@pytest.fixture
def context(station):
    context = station.CreateDefaultContext()
    station.GetInputPort("panda.position").FixValue(context, Workcell().home)
    station.GetInputPort("gripper.position").FixValue(context, [Workcell().gripper_open])
    station.GetInputPort("p_WH").FixValue(context, [0.9, 0.0, 0.15])
    return context


def pictures(station, context, camera):
    color, depth = (
        station.GetOutputPort(f"{camera}.{kind}").Eval(context).data for kind in ("color_image", "depth_image")
    )
    return color, depth[:, :, 0]


def test_depth_is_measured_from_the_camera(station, context):
    for name, camera in Workcell().cameras.items():
        color, depth = pictures(station, context, name)
        assert color.shape == (camera.height, camera.width, 4)
        p_WC = np.array(camera.pose.translation)
        # A place on each table on which nothing lies.
        free = {"sorting_camera": [0.50, -0.75, 0.0], "warehouse_camera": [0.5, 0.5, 0.0]}.get(name, [0.63, 0.35, 0.0])
        u, v = np.rint(pinhole_camera(camera).project(np.array([free]))[0]).astype(int)
        assert depth[v, u] == pytest.approx(p_WC[2], abs=2e-4)


def test_components_are_found_where_the_plant_has_them(station, context):
    require_opencv()
    workcell = Workcell()
    names = [component.name for component in components(workcell)]
    detector = ComponentDetector(tags_of(names))
    found = {}
    for name, camera in workcell.cameras.items():
        found |= detector.detect(*pictures(station, context, name), pinhole_camera(camera))
    assert set(found) == set(names)
    for k, name in enumerate(names):
        X_WO = station.component_pose(context, k)
        np.testing.assert_allclose(found[name].p_WO, X_WO.translation(), atol=1e-3)
        expected = X_WO.rotation().matrix() @ [1.0, 0.0, 0.0]
        np.testing.assert_allclose(
            [np.cos(found[name].yaw), np.sin(found[name].yaw)], expected[:2], atol=np.radians(2.0)
        )


def test_labels_have_the_size_and_place_of_the_table(station, context):
    require_opencv()
    camera = pinhole_camera(Workcell().cameras["sorting_camera"])
    tags = tags_of(["cube_1", "cube_2", "cube_3", "cube_4"])
    found = dict(ComponentDetector(tags).find_tags(pictures(station, context, "sorting_camera")[0]))
    for cube, (tag,) in zip(Workcell().cubes, tags.values(), strict=True):
        expected = camera.project(tag.corners() + cube.translation)
        np.testing.assert_allclose(found[tag.id], expected, atol=1.0)


def test_a_cube_that_moved_is_seen_where_it_is_now(station, context):
    """The cameras' own scene follows the plant."""
    require_opencv()
    plant = station.GetSubsystemByName("plant")
    body = plant.GetBodyByName("cube", plant.GetModelInstanceByName("cube_1"))
    plant_context = plant.GetMyMutableContextFromRoot(context)
    X_WO = plant.EvalBodyPoseInWorld(plant_context, body)
    X_WO.set_translation(X_WO.translation() - [0.08, 0.0, 0.0])
    camera = Workcell().cameras["sorting_camera"]
    detector = ComponentDetector(tags_of(["cube_1"]))
    pictures(station, context, "sorting_camera")  # before it moves
    plant.SetFreeBodyPose(plant_context, body, X_WO)
    found = detector.detect(*pictures(station, context, "sorting_camera"), pinhole_camera(camera))
    np.testing.assert_allclose(found["cube_1"].p_WO, X_WO.translation(), atol=1e-3)


def test_nothing_is_rendered_in_the_scene_that_every_step_updates(station):
    """A renderer there would triple the time of a step."""
    assert station.GetSubsystemByName("scene_graph").RendererCount() == 0
    assert station.GetSubsystemByName("seen_scene").RendererCount() == 1


def test_a_disabled_camera_is_not_there():
    require_rendering()
    workcell = Workcell()
    workcell.cameras["assembly_camera"].enabled = False
    station = make_plant_station(workcell, cameras=True)
    assert not station.HasOutputPort("assembly_camera.color_image")
    assert station.HasOutputPort("sorting_camera.color_image")
