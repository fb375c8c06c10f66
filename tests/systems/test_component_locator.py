"""ComponentLocator: when it looks, what it keeps, how old that is. Pictures are fixed values here."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from pace_drake.perception import UprightPose
from pace_drake.systems.component_locator import ComponentLocator, Wanted
from pace_drake.task import ActionKind
from tests.systems.forced import force_update

COMPONENTS = ("cube", "side", "key")


def wanted(kind, index):
    if kind == ActionKind.ROBOT_TASK:
        return Wanted("cube", "sorting_camera")
    if kind == ActionKind.PREPARE:
        return Wanted("side" if index == 1 else "key", "warehouse_camera")
    return None


class Scene:
    """What each camera would see; counts the looks."""

    def __init__(self):
        self.seen = {"sorting_camera": {}, "warehouse_camera": {}}
        self.looks = []

    def look(self, camera):
        def calc(color, depth):
            assert color.shape == (4, 6, 4)
            assert depth.shape == (4, 6)
            self.looks.append(camera)
            return self.seen[camera]

        return calc


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture(scope="module")
def dut(scene):
    looks = {camera: scene.look(camera) for camera in scene.seen}
    return ComponentLocator(COMPONENTS, looks, wanted, retry=0.5)


@pytest.fixture
def context(dut, scene):
    scene.seen = {"sorting_camera": {"cube": at(0.1)}, "warehouse_camera": {"side": at(0.2), "key": at(0.3)}}
    scene.looks.clear()
    context = dut.CreateDefaultContext()
    for camera in scene.seen:
        color, depth = Value(ImageRgba8U(6, 4)), Value(ImageDepth32F(6, 4))
        dut.GetInputPort(f"{camera}.color_image").FixValue(context, color)
        dut.GetInputPort(f"{camera}.depth_image").FixValue(context, depth)
    return context


def at(x, yaw=0.0):
    return UprightPose(np.array([x, 0.0, 0.0]), yaw)


def command(dut, context, time, kind, index, sequence):
    context.SetTime(time)
    dut.GetInputPort("robot_action").FixValue(context, [kind, index, sequence])
    force_update(dut, context)


def ages(dut, context, time):
    context.SetTime(time)
    return dut.GetOutputPort("component_ages").Eval(context).tolist()


def poses(dut, context):
    return dut.GetOutputPort("component_poses").Eval(context).reshape(-1, 7)


def next_look(dut, context):
    return dut.GetOutputPort("next_event_time").Eval(context)[0]


def test_before_the_first_look_nothing_was_ever_seen(dut, context, scene):
    command(dut, context, 3.0, ActionKind.NONE, 0, 0)
    assert ages(dut, context, 3.0) == [np.inf] * 3
    np.testing.assert_equal(poses(dut, context), [[1, 0, 0, 0, 0, 0, 0]] * 3)
    assert next_look(dut, context) == np.inf
    assert scene.looks == []


def test_a_new_command_looks_once_with_the_camera_of_its_table(dut, context, scene):
    command(dut, context, 1.0, ActionKind.ROBOT_TASK, 1, 1)
    command(dut, context, 2.0, ActionKind.ROBOT_TASK, 1, 1)
    command(dut, context, 3.0, ActionKind.PREPARE, 1, 2)
    command(dut, context, 4.0, ActionKind.JOINT, 1, 3)
    command(dut, context, 5.0, ActionKind.HOME, 1, 4)
    command(dut, context, 6.0, ActionKind.ROBOT_TASK, 1, 5)
    assert scene.looks == ["sorting_camera", "warehouse_camera", "sorting_camera"]
    assert ages(dut, context, 7.0) == [1.0, 4.0, 4.0]
    assert next_look(dut, context) == np.inf


def test_all_that_a_picture_shows_is_taken(dut, context, scene):
    scene.seen["warehouse_camera"] = {"side": at(0.2, np.pi), "key": at(0.3)}
    command(dut, context, 1.0, ActionKind.PREPARE, 1, 1)
    assert ages(dut, context, 1.0) == [np.inf, 0.0, 0.0]
    np.testing.assert_allclose(poses(dut, context)[1], [0, 0, 0, 1, 0.2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(poses(dut, context)[2], [1, 0, 0, 0, 0.3, 0, 0])


def test_what_is_hidden_keeps_its_pose_and_grows_older(dut, context, scene):
    command(dut, context, 1.0, ActionKind.PREPARE, 1, 1)
    scene.seen["warehouse_camera"] = {"key": at(0.4)}  # the key was moved, the side is hidden
    command(dut, context, 5.0, ActionKind.PREPARE, 1, 2)
    assert ages(dut, context, 5.0) == [np.inf, 4.0, 0.0]
    assert poses(dut, context)[1, 4] == 0.2
    assert poses(dut, context)[2, 4] == 0.4


def test_it_looks_again_until_the_wanted_component_is_seen(dut, context, scene):
    scene.seen["sorting_camera"] = {}
    command(dut, context, 1.0, ActionKind.ROBOT_TASK, 1, 1)
    assert next_look(dut, context) == 1.5
    command(dut, context, 1.4, ActionKind.ROBOT_TASK, 1, 1)  # another event: it is not yet time
    assert len(scene.looks) == 1
    command(dut, context, 1.5, ActionKind.ROBOT_TASK, 1, 1)
    assert len(scene.looks) == 2
    assert next_look(dut, context) == 2.0
    scene.seen["sorting_camera"] = {"cube": at(0.6)}
    command(dut, context, 2.0, ActionKind.ROBOT_TASK, 1, 1)
    assert len(scene.looks) == 3
    assert next_look(dut, context) == np.inf
    assert ages(dut, context, 2.0)[0] == 0.0


@pytest.mark.parametrize("kind", [ActionKind.HOLD, ActionKind.HOME_ABORTED])
def test_it_gives_up_when_the_command_changes(dut, context, scene, kind):
    scene.seen["warehouse_camera"] = {}
    command(dut, context, 1.0, ActionKind.PREPARE, 1, 1)
    command(dut, context, 1.2, kind, 1, 1)
    assert next_look(dut, context) == np.inf
    command(dut, context, 9.0, ActionKind.PREPARE, 1, 2)
    assert len(scene.looks) == 2


def test_a_copied_context_goes_on_alone(dut, context, scene):
    command(dut, context, 1.0, ActionKind.ROBOT_TASK, 1, 1)
    copy = context.Clone()
    scene.seen["sorting_camera"] = {"cube": at(0.7)}
    command(dut, copy, 2.0, ActionKind.ROBOT_TASK, 1, 2)
    assert poses(dut, context)[0, 4] == 0.1
    assert poses(dut, copy)[0, 4] == 0.7
