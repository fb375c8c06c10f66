"""ContactMonitor on a small plant: three balls of a robot and one of something else."""

import numpy as np
import pytest
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from pace_drake.stations.contact_monitor import ContactMonitor

RADIUS = 0.05


@pytest.fixture(scope="module")
def balls():
    """contact(positions) of the robot's balls a, b, c and of the ball d, which are put there."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.01)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
    robot, other = plant.AddModelInstance("panda"), plant.AddModelInstance("other")
    bodies = [
        plant.AddRigidBody(name, instance, inertia)
        for name, instance in (("a", robot), ("b", robot), ("c", robot), ("d", other))
    ]
    for body in bodies:
        friction = CoulombFriction(0.5, 0.5)
        plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(RADIUS), body.name(), friction)
    plant.SetUseSampledOutputPorts(False)  # contacts at the present positions, without a step
    plant.Finalize()
    dut = builder.AddSystem(ContactMonitor(plant))
    builder.Connect(plant.get_contact_results_output_port(), dut.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)

    def contact(*positions):
        for body, p_WO in zip(bodies, positions, strict=True):
            plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, RigidTransform(np.array(p_WO)))
        return dut.get_output_port().Eval(dut.GetMyContextFromRoot(context)).tolist()

    contact.diagram = diagram  # which must live on
    return contact


A, B, C, D = ([x, 0.0, 0.0] for x in (0.0, 1.0, 2.0, 3.0))


def test_without_contact_both_are_0(balls):
    assert balls(A, B, C, D) == [0, 0]
    assert balls(A, [2 * RADIUS + 1e-6, 0.0, 0.0], C, D) == [0, 0]


def test_the_deepest_penetration_of_all(balls):
    deepest, _ = balls(A, B, [2.0, 0.0, 0.0], [2.0, 0.0, 2 * RADIUS - 0.003])
    assert deepest == pytest.approx(0.003)
    deepest, _ = balls(A, [0.0, 2 * RADIUS - 0.001, 0.0], C, [2.0, 0.0, 2 * RADIUS - 0.003])
    assert deepest == pytest.approx(0.003)
    deepest, _ = balls(A, [0.0, 2 * RADIUS - 0.007, 0.0], C, [2.0, 0.0, 2 * RADIUS - 0.003])
    assert deepest == pytest.approx(0.007)


def test_only_contacts_of_the_robot_with_itself_are_counted(balls):
    near = 2 * RADIUS - 0.001
    assert balls(A, B, C, [near, 0.0, 0.0])[1] == 0  # something touches the robot
    assert balls(A, [near, 0.0, 0.0], C, D)[1] == 1
    assert balls(A, [near, 0.0, 0.0], [0.0, near, 0.0], D)[1] == 2
    assert balls(A, [near, 0.0, 0.0], [0.0, near, 0.0], [-near, 0.0, 0.0])[1] == 2
