"""The plant station: its ports, how the arm follows, how the cubes rest. One station for all tests."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.analysis import Simulator

from pace_drake.errors import InputError
from pace_drake.stations.components import flat
from pace_drake.stations.human_grip import HumanGrip
from pace_drake.stations.layout import nominal_layout, sample_layout
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.person import FOREARM, P_TRUNK_SHOULDER, UPPER_ARM
from pace_drake.stations.plant import make_plant_station
from pace_drake.stations.workcell import Workcell
from pace_drake.task import NUM_ROBOT_DRAWS, ActionKind

HAND = np.array([0.9, 0.0, 0.15])


@pytest.fixture(scope="module")
def station():
    return make_plant_station(Workcell())


@pytest.fixture
def simulator(station):
    """At home, at rest, with the desired position at home; a fresh context."""
    return held_at_home(station, Simulator(station))


def held_at_home(station, simulator):
    """Fixes the inputs so that the arm stays at home, and initializes."""
    context = simulator.get_mutable_context()
    station.GetInputPort("panda.position").FixValue(context, Workcell().home)
    station.GetInputPort("gripper.position").FixValue(context, [Workcell().gripper_open])
    station.GetInputPort("p_WH").FixValue(context, HAND)
    simulator.Initialize()
    return simulator


def cube_poses(station, context) -> np.ndarray:
    """(4, 4, 4) homogeneous transforms X_WO."""
    plant = station.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    bodies = [plant.GetBodyByName("cube", plant.GetModelInstanceByName(f"cube_{k}")) for k in range(1, 5)]
    return np.array([plant.EvalBodyPoseInWorld(plant_context, body).GetAsMatrix4() for body in bodies])


def test_ports(station):
    inputs = {
        station.get_input_port(k).get_name(): station.get_input_port(k).size() for k in range(station.num_input_ports())
    }
    outputs = {
        station.get_output_port(k).get_name(): station.get_output_port(k).size()
        for k in range(station.num_output_ports())
    }
    assert station.get_name() == "station"
    assert inputs == {"panda.position": 7, "gripper.position": 1, "p_WH": 3}
    assert outputs.pop("query_object") == outputs.pop("contact_results") == 0  # abstract
    assert outputs == {
        "panda.position_measured": 7,
        "panda.velocity_estimated": 7,
        "panda.torque_external": 7,
        "gripper.state_measured": 2,
        "component_poses": 7 * 7,
        "contact": 2,
        "key_taken": 2,
    }


def test_it_starts_at_home_and_stays_there(station, simulator):
    context = simulator.get_context()
    for time in np.linspace(0.0, 0.5, 26):
        simulator.AdvanceTo(time)
        q = station.GetOutputPort("panda.position_measured").Eval(context)
        np.testing.assert_allclose(q, Workcell().home, atol=1e-6)
        v = station.GetOutputPort("panda.velocity_estimated").Eval(context)
        np.testing.assert_allclose(v, 0.0, atol=1e-4)
        width, rate = station.GetOutputPort("gripper.state_measured").Eval(context)
        assert width == pytest.approx(Workcell().gripper_open, abs=1e-5)
        assert rate == pytest.approx(0.0, abs=1e-3)
        np.testing.assert_allclose(station.GetOutputPort("panda.torque_external").Eval(context), 0.0, atol=1e-12)


def test_the_arm_follows_a_sort_within_a_hundredth_of_a_radian(station, simulator):
    """A sort at full speed; the reference changes every time step."""
    context = simulator.get_mutable_context()
    library = plan_motions(Workcell(), 1, 0)
    action = (ActionKind.ROBOT_TASK, 1)
    duration = library.minimum_duration(*action)
    step = Workcell().time_step
    position_error, width_error, velocity_peak = 0.0, 0.0, 0.0
    for k in range(int(duration / step) + 1):
        fraction = k * step / duration
        position, width = library.position(*action, fraction), library.gripper_width(*action, fraction)
        # The output is read at the time for which the reference is.
        q = station.GetOutputPort("panda.position_measured").Eval(context)
        state = station.GetOutputPort("gripper.state_measured").Eval(context)
        position_error = max(position_error, np.max(np.abs(q - position)))
        if width > 0.041:  # else the cube is between the fingers
            width_error = max(width_error, abs(state[0] - width))
        v = station.GetOutputPort("panda.velocity_estimated").Eval(context)
        velocity_peak = max(velocity_peak, np.max(np.abs(v)))
        station.GetInputPort("panda.position").FixValue(context, position)
        station.GetInputPort("gripper.position").FixValue(context, [width])
        simulator.AdvanceTo((k + 1) * step)
    assert position_error < 0.01
    assert width_error < 0.002
    assert velocity_peak > 1.0  # it did move
    q = station.GetOutputPort("panda.position_measured").Eval(context)
    np.testing.assert_allclose(q, library.home, atol=0.005)


def test_cubes_rest(station, simulator):
    context = simulator.get_context()
    before = cube_poses(station, context)
    simulator.AdvanceTo(2.0)
    after = cube_poses(station, context)
    np.testing.assert_allclose(after[:, :3, 3], before[:, :3, 3], atol=1e-3)
    np.testing.assert_allclose(after[:, :3, :3], before[:, :3, :3], atol=1e-3)
    assert np.all(before[:, 2, 3] - after[:, 2, 3] > 0)  # they do bear on the table
    simulator.AdvanceTo(2.5)
    np.testing.assert_allclose(cube_poses(station, context), after, atol=1e-6)


def test_a_cube_in_the_air_falls_onto_the_table(station, simulator):
    """The cubes are under gravity and contact, not welded."""
    context = simulator.get_mutable_context()
    plant = station.GetSubsystemByName("plant")
    body = plant.GetBodyByName("cube", plant.GetModelInstanceByName("cube_1"))
    plant_context = plant.GetMyMutableContextFromRoot(context)
    X_WO = plant.EvalBodyPoseInWorld(plant_context, body)
    X_WO.set_translation(np.add(X_WO.translation(), [0.0, 0.0, 0.05]))
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WO)
    simulator.AdvanceTo(1.0)
    assert cube_poses(station, context)[0, 2, 3] == pytest.approx(0.02, abs=1e-3)


def test_contact_shows_as_external_torque(station, simulator):
    """A cube put between the closing fingers' way and the table top: the arm pressed down on it feels it."""
    context = simulator.get_mutable_context()
    plant = station.GetSubsystemByName("plant")
    plant_context = plant.GetMyMutableContextFromRoot(context)
    body = plant.GetBodyByName("cube", plant.GetModelInstanceByName("cube_1"))
    X_WG = plant.GetFrameByName("panda_hand_tcp").CalcPoseInWorld(plant_context)
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WG)
    station.GetInputPort("gripper.position").FixValue(context, [0.03])
    simulator.AdvanceTo(0.3)
    width, _ = station.GetOutputPort("gripper.state_measured").Eval(context)
    assert 0.034 < width < 0.041  # stopped by the cube, which gives a little under point contact
    torque = station.GetOutputPort("panda.torque_external").Eval(context)
    # The cube's weight, 0.63 N, about joint 2 at 0.307 m: 0.19 N m, pulling the arm down (positive about joint 2).
    assert torque[1] == pytest.approx(0.064 * 9.81 * X_WG.translation()[0], rel=0.1)


def test_the_person_s_hand_is_where_the_port_says(station, simulator):
    context = simulator.get_mutable_context()
    rng = np.random.default_rng(3)
    for p_WH in rng.uniform([0.65, -0.35, 0.02], [1.05, 0.35, 0.35], size=(20, 3)):
        station.GetInputPort("p_WH").FixValue(context, p_WH)
        query = station.GetOutputPort("query_object").Eval(context)
        inspector = query.inspector()
        (hand,) = [g for g in inspector.GetAllGeometryIds(Role.kProximity) if inspector.GetName(g) == "hand"]
        np.testing.assert_allclose(query.GetPoseInWorld(hand).translation(), p_WH, atol=1e-12)
        # 0.10 m beside its centre is 0.055 m from its surface, as the distance query of a safety monitor finds it.
        distances = query.ComputeSignedDistanceToPoint(np.add(p_WH, [0.0, 0.1, 0.0]), 0.2)
        (distance,) = [d.distance for d in distances if d.id_G == hand]
        assert distance == pytest.approx(0.055, abs=1e-9)


def test_the_person_pushes_nothing(station, simulator):
    """The hand stands in the middle of a cube, then of the arm: nothing moves."""
    context = simulator.get_mutable_context()
    before = cube_poses(station, context)
    station.GetInputPort("p_WH").FixValue(context, before[0, :3, 3])
    simulator.AdvanceTo(0.2)
    np.testing.assert_allclose(cube_poses(station, context), before, atol=1e-3)
    station.GetInputPort("p_WH").FixValue(context, [0.30, 0.0, 0.55])
    simulator.AdvanceTo(0.4)
    np.testing.assert_allclose(
        station.GetOutputPort("panda.position_measured").Eval(context), Workcell().home, atol=1e-5
    )


def test_the_person_holds_together(station, simulator):
    """Hand, forearm, upper arm and shoulder stay joined wherever the hand works; the arm is stretched at most 8 cm."""
    context = simulator.get_mutable_context()
    person = station.GetSubsystemByName("person")
    rng = np.random.default_rng(4)
    for p_WH in rng.uniform([0.65, -0.35, 0.02], [1.05, 0.35, 0.35], size=(50, 3)):
        station.GetInputPort("p_WH").FixValue(context, p_WH)
        query = station.GetOutputPort("query_object").Eval(context)
        inspector = query.inspector()
        X = {inspector.GetName(f): query.GetPoseInWorld(f) for f in inspector.FramesForSource(person.source_id)}
        elbow = X["hand"] @ np.array([0.0, 0.0, FOREARM])
        shoulder = X["trunk"] @ P_TRUNK_SHOULDER
        assert np.linalg.norm(elbow - X["upper_arm"].translation()) < 0.08
        np.testing.assert_allclose(X["upper_arm"] @ np.array([0.0, 0.0, UPPER_ARM]), shoulder, atol=1e-9)


def test_initial_position_must_be_seven_numbers():
    with pytest.raises(InputError, match="initial_position: must be 7 finite numbers"):
        make_plant_station(Workcell(), initial_position=np.zeros(6))


# ---- where components lie

CUBE, KEY = 0, 5  # of the components
LAYOUT = sample_layout(Workcell(), np.random.default_rng(0))


def poses(station, context) -> np.ndarray:
    """(7, 4, 4) X_WO of every component."""
    return np.array([station.component_pose(context, k).GetAsMatrix4() for k in range(len(station.components))])


def put(station, context, k, X_WO):
    """Moves a component, as a hand of the test, and lets it go there at rest."""
    plant = station.plant
    plant_context = plant.GetMyMutableContextFromRoot(context)
    component = station.components[k]
    body = plant.GetBodyByName(component.model, plant.GetModelInstanceByName(component.name))
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WO)
    plant.SetFreeBodySpatialVelocity(plant_context, body, SpatialVelocity.Zero())


def test_components_begin_where_the_layout_puts_them_and_rest_there(station, simulator):
    context = simulator.get_mutable_context()
    nominal = nominal_layout(Workcell())
    for k, located in enumerate(nominal.located):
        np.testing.assert_allclose(flat(station.component_pose(context, k)), located, atol=1e-12)
    station.set_layout(context, LAYOUT)
    simulator.AdvanceTo(0.3)
    output = station.GetOutputPort("component_poses").Eval(context).reshape(-1, 7)
    for k, located in enumerate(LAYOUT.located):
        X_WO = station.component_pose(context, k)
        np.testing.assert_allclose(flat(X_WO), located, atol=1e-3)
        assert abs(X_WO.translation()[2] - station.components[k].nominal.translation[2]) < 1e-3
        np.testing.assert_allclose(output[k, 4:], X_WO.translation(), atol=1e-12)
        np.testing.assert_allclose(output[k, :4], X_WO.rotation().ToQuaternion().wxyz(), atol=1e-12)


def test_a_cube_is_put_back_when_it_is_out_of_the_pile_and_only_then(station, simulator):
    context = simulator.get_mutable_context()
    station.set_layout(context, LAYOUT)
    before = poses(station, context)
    station.refill(context, CUBE, 3)
    np.testing.assert_array_equal(poses(station, context), before)  # it lies in the pile
    tray = Workcell().trays[0].translation
    put(station, context, CUBE, RigidTransform([tray[0], tray[1], 0.026]))
    plant = station.plant
    plant_context = plant.GetMyMutableContextFromRoot(context)
    cube = plant.GetBodyByName("cube", plant.GetModelInstanceByName("cube_1"))
    plant.SetFreeBodySpatialVelocity(plant_context, cube, SpatialVelocity([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    station.refill(context, CUBE, 203)
    after = poses(station, context)
    np.testing.assert_allclose(flat(station.component_pose(context, CUBE)), LAYOUT.pile[202, CUBE], atol=1e-12)
    assert not np.any(plant.EvalBodySpatialVelocityInWorld(plant_context, cube).get_coeffs())  # it is laid down
    np.testing.assert_array_equal(np.delete(after, CUBE, 0), np.delete(before, CUBE, 0))  # no other is touched
    put(station, context, CUBE, RigidTransform([*LAYOUT.located[CUBE, :2], 0.2]))  # over the pile, but not in it
    station.refill(context, CUBE, NUM_ROBOT_DRAWS + 5)
    np.testing.assert_allclose(flat(station.component_pose(context, CUBE)), LAYOUT.pile[4, CUBE], atol=1e-12)
    assert station.component_pose(context, CUBE).translation()[2] == Workcell().cubes[CUBE].translation[2]


def test_the_pile_is_the_episode_s(station, simulator):
    """Another layout in the same context gives another place."""
    context = simulator.get_mutable_context()
    found = []
    for layout in (LAYOUT, sample_layout(Workcell(), np.random.default_rng(1)), nominal_layout(Workcell())):
        station.set_layout(context, layout)
        put(station, context, CUBE, RigidTransform([0.6, -0.4, 0.1]))
        station.refill(context, CUBE, 1)
        found.append(flat(station.component_pose(context, CUBE)))
        np.testing.assert_allclose(found[-1], layout.pile[0, CUBE], atol=1e-12)
    assert not np.allclose(found[0], found[1], atol=1e-4)


# ---- keys in the person's hand


def offered_key(station, context):
    """A key between the fingers of the arm at home, its handle where it is gripped."""
    grasp = station.components[KEY].grasp
    X_WG = station.plant.GetFrameByName("panda_hand_tcp").CalcPoseInWorld(station.plant.GetMyContextFromRoot(context))
    X_WO = X_WG @ grasp.X_OG(grasp.yaws[0]).inverse()
    put(station, context, KEY, X_WO)
    return X_WO


def let_go(station, simulator, hand_comes):
    """Height [m] and distance from the hand [m] of a key's short end after the gripper has let go of it."""
    context = simulator.get_mutable_context()
    X_WO = offered_key(station, context)
    station.GetInputPort("gripper.position").FixValue(context, [0.008])
    simulator.AdvanceTo(0.3)
    held = station.component_pose(context, KEY)
    assert np.linalg.norm(held.translation() - X_WO.translation()) < 0.015  # the gripper has it
    p_WH = held @ HumanGrip.p_OEnd + [0.0, 0.0, 0.02]
    if hand_comes:
        station.GetInputPort("p_WH").FixValue(context, p_WH)
    simulator.AdvanceTo(0.4)
    taken = station.GetOutputPort("key_taken").Eval(context).tolist()
    assert taken == ([1, 0] if hand_comes else [0, 0])
    station.GetInputPort("gripper.position").FixValue(context, [0.06])
    simulator.AdvanceTo(0.9)
    p_WEnd = station.component_pose(context, KEY) @ HumanGrip.p_OEnd
    return p_WEnd[2], np.linalg.norm(p_WEnd - p_WH)


def test_a_key_let_go_while_the_hand_has_it_does_not_fall(station, simulator):
    height, distance = let_go(station, simulator, hand_comes=True)
    assert height > 0.35
    assert distance < 0.02


def test_a_key_let_go_without_a_hand_falls(station, simulator):
    height, _ = let_go(station, simulator, hand_comes=False)
    assert height < 0.3


def test_a_key_in_the_hand_follows_it(station, simulator):
    context = simulator.get_mutable_context()
    X_WO = RigidTransform([0.9, 0.0, 0.4])
    put(station, context, KEY, X_WO)
    station.GetInputPort("p_WH").FixValue(context, X_WO @ HumanGrip.p_OEnd)
    simulator.AdvanceTo(0.2)
    p_WH = X_WO @ HumanGrip.p_OEnd + [0.1, 0.05, 0.0]
    station.GetInputPort("p_WH").FixValue(context, p_WH)
    simulator.AdvanceTo(0.8)
    assert np.linalg.norm(station.component_pose(context, KEY) @ HumanGrip.p_OEnd - p_WH) < 0.03


def test_the_default_context_forgets_all_of_an_episode(station):
    """Keys taken, layout and the pile: what follows is that of a fresh context, bit for bit."""

    def play(simulator):
        context = simulator.get_mutable_context()
        found = []
        for time in (0.1, 0.2, 0.3):
            simulator.AdvanceTo(time)
            found.append(station.plant.get_state_output_port().Eval(station.plant.GetMyContextFromRoot(context)).copy())
        station.refill(context, CUBE, 1)
        put(station, context, CUBE + 1, RigidTransform([0.6, -0.4, 0.1]))
        station.refill(context, CUBE + 1, 7)
        simulator.AdvanceTo(0.4)
        found.append(station.plant.get_state_output_port().Eval(station.plant.GetMyContextFromRoot(context)).copy())
        return found, station.GetOutputPort("key_taken").Eval(context).copy()

    fresh, _ = play(held_at_home(station, Simulator(station)))
    used = held_at_home(station, Simulator(station))
    context = used.get_mutable_context()
    station.set_layout(context, LAYOUT)
    X_WO = RigidTransform([0.9, 0.0, 0.4])
    put(station, context, KEY, X_WO)
    station.GetInputPort("p_WH").FixValue(context, X_WO @ HumanGrip.p_OEnd)
    station.GetInputPort("panda.position").FixValue(context, np.add(Workcell().home, 0.05))
    used.AdvanceTo(0.4)
    assert station.GetOutputPort("key_taken").Eval(context)[0] == 1
    station.SetDefaultContext(context)
    context.SetTime(0.0)
    again, taken = play(held_at_home(station, used))
    assert not np.any(taken)
    for expected, state in zip(fresh, again, strict=True):
        np.testing.assert_array_equal(state, expected)
