"""Distances and speeds of the arm's capsules against Drake's geometry queries and finite differences."""

import numpy as np
import pytest
from pydrake.geometry import Capsule, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pace_drake.safety.proximity import approach, nearest_points
from pace_drake.stations.arm_capsules import load_arm_capsules
from pace_drake.stations.person import LIMB_RADII, Person, limb_segments
from pace_drake.stations.plant import add_furniture
from pace_drake.stations.workcell import Workcell


@pytest.fixture(scope="module")
def arm():
    return load_arm_capsules()


@pytest.fixture(scope="module")
def drake():
    """Drake's own distances of every collision geometry of the Panda to hand and forearm."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.005)
    add_furniture(plant, scene_graph, Workcell())
    plant.Finalize()
    person = builder.AddSystem(Person(scene_graph))
    builder.Connect(person.get_output_port(), scene_graph.get_source_pose_port(person.source_id))
    builder.ExportInput(person.GetInputPort("p_WH"), "p_WH")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    inspector = scene_graph.model_inspector()
    limbs = {
        inspector.GetName(g): g
        for frame in inspector.FramesForSource(person.source_id)
        for g in inspector.GetGeometries(frame, Role.kProximity)
    }
    parts = [
        g
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName("panda"))
        for g in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity)
    ]
    capsules = [g for g in parts if isinstance(inspector.GetShape(g), Capsule)]
    fingers = [g for g in parts if g not in capsules]

    def distances(q, width, p_WH):
        """(19, 2) of capsules, and (4, 2) of finger boxes."""
        diagram.GetInputPort("p_WH").FixValue(context, p_WH)
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), np.concatenate([q, [width / 2] * 2]))
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))

        def to(group):
            pairs = [
                [query.ComputeSignedDistancePairClosestPoints(g, limbs[name]).distance for name in ("hand", "forearm")]
                for g in group
            ]
            return np.array(pairs)

        return to(capsules), to(fingers)

    return distances


def random_posture(rng):
    q = Workcell().home + rng.uniform(-0.9, 0.9, 7)
    return q, rng.uniform([0.2, -0.6, 0.0], [1.0, 0.6, 0.8])


def test_distances_are_those_of_drake(arm, drake):
    rng, differences = np.random.default_rng(0), []
    for _ in range(40):
        q, p_WH = random_posture(rng)
        found = approach(arm, q[np.newaxis], np.zeros((1, 7)), limb_segments(p_WH), LIMB_RADII).distance
        expected, fingers = drake(q, rng.uniform(0.0, 0.08), p_WH)
        assert found.shape == (len(expected) + 1, 2)
        # Drake's depth of overlapping capsules is of another kind.
        apart = expected > 1e-3
        differences.append((expected - found[:-1])[apart])
        # The fingers' capsule holds them at any width, and not much else.
        assert np.all(found[-1] <= fingers.min(axis=0) + 1e-6)
        assert np.all(found[-1] >= fingers.min(axis=0) - 0.08)
    # Drake searches, and now and then ends a little too early, never too low; ours are closed forms.
    difference = np.concatenate(differences)
    assert np.min(difference) > -1e-5
    assert np.mean(np.abs(difference) < 1e-4) > 0.98
    assert np.max(difference) < 0.02


def test_nearest_points_of_segments_are_those_of_a_fine_grid():
    rng = np.random.default_rng(1)
    share = np.linspace(0, 1, 101)
    for k in range(200):
        a, b, c, d = rng.uniform(-1, 1, (4, 3))
        if k % 4 == 0:
            d = c + (b - a) * rng.uniform(-2, 2)  # parallel
        if k % 5 == 0:
            b = a  # points
        s, t = nearest_points(a, b, c, d)
        assert 0 <= s <= 1
        assert 0 <= t <= 1
        first, second = a + share[:, np.newaxis] * (b - a), c + share[:, np.newaxis] * (d - c)
        grid = np.linalg.norm(first[:, np.newaxis] - second, axis=2).min()
        found = np.linalg.norm(a + s * (b - a) - c - t * (d - c))
        assert found <= grid + 1e-12
        assert found >= grid - 0.03


def test_speeds_are_the_derivatives_of_the_distances(arm):
    rng, step = np.random.default_rng(2), 1e-6
    for _ in range(20):
        q, p_WH = random_posture(rng)
        qd = rng.uniform(-1, 1, 7)
        limbs = limb_segments(p_WH)
        found = approach(arm, np.array([q, q + step * qd]), np.array([qd, qd]), limbs, LIMB_RADII)
        # By the envelope theorem the nearest points' motion along the axes does not count.
        np.testing.assert_allclose(
            found.towards[0, :, :, 2], (found.length[0] - found.length[1]) / step, atol=1e-4, rtol=1e-3
        )
        assert np.all(found.towards <= found.speed + 1e-12)
        assert np.all(found.speed[:, 0] == 0)  # the base
