"""models/panda.urdf against the published parameters of the arm."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pace_drake.resources import resource_path

# Modified Denavit-Hartenberg parameters (a [m], d [m], alpha [rad]) of joints 1..7 and the flange: Franka Control
# Interface documentation, "Denavit-Hartenberg parameters".
MODIFIED_DH = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
]
POSITION_LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
POSITION_UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
VELOCITY = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]
ACCELERATION = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
EFFORT = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]
REFLECTED_INERTIA = [0.605721456] * 2 + [0.462474144] * 2 + [0.205544064] * 3
# Gaz et al. 2019: links 0..7; hand 0.73 kg, fingers 15 g each.
MASSES = [0.629769, 4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522, 0.73, 0.015, 0.015]
# Gaz et al. 2019, as listed by franka_description: centres of mass of links 0..7 in their own frames [m].
LINK_CENTRES = [
    (-0.041018, -0.00014, 0.049974),
    (0.003875, 0.002081, -0.04762),
    (-0.003141, -0.02872, 0.003495),
    (0.027518, 0.039252, -0.066502),
    (-0.05317, 0.104419, 0.027454),
    (-0.011953, 0.041065, -0.038437),
    (0.060149, -0.014117, -0.010517),
    (0.010517, -0.004252, 0.061597),
]


def dh_transform(a: float, d: float, alpha: float, theta: float) -> np.ndarray:
    """Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d), written out."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [
            [ct, -st, 0.0, a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def flange_pose(q: np.ndarray) -> np.ndarray:
    X = np.eye(4)
    for (a, d, alpha), theta in zip(MODIFIED_DH, [*q, 0.0], strict=True):
        X = X @ dh_transform(a, d, alpha, theta)
    return X


@pytest.fixture(scope="module")
def model():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    Parser(plant).AddModels(str(resource_path("models/panda.urdf")))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    return diagram, plant, scene_graph, plant.GetMyMutableContextFromRoot(context)


def test_forward_kinematics_equals_the_published_table(model):
    _, plant, _, context = model
    rng = np.random.default_rng(1)
    hand = np.eye(4)
    hand[:2, :2] = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)
    for _ in range(50):
        q = rng.uniform(POSITION_LOWER, POSITION_UPPER)
        plant.SetPositions(context, np.concatenate([q, [0.03, 0.01]]))
        expected = flange_pose(q)
        for frame, X in (
            ("panda_link8", expected),
            ("panda_hand", expected @ hand),
            ("panda_hand_tcp", expected @ hand @ dh_transform(0.0, 0.1034, 0.0, 0.0)),
        ):
            actual = plant.GetFrameByName(frame).CalcPoseInWorld(context).GetAsMatrix4()
            np.testing.assert_allclose(actual, X, atol=1e-9)


def test_fingers_slide_along_the_hand(model):
    _, plant, _, context = model
    plant.SetPositions(context, np.concatenate([np.zeros(7), [0.04, 0.04]]))
    hand = plant.GetFrameByName("panda_hand")
    for finger, y in (("panda_leftfinger", 0.04), ("panda_rightfinger", -0.04)):
        p = plant.GetFrameByName(finger).CalcPose(context, hand).translation()
        np.testing.assert_allclose(p, [0.0, y, 0.0584], atol=1e-12)


def test_limits_are_the_published_ones(model):
    _, plant, _, _ = model
    np.testing.assert_array_equal(plant.GetPositionLowerLimits(), [*POSITION_LOWER, 0.0, 0.0])
    np.testing.assert_array_equal(plant.GetPositionUpperLimits(), [*POSITION_UPPER, 0.04, 0.04])
    np.testing.assert_array_equal(plant.GetVelocityUpperLimits()[:7], VELOCITY)
    np.testing.assert_array_equal(plant.GetVelocityLowerLimits()[:7], -np.array(VELOCITY))
    np.testing.assert_array_equal(plant.GetAccelerationUpperLimits()[:7], ACCELERATION)
    np.testing.assert_array_equal(plant.GetEffortUpperLimits()[:7], EFFORT)


def test_masses_and_reflected_inertias_are_the_published_ones(model):
    _, plant, _, context = model
    names = [f"panda_link{k}" for k in range(8)] + ["panda_hand", "panda_leftfinger", "panda_rightfinger"]
    masses = [plant.GetBodyByName(name).default_mass() for name in names]
    np.testing.assert_array_equal(masses, MASSES)
    assert plant.CalcTotalMass(context) == pytest.approx(17.451901, abs=1e-9)
    for k, inertia in enumerate(REFLECTED_INERTIA, start=1):
        actuator = plant.GetJointActuatorByName(f"panda_actuator{k}")
        assert actuator.default_reflected_inertia() == pytest.approx(inertia, rel=1e-9)


def test_inertias_can_exist(model):
    _, plant, _, _ = model
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("panda")):
        assert plant.get_body(index).default_spatial_inertia().IsPhysicallyValid()


def test_one_actuator_a_joint_and_one_for_both_fingers(model):
    _, plant, _, _ = model
    assert plant.num_positions() == 9
    assert plant.num_actuators() == 8
    assert plant.num_constraints() == 1  # the mimic of the second finger


def test_centre_of_mass_is_where_the_published_masses_put_it(model):
    """The links' published centres of mass, carried through the published table by hand."""
    _, plant, _, context = model
    q = np.array([0.3, -0.6, 0.2, -1.9, -0.4, 1.5, 0.7])
    plant.SetPositions(context, np.concatenate([q, [0.02, 0.02]]))
    X, moment = np.eye(4), MASSES[0] * np.array(LINK_CENTRES[0])
    for (a, d, alpha), theta, mass, centre in zip(MODIFIED_DH, q, MASSES[1:8], LINK_CENTRES[1:], strict=False):
        X = X @ dh_transform(a, d, alpha, theta)
        moment += mass * (X @ [*centre, 1.0])[:3]
    hand = flange_pose(q)
    hand[:3, :3] = hand[:3, :3] @ (np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2)]]) / np.sqrt(2))
    moment += 0.73 * (hand @ [-0.01, 0.0, 0.03, 1.0])[:3]
    for y in (0.02, -0.02):
        moment += 0.015 * (hand @ [0.0, y, 0.0584, 1.0])[:3]
    expected = moment / sum(MASSES)
    np.testing.assert_allclose(plant.CalcCenterOfMassPositionInWorld(context), expected, atol=1e-6)


def test_ready_position_touches_nothing_and_a_folded_one_does(model):
    _, plant, _, context = model
    query_port = plant.get_geometry_query_input_port()

    def least_distance(q: list[float]) -> float:
        plant.SetPositions(context, np.array([*q, 0.04, 0.04]))
        pairs = query_port.Eval(context).ComputeSignedDistancePairwiseClosestPoints(1.0)
        return min(pair.distance for pair in pairs)

    assert least_distance([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]) > 0.05
    # Forearm folded down in front of the column: the hand runs into the base.
    assert least_distance([0.0, 0.2, 0.0, -3.05, 0.0, 1.2, 0.8]) < 0.0


def test_collision_geometry_is_capsules_and_finger_boxes(model):
    _, plant, scene_graph, _ = model
    inspector = scene_graph.model_inspector()
    kinds = {}
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("panda")):
        body = plant.get_body(index)
        shapes = [type(inspector.GetShape(g)).__name__ for g in plant.GetCollisionGeometriesForBody(body)]
        kinds[body.name()] = set(shapes)
    assert all(kinds[f"panda_link{k}"] == {"Capsule"} for k in range(8))
    assert kinds["panda_leftfinger"] == kinds["panda_rightfinger"] == {"Box", "Sphere"}
    assert inspector.NumGeometriesWithRole(Role.kIllustration) > 60
