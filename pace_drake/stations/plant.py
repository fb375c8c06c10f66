"""The plant station: Panda, tables, cubes and the person as one Diagram with the ports that every station has."""

import numpy as np
from pydrake.geometry import (
    Box,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.multibody.parsing import LoadModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Gain, MatrixGain, Multiplexer, StateInterpolatorWithDiscreteDerivative

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations.camera import add_cameras
from pace_drake.stations.components import component_names
from pace_drake.stations.person import Person
from pace_drake.stations.tags import add_tags
from pace_drake.stations.workcell import Pose, Workcell

NUM_ARM_JOINTS = 7
NUM_FINGERS = 2


def add_workcell(plant: MultibodyPlant, scene_graph: SceneGraph, workcell: Workcell, *, free_cubes: bool) -> None:
    """Adds everything that stands in the workcell, the Panda included. The caller finalizes the plant.

    Model instances: those of ``models/workcell.dmd.yaml``, ``chair_side``, and ``cube_1``, ``tray_1``,
    ``allen_key_1``, ... in the order of the workcell's lists.

    Args:
        plant: not yet finalized, registered with ``scene_graph``.
        scene_graph: where cubes and trays get their colours.
        workcell: poses and colours.
        free_cubes: True lets the cubes move under contact, False welds them where they lie.
    """
    models = resource_path("models/package.xml").parent
    parser = Parser(plant, scene_graph)
    parser.SetAutoRenaming(True)
    parser.package_map().AddPackageXml(str(models / "package.xml"))
    ProcessModelDirectives(LoadModelDirectives(str(models / "workcell.dmd.yaml")), parser)

    def add(model: str, name: str, pose: Pose, *, weld: bool = True) -> RigidBody:
        (instance,) = parser.AddModels(str(models / f"{model}.sdf"))
        plant.RenameModelInstance(instance, name)
        body = plant.GetBodyByName(model, instance)
        if weld:
            plant.WeldFrames(plant.world_frame(), body.body_frame(), pose.to_rigid_transform())
        else:
            plant.SetDefaultFloatingBaseBodyPose(body, pose.to_rigid_transform())
        return body

    def paint(body: RigidBody, k: int) -> None:
        _paint(plant, scene_graph, body, Rgba(*workcell.colors[k % len(workcell.colors)]))

    add("chair_side", "chair_side", workcell.chair_side)
    for k, pose in enumerate(workcell.allen_keys):
        add("allen_key", f"allen_key_{k + 1}", pose)
    for k, pose in enumerate(workcell.trays):
        paint(add("tray", f"tray_{k + 1}", pose), k)
    for k, pose in enumerate(workcell.cubes):
        paint(add("cube", f"cube_{k + 1}", pose, weld=not free_cubes), k)
    add_tags(plant, component_names(workcell))


def _paint(plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody, color: Rgba) -> None:
    """Shows the collision boxes of a body that has no look of its own in its file."""
    inspector = scene_graph.model_inspector()
    for geometry_id in plant.GetCollisionGeometriesForBody(body):
        shape = inspector.GetShape(geometry_id)
        if isinstance(shape, Box):
            name = inspector.GetName(geometry_id).split("::")[-1]
            rgba = np.array([color.r(), color.g(), color.b(), color.a()])
            plant.RegisterVisualGeometry(body, inspector.GetPoseInFrame(geometry_id), shape, name, rgba)


def make_plant_station(
    workcell: Workcell,
    *,
    meshcat: Meshcat | None = None,
    initial_position: np.ndarray | None = None,
    cameras: bool = False,
) -> Diagram:
    """Makes the Diagram named "station" of the plant level.

    The arm's joints and the gripper follow their inputs under implicit proportional-derivative control, with gravity
    switched off for the Panda, as its own controller compensates it. The cubes rest on the sorting table by contact.

    Inputs:
        panda.position (7) [rad]: desired joint positions. Continuous in time; the desired velocity is its difference
            over one time step.
        gripper.position (1) [m]: desired width between the fingers.
        p_WH (3) [m]: the person's right hand. Kinematic: it is seen, and found by distance queries, but pushes nothing.

    Outputs:
        panda.position_measured (7) [rad]
        panda.velocity_estimated (7) [rad/s]
        panda.torque_external (7) [N m]: generalized contact forces, zero until the first step.
        gripper.state_measured (2) [m, m/s]: width and its rate.
        query_object: Drake's QueryObject of the SceneGraph.
        body_poses: the plant's list of X_WB, by body index.
        sorting_camera.color_image, sorting_camera.depth_image, ...: only with cameras; see ``add_cameras``.

    State: that of the discrete MultibodyPlant (time step ``workcell.time_step``), which starts at rest with the
    gripper open, and two samples of the desired position.

    Args:
        workcell: what stands where, gains, time step.
        meshcat: shows the station if given.
        initial_position: (7) [rad] where the arm starts; ``workcell.home`` by default.
        cameras: whether there are cameras over the tables.

    Raises:
        InputError: the workcell or the initial position cannot be used, or this machine cannot render for cameras.
    """
    workcell.validate()
    position = np.asarray(workcell.home if initial_position is None else initial_position, dtype=float)
    if position.shape != (NUM_ARM_JOINTS,) or not np.all(np.isfinite(position)):
        raise InputError(f"initial_position: must be {NUM_ARM_JOINTS} finite numbers [rad], is {position.tolist()}")

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=workcell.time_step, contact_model="point", discrete_contact_approximation="sap"),
        builder,
    )
    add_workcell(plant, scene_graph, workcell, free_cubes=True)
    panda = plant.GetModelInstanceByName("panda")
    plant.set_gravity_enabled(panda, False)
    for k in range(NUM_ARM_JOINTS):
        plant.GetJointActuatorByName(f"panda_actuator{k + 1}").set_controller_gains(
            PdControllerGains(p=workcell.proportional_gain[k], d=workcell.derivative_gain[k])
        )
    plant.GetJointActuatorByName("panda_finger_actuator").set_controller_gains(
        PdControllerGains(p=workcell.gripper_proportional_gain, d=workcell.gripper_derivative_gain)
    )
    plant.Finalize()
    finger = workcell.gripper_open / 2
    plant.SetDefaultPositions(panda, np.concatenate([position, [finger] * NUM_FINGERS]))

    # The actuated joints are the arm's and the first finger; the second finger mirrors it.
    desired_position = builder.AddNamedSystem("desired_position", Multiplexer([NUM_ARM_JOINTS, 1]))
    desired_finger = builder.AddNamedSystem("desired_finger", Gain(0.5, 1))
    desired_state = builder.AddNamedSystem(
        "desired_state", StateInterpolatorWithDiscreteDerivative(NUM_ARM_JOINTS + 1, workcell.reference_period)
    )
    builder.ExportInput(desired_position.get_input_port(0), "panda.position")
    builder.ExportInput(desired_finger.get_input_port(), "gripper.position")
    builder.Connect(desired_finger.get_output_port(), desired_position.get_input_port(1))
    builder.Connect(desired_position.get_output_port(), desired_state.get_input_port())
    # The implicit control law holds at the end of the step; the desired position is led there, or the arm would lag
    # by one step.
    num_desired = NUM_ARM_JOINTS + 1
    lead = np.eye(2 * num_desired)
    lead[:num_desired, num_desired:] = workcell.time_step * np.eye(num_desired)
    desired_state_lead = builder.AddNamedSystem("desired_state_lead", MatrixGain(lead))
    builder.Connect(desired_state.get_output_port(), desired_state_lead.get_input_port())
    builder.Connect(desired_state_lead.get_output_port(), plant.get_desired_state_input_port(panda))

    def export_rows(name: str, matrix: np.ndarray, source: str) -> None:
        rows = builder.AddNamedSystem(name, MatrixGain(matrix))
        builder.Connect(plant.GetOutputPort(source), rows.get_input_port())
        builder.ExportOutput(rows.get_output_port(), name)

    # State of the instance: 7 + 2 positions, then 7 + 2 velocities.
    num_joints = NUM_ARM_JOINTS + NUM_FINGERS
    state = np.eye(2 * num_joints)
    export_rows("panda.position_measured", state[:NUM_ARM_JOINTS], "panda_state")
    export_rows("panda.velocity_estimated", state[num_joints : num_joints + NUM_ARM_JOINTS], "panda_state")
    width = np.vstack([state[NUM_ARM_JOINTS:num_joints].sum(0), state[num_joints + NUM_ARM_JOINTS :].sum(0)])
    export_rows("gripper.state_measured", width, "panda_state")
    export_rows("panda.torque_external", np.eye(num_joints)[:NUM_ARM_JOINTS], "panda_generalized_contact_forces")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    builder.ExportOutput(plant.get_body_poses_output_port(), "body_poses")

    person = builder.AddNamedSystem("person", Person(scene_graph))
    builder.ExportInput(person.GetInputPort("p_WH"), "p_WH")
    builder.Connect(person.get_output_port(), scene_graph.get_source_pose_port(person.source_id))
    if cameras:
        sources = {
            plant.get_source_id(): plant.get_geometry_pose_output_port(),
            person.source_id: person.get_output_port(),
        }
        add_cameras(builder, scene_graph, sources, workcell.cameras)

    if meshcat is not None:
        # As fast as a replay is recorded: every picture costs as much as a step of the plant.
        pictures = MeshcatVisualizerParams(publish_period=1 / 16)
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, pictures)
    station = builder.Build()
    station.set_name("station")
    return station
