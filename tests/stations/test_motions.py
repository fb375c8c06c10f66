"""Planned motions: they join up, stay within limits, keep clear, and come out the same every time."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_typed
from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.errors import InputError
from pace_drake.stations import motions as motions_module
from pace_drake.stations.components import component_index, components
from pace_drake.stations.joint_paths import CARRY_BEGIN, CARRY_END
from pace_drake.stations.layout import sample_layout
from pace_drake.stations.legs import LegPlanner, Load, Via
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.planning_scene import PLACED_SIDE, PlanningScene
from pace_drake.stations.workcell import Pose, Presentation, Workcell
from pace_drake.task import ActionKind

NUM_ROBOT_TASKS, NUM_JOINT_ACTIONS = 5, 4  # one more than the cubes, one more than the presentations
FETCHING = (ActionKind.ROBOT_TASK, ActionKind.PREPARE)


@pytest.fixture(scope="module")
def library():
    return plan_motions(Workcell(), NUM_ROBOT_TASKS, NUM_JOINT_ACTIONS)


@pytest.fixture(scope="module")
def scene():
    return PlanningScene(Workcell())


@pytest.fixture(autouse=True)
def no_plans_from_elsewhere(tmp_path_factory, monkeypatch):
    """Every session plans anew; within it plans are kept, as a user's are."""
    folder = tmp_path_factory.getbasetemp() / "motions"
    folder.mkdir(exist_ok=True)
    monkeypatch.setattr(motions_module, "cache_folder", lambda name: folder)


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
        np.testing.assert_allclose(start(ActionKind.HOME, index)[:7], end(ActionKind.JOINT, index)[:7], atol=1e-9)
        # A key is let go when the person has it, and the gripper opens by itself then.
        opened = (
            Workcell().gripper_open
            if library.motion(ActionKind.JOINT, index).hand_over
            else end(ActionKind.JOINT, index)[7]
        )
        assert start(ActionKind.HOME, index)[7] == opened
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
    plant = scene.plant
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


def clearances(scene, motion, ignored) -> np.ndarray:
    """(n) [m] along a motion, whatever is carried left out."""
    found = []
    for t in np.linspace(0.0, motion.duration, 150):
        width = float(np.interp(t, motion.width_times, motion.widths))
        with scene.carrying("", ignored, max(width, 0.02)):
            found.append(scene.clearance(motion.position(t / motion.duration))[0])
    return np.array(found)


def touched(index: int, kind: ActionKind) -> tuple[str, ...]:
    """Zones that an action enters."""
    workcell = Workcell()
    if kind == ActionKind.ROBOT_TASK:
        return (f"cube_{(index - 1) % 4 + 1}", f"tray_{(index - 1) % 4 + 1}")
    component = components(workcell)[component_index(workcell, ActionKind.PREPARE, index)]
    return (component.name, *([PLACED_SIDE, "chair_base"] if index == 1 else []))


def test_motions_keep_clear_of_everything(library, scene):
    workcell = Workcell()
    for kind, index in library:
        found = clearances(scene, library.motion(kind, index), touched(index, kind))
        assert found.min() >= workcell.contact_clearance - 5e-4
        # Only near a grasp or a place is it less than the clearance.
        assert np.mean(found < workcell.clearance - 1e-3) < 0.75
    # And what is touched is touched: with its zone in the way the clearance is gone.
    assert clearances(scene, library.motion(ActionKind.ROBOT_TASK, 1), ("tray_1",)).min() < 0


def test_motions_to_any_place_of_a_component_keep_within_limits_and_clear(library, scene):
    workcell = Workcell()
    rng = np.random.default_rng(5)
    for _ in range(2):
        layout = sample_layout(workcell, rng)
        for kind, index in [action for action in library if action[0] in FETCHING][:6]:
            number = component_index(workcell, kind, index)
            motion = library.motion(kind, index, layout.located[number])
            assert clearances(scene, motion, touched(index, kind)).min() >= workcell.contact_clearance - 5e-4
            nominal = library.motion(kind, index)
            assert motion.duration == pytest.approx(nominal.duration, abs=0.6)
            np.testing.assert_allclose(motion.positions[[0, -1]], nominal.positions[[0, -1]], atol=1e-9)
            # The gripper comes to the component, as its grasp says.
            component = components(workcell)[number]
            closing = motion.width_times[np.argmax(np.diff(motion.widths) < 0)]
            X_WG = scene.gripper_pose(motion.position(closing / motion.duration))
            X_OG = component.pose(layout.located[number]).InvertAndCompose(X_WG)
            errors = [X_OG.InvertAndCompose(component.grasp.X_OG(yaw)) for yaw in component.grasp.yaws]
            assert min(np.linalg.norm(e.translation()) + e.rotation().ToAngleAxis().angle() for e in errors) < 3e-3


def test_a_place_is_planned_once_and_is_a_function_of_itself_alone(library):
    workcell = Workcell()
    place = components(workcell)[0].located + np.array([0.004, -0.003, 0.2])
    first = library.motion(ActionKind.ROBOT_TASK, 1, place)
    assert library.motion(ActionKind.ROBOT_TASK, 1, place.copy()) is first
    assert first is not library.motion(ActionKind.ROBOT_TASK, 1)
    nominal = components(workcell)[0].located
    assert library.motion(ActionKind.ROBOT_TASK, 1, nominal) is library.motion(ActionKind.ROBOT_TASK, 1)
    other = plan_motions(workcell, NUM_ROBOT_TASKS, NUM_JOINT_ACTIONS)
    other.motion(ActionKind.ROBOT_TASK, 2, components(workcell)[1].located + 0.002)
    np.testing.assert_array_equal(other.motion(ActionKind.ROBOT_TASK, 1, place).positions, first.positions)


def test_durations_leave_room_for_the_drawn_ones(library):
    """The task draws about 8 s a sort (CV 0.1), 8-11 s a preparation, 10-15 s a joint action, 5-8 s homing."""
    longest = {ActionKind.ROBOT_TASK: 5.5, ActionKind.PREPARE: 5.5, ActionKind.JOINT: 6.0}
    for kind, index in library:
        assert 0.3 < library.minimum_duration(kind, index) <= longest.get(kind, 4.5)


def test_a_robot_task_takes_its_cube_to_its_tray(library, scene):
    workcell = Workcell()
    for i in range(1, NUM_ROBOT_TASKS + 1):
        samples = np.linspace(0.0, 1.0, 400)
        p_WG = np.array(
            [scene.gripper_pose(library.position(ActionKind.ROBOT_TASK, i, f)).translation() for f in samples]
        )
        widths = np.array([library.gripper_width(ActionKind.ROBOT_TASK, i, f) for f in samples])
        cube = np.add(workcell.cubes[(i - 1) % 4].translation, [0.0, 0.0, 0.001])
        tray = np.add(workcell.trays[(i - 1) % 4].translation, [0.0, 0.0, 0.006 + 0.021 + workcell.release_gap])
        to_cube, to_tray = (np.linalg.norm(p_WG - p, axis=1) for p in (cube, tray))
        assert to_cube.min() < 2e-3
        assert to_tray.min() < 2e-3
        assert to_cube.argmin() < to_tray.argmin()
        # Open on the way to the cube, closed on the way to the tray, open again after it.
        assert widths[to_cube.argmin()] > 0.04
        assert widths[(to_cube.argmin() + to_tray.argmin()) // 2] == pytest.approx(0.04 - workcell.gripper_squeeze)
        assert widths[-1] == pytest.approx(workcell.gripper_open)


def test_prepared_and_end_poses_are_the_configured_ones(library, scene):
    workcell = Workcell()
    side = components(workcell)[4]
    X_OG = side.grasp.X_OG(side.grasp.yaws[0])
    lifted = RigidTransform([0.0, 0.0, workcell.release_gap]) @ workcell.chair_side_placed.to_rigid_transform()
    expected = {
        (ActionKind.PREPARE, 1): workcell.chair_side_prepared.to_rigid_transform() @ X_OG,
        (ActionKind.JOINT, 1): RigidTransform([0.0, 0.0, workcell.approach_height]) @ lifted @ X_OG,
    }
    for index, k in ((2, 0), (3, 1), (4, 0)):
        expected[ActionKind.PREPARE, index] = workcell.presentations[k].prepared.to_rigid_transform()
        expected[ActionKind.JOINT, index] = workcell.presentations[k].end.to_rigid_transform()
    for (kind, index), X_WG in expected.items():
        error = X_WG.InvertAndCompose(scene.gripper_pose(library.position(kind, index, 1.0)))
        assert np.linalg.norm(error.translation()) < 5e-4
        assert error.rotation().ToAngleAxis().angle() < 5e-3


def test_the_chair_s_side_is_put_down_let_go_and_left_within_the_joint_action(library, scene):
    """The person's next action may lead the hand to where the gripper was, as soon as the joint action ends."""
    workcell, kind = Workcell(), ActionKind.JOINT
    side = components(workcell)[4]
    X_WO = RigidTransform([0.0, 0.0, workcell.release_gap]) @ workcell.chair_side_placed.to_rigid_transform()
    placed = (X_WO @ side.grasp.X_OG(side.grasp.yaws[0])).translation()

    def off(share):
        return np.linalg.norm(scene.gripper_pose(library.position(kind, 1, share)).translation() - placed)

    prepared = library.position(kind, 1, 0.0)
    np.testing.assert_allclose(library.position(kind, 1, CARRY_BEGIN), prepared, atol=1e-6)
    assert np.max(np.abs(library.position(kind, 1, CARRY_BEGIN + 0.1) - prepared)) > 0.01
    assert off(CARRY_END - 0.05) > 1e-3  # the carrying takes its whole share, as the person's hand does
    assert off(CARRY_END) < 1e-3
    closed = library.gripper_width(kind, 1, CARRY_END)
    assert closed < side.grasp.width
    # It rests there until the gripper is open.
    shares = np.linspace(CARRY_END, 1.0, 200)
    widths = np.array([library.gripper_width(kind, 1, share) for share in shares])
    assert widths[-1] == workcell.gripper_release
    assert max(off(share) for share in shares[widths < workcell.gripper_release]) < 1e-3
    assert off(1.0) == pytest.approx(workcell.approach_height, abs=1e-3)


def test_planning_is_deterministic_and_kept_on_disk(library, tmp_path, monkeypatch):
    monkeypatch.setattr(motions_module, "cache_folder", lambda name: tmp_path)
    again = plan_motions(Workcell(), 1, 1)
    (file,) = tmp_path.iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(motions_module, "_Planner", None)  # nothing is planned a second time
        kept = plan_motions(Workcell(), 1, 1)
    for other in (again, kept):
        assert len(other) == 5
        for kind, index in other:
            for name in ("times", "positions", "velocities", "width_times", "widths", "approaches"):
                np.testing.assert_array_equal(
                    getattr(other.motion(kind, index), name), getattr(library.motion(kind, index), name)
                )
    # Another workcell has other plans, and a damaged file is made anew.
    plan_motions(replace(Workcell(), carry_height=0.34), 1, 1)
    assert len(list(tmp_path.iterdir())) == 2
    file.write_bytes(file.read_bytes()[:1000])
    assert len(plan_motions(Workcell(), 1, 1)) == 5


def test_every_cube_reaches_every_tray():
    """Some of these paths need another grid before TOPPRA solves them."""
    workcell = Workcell()
    for shift in (1, 2, 3):
        trays = [*workcell.trays[shift:], *workcell.trays[:shift]]
        assert len(plan_motions(replace(workcell, trays=trays), 4, 0)) == 4


def posture(planner, X_WG, near) -> Via:
    rng = np.random.default_rng(0)
    return planner.via("place", [X_WG], rng, near, Load(), 1.1 * planner.scene.workcell.clearance, 30)


@pytest.mark.parametrize("detours", [True, False])
def test_a_leg_that_would_hit_something_goes_over_or_round_it(scene, monkeypatch, detours):
    """From one side of the rails on the assembly table to the other, low: the straight way leads through them. Without
    detours the trajectory optimisation must find a way."""
    planner = LegPlanner(scene)
    home = np.array(Workcell().home)
    down, turn = RollPitchYaw(pi, 0.0, 0.0), 1.2 * np.eye(7)[0]
    a, b = (posture(planner, RigidTransform(down, [0.62, y, 0.12]), home + y * turn) for y in (0.36, -0.36))
    if not detours:
        monkeypatch.setattr("pace_drake.stations.legs._MAX_DETOURS", 0)
    leg = planner.plan("the leg", [a, b], Load())
    heights = [scene.gripper_pose(q).translation()[2] for q in leg.positions]
    if detours:
        assert max(heights) > 0.2
    with scene.carrying("", (), Load().width):
        assert min(scene.clearance(q)[0] for q in leg.positions) >= Workcell().clearance - 1e-3
        straight = np.linspace(a.q, b.q, 50)
        assert min(scene.clearance(q)[0] for q in straight) < Workcell().clearance - 1e-3


def test_what_is_carried_keeps_clear_too(scene):
    """The chair's side, held over the rails: the arm is well clear of everything, what it carries is not."""
    workcell = Workcell()
    side = components(workcell)[4]
    X_WO = RigidTransform([0.0, 0.0, 0.01]) @ workcell.chair_side_placed.to_rigid_transform()
    near = np.array(workcell.home) - pi / 2 * np.eye(7)[6]
    load = Load("", ("chair_base", PLACED_SIDE))
    planner = LegPlanner(scene)
    via = planner.via("low", [X_WO @ side.grasp.X_OG(pi / 2)], np.random.default_rng(0), near, load, 0.003, 30)
    with scene.carrying("", (PLACED_SIDE,), 0.05):
        assert scene.clearance(via.q)[0] > 0.02
    with scene.carrying("chair_side", (PLACED_SIDE,), 0.05):
        distance, names = scene.clearance(via.q)
    assert distance == pytest.approx(0.01, abs=1e-3)
    assert "carried chair_side" in names


def test_a_place_out_of_reach_is_refused_by_name():
    workcell = replace(Workcell(), cubes=[Pose(translation=[1.4, -0.3, 0.02])])
    with pytest.raises(InputError, match=r"workcell\.cube_1: no posture"):
        plan_motions(workcell, 1, 0)


def test_a_motion_that_comes_too_near_is_refused_with_its_distance():
    workcell = Workcell()
    # The home position lies on the table top, as good as touching it.
    workcell.home = [-0.95, 0.85, 0.0, -1.87, 0.0, 2.72, 0.0]
    with pytest.raises(InputError, match=r"robot task 1 leaves -?\d\.\d{4} m too little between .+ and "):
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
        ({"presentations": []}, r"workcell\.presentations: needs at least 1"),
        ({"presentations": [Presentation(hand=[0.0])]}, r"workcell\.presentations\[0\]\.hand: must be 3"),
        ({"cube_spread": [0.01, 0.01, -0.1]}, r"workcell\.cube_spread: must be >= 0"),
        ({"grip_time": -1.0}, r"workcell\.grip_time: must be > 0"),
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
