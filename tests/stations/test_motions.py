"""Planned motions: they join up, stay within limits, keep clear, and come out the same every time."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_typed
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pace_drake.errors import InputError
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import add_workcell
from pace_drake.stations.workcell import Pose, Presentation, Workcell
from pace_drake.task import ActionKind

NUM_ROBOT_TASKS, NUM_JOINT_ACTIONS = 5, 4  # one more than the cubes, one more than the presentations


@pytest.fixture(scope="module")
def library():
    return plan_motions(Workcell(), NUM_ROBOT_TASKS, NUM_JOINT_ACTIONS)


@pytest.fixture(scope="module")
def scene():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    add_workcell(plant, scene_graph, Workcell(), free_cubes=False)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    return diagram, plant, plant.GetMyMutableContextFromRoot(context)


def gripper_pose(scene, q: np.ndarray, width: float = 0.07) -> RigidTransform:
    _, plant, context = scene
    plant.SetPositions(context, np.concatenate([q, [width / 2, width / 2]]))
    return plant.GetFrameByName("panda_hand_tcp").CalcPoseInWorld(context)


def test_every_action_has_a_motion(library):
    expected = {(ActionKind.ROBOT_TASK, i) for i in range(1, NUM_ROBOT_TASKS + 1)}
    for kind in (ActionKind.PREPARE, ActionKind.JOINT, ActionKind.HOME, ActionKind.HOME_ABORTED):
        expected |= {(kind, index) for index in range(1, NUM_JOINT_ACTIONS + 1)}
    assert set(library) == expected
    assert len(library) == len(expected)
    with pytest.raises(KeyError):
        library.position(ActionKind.ROBOT_TASK, NUM_ROBOT_TASKS + 1, 0.0)


def test_the_end_of_one_motion_is_the_start_of_the_next(library):
    def start(kind, index):
        return np.append(library.position(kind, index, 0.0), library.gripper_width(kind, index, 0.0))

    def end(kind, index):
        return np.append(library.position(kind, index, 1.0), library.gripper_width(kind, index, 1.0))

    home = np.append(library.home, Workcell().gripper_open)
    for i in range(1, NUM_ROBOT_TASKS + 1):
        np.testing.assert_allclose(start(ActionKind.ROBOT_TASK, i), home, atol=1e-9)
        np.testing.assert_allclose(end(ActionKind.ROBOT_TASK, i), home, atol=1e-9)
    for index in range(1, NUM_JOINT_ACTIONS + 1):
        prepared = end(ActionKind.PREPARE, index)
        np.testing.assert_allclose(start(ActionKind.PREPARE, index), home, atol=1e-9)
        np.testing.assert_allclose(start(ActionKind.JOINT, index), prepared, atol=1e-9)
        np.testing.assert_allclose(start(ActionKind.HOME_ABORTED, index), prepared, atol=1e-9)
        np.testing.assert_allclose(start(ActionKind.HOME, index), end(ActionKind.JOINT, index), atol=1e-9)
        np.testing.assert_allclose(end(ActionKind.HOME, index), home, atol=1e-9)
        np.testing.assert_allclose(end(ActionKind.HOME_ABORTED, index), home, atol=1e-9)


def test_the_fraction_is_clamped(library):
    for kind, index in library:
        for inside, outside in ((0.0, -0.5), (1.0, 1.5)):
            np.testing.assert_array_equal(library.position(kind, index, inside), library.position(kind, index, outside))
            assert library.gripper_width(kind, index, inside) == library.gripper_width(kind, index, outside)


@pytest.mark.parametrize("slower", [1.0, 1.7])
def test_limits_hold_at_full_speed_and_slower(library, scene, slower):
    """Velocities and accelerations by differences of ``position`` alone, within the scaled limits."""
    _, plant, _ = scene
    workcell = Workcell()
    lower, upper = plant.GetPositionLowerLimits()[:7], plant.GetPositionUpperLimits()[:7]
    velocity = workcell.velocity_scale * plant.GetVelocityUpperLimits()[:7] / slower
    acceleration = workcell.acceleration_scale * plant.GetAccelerationUpperLimits()[:7] / slower**2
    largest = 0.0
    for kind, index in library:
        duration = slower * library.minimum_duration(kind, index)
        times = np.linspace(0.0, duration, int(duration / 0.004))
        q = np.array([library.position(kind, index, t / duration) for t in times])
        v = np.diff(q, axis=0) / times[1]
        a = np.diff(v, axis=0) / times[1]
        assert np.all(q >= lower)
        assert np.all(q <= upper)
        assert np.all(np.abs(v) <= 1.01 * velocity)
        # TOPPRA enforces the limits at its grid points; between them they may be passed by a few per cent.
        assert np.all(np.abs(a) <= 1.05 * acceleration)
        assert np.max(np.abs(v[[0, -1]])) <= 0.004 * np.max(acceleration) + 1e-9  # from rest, to rest
        largest = max(largest, np.max(np.abs(v) / velocity), np.max(np.abs(a) / acceleration))
    assert largest > 0.95  # time-optimal: some limit is reached


def test_motions_keep_clear_of_everything(library, scene):
    _, plant, context = scene
    query = plant.get_geometry_query_input_port()
    for kind, index in library:
        for fraction in np.linspace(0.0, 1.0, 120):
            width = library.gripper_width(kind, index, fraction)
            gripper_pose(scene, library.position(kind, index, fraction), width)
            pairs = query.Eval(context).ComputeSignedDistancePairwiseClosestPoints(0.05)
            assert min((pair.distance for pair in pairs), default=0.05) >= Workcell().clearance - 1e-3


def test_durations_leave_room_for_the_drawn_ones(library):
    """The task draws about 8 s a sort (CV 0.1), 8-11 s a preparation, 10-15 s a joint action, 5-8 s homing."""
    longest = {ActionKind.ROBOT_TASK: 5.5, ActionKind.PREPARE: 6.0, ActionKind.JOINT: 6.0}
    for kind, index in library:
        assert 0.3 < library.minimum_duration(kind, index) <= longest.get(kind, 4.0)


def test_a_robot_task_visits_its_cube_and_its_tray(library, scene):
    workcell = Workcell()
    for i in range(1, NUM_ROBOT_TASKS + 1):
        samples = np.linspace(0.0, 1.0, 400)
        p_WG = np.array(
            [gripper_pose(scene, library.position(ActionKind.ROBOT_TASK, i, f)).translation() for f in samples]
        )
        widths = np.array([library.gripper_width(ActionKind.ROBOT_TASK, i, f) for f in samples])
        cube = np.add(workcell.cubes[(i - 1) % 4].translation, [0.0, 0.0, 0.02 + workcell.grasp_standoff])
        tray = np.add(workcell.trays[(i - 1) % 4].translation, [0.0, 0.0, 0.028 + workcell.grasp_standoff])
        to_cube, to_tray = (np.linalg.norm(p_WG - p, axis=1) for p in (cube, tray))
        assert to_cube.min() < 2e-3
        assert to_tray.min() < 2e-3
        assert to_cube.argmin() < to_tray.argmin()
        # Open on the way to the cube, closed on the way to the tray.
        assert widths[to_cube.argmin()] > workcell.gripper_closed
        between = (to_cube.argmin() + to_tray.argmin()) // 2
        assert widths[between] == pytest.approx(workcell.gripper_closed)


def test_prepared_and_end_poses_are_the_configured_ones(library, scene):
    presentations = Workcell().presentations
    for index, k in ((1, 0), (2, 1), (3, 2), (4, 1)):
        for kind, pose in ((ActionKind.PREPARE, presentations[k].prepared), (ActionKind.JOINT, presentations[k].end)):
            X_WG = gripper_pose(scene, library.position(kind, index, 1.0))
            error = pose.to_rigid_transform().InvertAndCompose(X_WG)
            assert np.linalg.norm(error.translation()) < 5e-4
            assert error.rotation().ToAngleAxis().angle() < 0.015


def test_planning_is_deterministic(library):
    again = plan_motions(Workcell(), 1, 1)
    for kind, index in again:
        for fraction in (0.0, 0.21, 0.5, 0.83):
            np.testing.assert_array_equal(
                again.position(kind, index, fraction), library.position(kind, index, fraction)
            )
        assert again.minimum_duration(kind, index) == library.minimum_duration(kind, index)


def test_restarts_of_inverse_kinematics_are_seeded():
    """A pose that the first guess does not solve: equal seeds give equal postures, another seed another one."""
    pose = Pose(translation=[0.59, -0.22, 0.52], rpy=[-0.2, -0.1, 2.4])
    workcell = replace(Workcell(), presentations=[Presentation(prepared=pose, end=pose), *Workcell().presentations[1:]])
    first, second, other = (
        plan_motions(replace(workcell, seed=seed), 0, 1).position(ActionKind.PREPARE, 1, 1.0) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, second)
    assert np.max(np.abs(first - other)) > 0.1


def test_a_joint_action_may_end_where_it_starts():
    pose = Workcell().presentations[0].prepared
    workcell = replace(
        Workcell(),
        gripper_open=0.05,
        gripper_closed=0.05,
        presentations=[Presentation(prepared=pose, end=pose), *Workcell().presentations[1:]],
    )
    library = plan_motions(workcell, 0, 1)
    assert library.minimum_duration(ActionKind.JOINT, 1) > 0
    np.testing.assert_allclose(
        library.position(ActionKind.JOINT, 1, 1.0), library.position(ActionKind.PREPARE, 1, 1.0), atol=2e-3
    )


def test_every_cube_reaches_every_tray():
    """Some of these paths need another grid before TOPPRA solves them."""
    workcell = Workcell()
    for shift in (1, 2, 3):
        trays = [*workcell.trays[shift:], *workcell.trays[:shift]]
        assert len(plan_motions(replace(workcell, trays=trays), 4, 0)) == 4


def test_a_leg_that_would_hit_something_goes_over_it(scene):
    """From one side of the rails on the assembly table to the other, low: the straight way leads through them."""
    low = [Pose(translation=[0.66, y, 0.10], rpy=[pi, 0.0, 0.0]) for y in (0.36, -0.36)]
    workcell = replace(
        Workcell(), presentations=[Presentation(prepared=low[0], end=low[1]), *Workcell().presentations[1:]]
    )
    library = plan_motions(workcell, 0, 1)
    heights = [
        gripper_pose(scene, library.position(ActionKind.JOINT, 1, f)).translation()[2] for f in np.linspace(0, 1, 50)
    ]
    assert max(heights) > 0.2


def test_a_place_out_of_reach_is_refused_by_name():
    workcell = replace(Workcell(), cubes=[Pose(translation=[1.4, -0.3, 0.02])])
    with pytest.raises(InputError, match=r"workcell\.cubes\[0\]: no posture"):
        plan_motions(workcell, 1, 0)


def test_a_motion_that_comes_too_near_is_refused_with_its_distance():
    workcell = Workcell()
    # The home position lies on the table top, as good as touching it.
    workcell.home = [-0.95, 0.85, 0.0, -1.87, 0.0, 2.72, 0.0]
    with pytest.raises(InputError, match=r"robot task 1 leaves only -?\d\.\d{4} m between .+ and "):
        plan_motions(workcell, 1, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_step": 0.0}, r"workcell\.time_step: must be > 0"),
        ({"velocity_scale": 1.5}, r"workcell\.velocity_scale: must be <= 1"),
        ({"home": [0.0] * 6}, r"workcell\.home: must be 7 finite numbers"),
        ({"derivative_gain": [1.0] * 6 + [0.0]}, r"workcell\.derivative_gain: every gain must be > 0"),
        ({"gripper_open": 0.09}, r"workcell\.gripper_open: .*0\.08"),
        ({"cubes": []}, r"workcell\.cubes: needs at least 1"),
        ({"trays": [Pose(translation=[0.0, float("nan"), 0.0])]}, r"workcell\.trays\[0\]\.translation"),
        ({"colors": [[2.0, 0.0, 0.0, 1.0]]}, r"workcell\.colors\[0\]: every channel"),
        ({"presentations": [Presentation()]}, r"workcell\.presentations: needs at least 2"),
        ({"home": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]}, r"workcell\.home: must stay 0\.05 rad inside"),
    ],
)
def test_a_workcell_that_cannot_be_used_is_refused_by_name(change, message):
    with pytest.raises(InputError, match=message):
        plan_motions(replace(Workcell(), **change), 1, 1)


def test_negative_numbers_of_actions_are_refused():
    with pytest.raises(InputError, match="num_robot_tasks: must be >= 0, is -1"):
        plan_motions(Workcell(), -1, 0)


def test_workcell_loads_from_yaml_over_its_defaults():
    text = "{seed: 3, chair_side: {translation: [0.3, 0.6, 0.0]}, trays: [{translation: [0.3, -0.5, 0.0]}]}"
    workcell = yaml_load_typed(schema=Workcell, data=text, defaults=Workcell())
    assert workcell == replace(
        Workcell(),
        seed=3,
        chair_side=Pose(translation=[0.3, 0.6, 0.0], rpy=[0.0, 0.0, pi / 2]),
        trays=[Pose(translation=[0.3, -0.5, 0.0])],
    )
    X = workcell.chair_side.to_rigid_transform()
    np.testing.assert_allclose(
        X.rotation().matrix(), RollPitchYaw(0.0, 0.0, pi / 2).ToRotationMatrix().matrix(), atol=1e-12
    )
