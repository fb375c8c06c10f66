"""The plant station: its ports, how the arm follows, how the cubes rest. One station for all tests."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.systems.analysis import Simulator

from pace_drake.errors import InputError
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.person import FOREARM, P_TRUNK_SHOULDER, UPPER_ARM
from pace_drake.stations.plant import make_plant_station
from pace_drake.stations.workcell import Workcell
from pace_drake.task import ActionKind

HAND = np.array([0.9, 0.0, 0.15])


@pytest.fixture(scope="module")
def station():
    return make_plant_station(Workcell())


@pytest.fixture
def simulator(station):
    """At home, at rest, with the desired position at home; a fresh context."""
    simulator = Simulator(station)
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
