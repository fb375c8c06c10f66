"""The plant station: Panda, tables, cubes and the person as one Diagram with the ports that every station has."""

from collections.abc import Iterable

import numpy as np
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import LoadModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains, RigidBody
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import (
    Gain,
    MatrixGain,
    Multiplexer,
    StateInterpolatorWithDiscreteDerivative,
)

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations.camera import add_cameras
from pace_drake.stations.components import components
from pace_drake.stations.contact_monitor import ContactMonitor
from pace_drake.stations.human_grip import HumanGrip
from pace_drake.stations.layout import Layout, nominal_layout
from pace_drake.stations.person import Person
from pace_drake.stations.robot_looks import wear_drake_models
from pace_drake.stations.tags import add_tags
from pace_drake.stations.workcell import Workcell
from pace_drake.task import NUM_ROBOT_DRAWS

NUM_ARM_JOINTS = 7
NUM_FINGERS = 2
_STILL = ("sorting_table", "warehouse_table", "assembly_table", "chair_base", "pedestal")
_POSE = 7  # numbers of a pose: a quaternion and a position


def add_furniture(plant: MultibodyPlant, scene_graph: SceneGraph, workcell: Workcell) -> Parser:
    """Adds what stands still, the Panda included. The caller finalizes the plant.

    Model instances: those of ``models/workcell.dmd.yaml``, and ``tray_1``, ... in the order of the workcell's list.

    Args:
        plant: not yet finalized, registered with ``scene_graph``.
        scene_graph: where trays get their colours.
        workcell: poses, colours and the Panda's looks.

    Returns:
        The parser, for more models.
    """
    models = resource_path("models/package.xml").parent
    parser = Parser(plant, scene_graph)
    parser.SetAutoRenaming(True)
    parser.package_map().AddPackageXml(str(models / "package.xml"))
    ProcessModelDirectives(LoadModelDirectives(str(models / "workcell.dmd.yaml")), parser)
    if workcell.robot_model == "drake_models":
        wear_drake_models(plant, scene_graph, plant.GetModelInstanceByName("panda"))
    for k, pose in enumerate(workcell.trays):
        body = _add_model(plant, parser, "tray", f"tray_{k + 1}")
        plant.WeldFrames(plant.world_frame(), body.body_frame(), pose.to_rigid_transform())
        _paint(plant, scene_graph, body, workcell, k)
    return parser


def add_components(plant: MultibodyPlant, scene_graph: SceneGraph, workcell: Workcell, parser: Parser) -> None:
    """Adds the components, free to move, where they nominally lie; model instances by ``components``' names.

    What stands still is touched by the small spheres of a component alone: they bear it, and pairs of boxes that never
    meet are what would take most of the time. Allen keys pass through the chair, into whose screws the
    person puts them, through the table under it, as the hand does, and through each other, as one hand holds both.
    """
    inspector = scene_graph.model_inspector()
    still, chair = (GeometrySet(_geometries_of(plant, names)) for names in (_STILL, ("chair_base",)))
    reached = GeometrySet(_geometries_of(plant, ("assembly_table",)))
    still.Add([g for k in range(len(workcell.trays)) for g in _geometries_of(plant, (f"tray_{k + 1}",))])
    boxes, keys = GeometrySet(), GeometrySet()
    for k, component in enumerate(components(workcell)):
        body = _add_model(plant, parser, component.model, component.name)
        plant.SetDefaultFloatingBaseBodyPose(body, component.nominal.to_rigid_transform())
        geometries = plant.GetCollisionGeometriesForBody(body)
        boxes.Add([geometry for geometry in geometries if isinstance(inspector.GetShape(geometry), Box)])
        if component.model == "cube":
            _paint(plant, scene_graph, body, workcell, k)
        elif component.model == "chair_side":
            chair.Add(geometries)
        else:
            keys.Add(geometries)
    passing = CollisionFilterDeclaration().ExcludeBetween(boxes, still).ExcludeBetween(keys, chair)
    passing.ExcludeBetween(keys, reached).ExcludeWithin(keys)
    scene_graph.collision_filter_manager().Apply(passing)
    add_tags(plant, [component.name for component in components(workcell)])


def _geometries_of(plant: MultibodyPlant, instances: Iterable[str]) -> list[GeometryId]:
    """Collision geometries of model instances."""
    return [
        geometry
        for instance in instances
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName(instance))
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    ]


def _add_model(plant: MultibodyPlant, parser: Parser, model: str, name: str) -> RigidBody:
    (instance,) = parser.AddModels(str(resource_path(f"models/{model}.sdf")))
    plant.RenameModelInstance(instance, name)
    return plant.GetBodyByName(model, instance)


def _paint(plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody, workcell: Workcell, k: int) -> None:
    """Shows the collision boxes of a body that has no look of its own in its file, in the k-th colour."""
    color = Rgba(*workcell.colors[k % len(workcell.colors)])
    inspector = scene_graph.model_inspector()
    for geometry_id in plant.GetCollisionGeometriesForBody(body):
        shape = inspector.GetShape(geometry_id)
        if isinstance(shape, Box):
            name = inspector.GetName(geometry_id).split("::")[-1]
            rgba = np.array([color.r(), color.g(), color.b(), color.a()])
            plant.RegisterVisualGeometry(body, inspector.GetPoseInFrame(geometry_id), shape, name, rgba)


class PlantStation(Diagram):
    """The station of the plant level, named "station".

    The arm's joints and the gripper follow their inputs under implicit proportional-derivative control, with gravity
    switched off for the Panda, as its own controller compensates it. Components lie about and are held by contact and
    friction alone. Make it with ``make_plant_station``.

    Inputs:
        panda.position (7) [rad]: desired joint positions. Continuous in time; the desired velocity is its difference
            over one time step.
        gripper.position (1) [m]: desired width between the fingers.
        p_WH (3) [m]: the person's right hand. Kinematic: it is seen, and found by distance queries, and pushes nothing,
            but it takes a key that is held out to it (``HumanGrip``).

    Outputs:
        panda.position_measured (7) [rad]
        panda.velocity_estimated (7) [rad/s]
        panda.torque_external (7) [N m]: generalized contact forces, zero until the first step.
        gripper.state_measured (2) [m, m/s]: width and its rate.
        component_poses (7 n): quaternion w, x, y, z (not normalised) and position [m] of each component, in the order
            of ``pace_drake.stations.components.components``: the truth.
        key_taken: see ``HumanGrip``.
        contact (2): see ``ContactMonitor``.
        contact_results: Drake's ContactResults.
        query_object: Drake's QueryObject of everything that is seen, the person included.
        sorting_camera.color_image, sorting_camera.depth_image, ...: only with cameras; see ``add_cameras``.

    State: that of the discrete MultibodyPlant (time step ``workcell.time_step``), which starts at rest with the
    gripper open, two samples of the desired position, and which keys the person has.

    Parameters: of the system "pile", where a cube lies when the pile is refilled with it (``Layout.pile``).

    Attributes:
        workcell: what it was made from.
        plant: Drake's.
        scene_graph: what touches; ``seen_scene`` has everything that is seen, too.
        components: what the robot can fetch.
    """

    def __init__(self, workcell: Workcell, meshcat: Meshcat | None, position: np.ndarray, cameras: bool) -> None:
        super().__init__()
        self.workcell = workcell
        self.components = components(workcell)
        builder = DiagramBuilder()
        self.plant, self.scene_graph = plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=workcell.time_step,
                contact_model="point",
                discrete_contact_approximation="sap",
                # Sampled outputs need an unrestricted update, which has every system of the diagram computed anew.
                use_sampled_output_ports=False,
                # At Drake's 1.0 a gripped thing sinks millimetres into the fingers; at 0.1 it is kicked when let go.
                sap_near_rigid_threshold=0.3,
            ),
            builder,
        )
        add_components(plant, scene_graph, workcell, add_furniture(plant, scene_graph, workcell))
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
        self._bodies = [
            plant.GetBodyByName(component.model, plant.GetModelInstanceByName(component.name))
            for component in self.components
        ]
        self._add_control(builder)
        self._add_outputs(builder)
        # What is only seen stands in a scene of its own, the person in no other, which is updated when somebody looks:
        # the plant asks its own for all poses at every step.
        seen = builder.AddNamedSystem("seen_scene", scene_graph.Clone())
        builder.Connect(plant.get_geometry_pose_output_port(), seen.get_source_pose_port(plant.get_source_id()))
        inspector = scene_graph.model_inspector()
        for geometry in inspector.GetAllGeometryIds():
            if inspector.GetProximityProperties(geometry) is None:
                scene_graph.RemoveGeometry(plant.get_source_id(), geometry)
        self._add_person(builder, seen)
        builder.ExportOutput(seen.get_query_output_port(), "query_object")
        if cameras:
            add_cameras(builder, seen, workcell.cameras)
        self._pile = builder.AddNamedSystem("pile", _Pile(nominal_layout(workcell)))
        if meshcat is not None:
            # As a replay is recorded, and Meshcat interpolates; every picture costs as much as a step of the plant.
            pictures = MeshcatVisualizerParams(publish_period=1 / 10)
            MeshcatVisualizer.AddToBuilder(builder, seen, meshcat, pictures)
        builder.BuildInto(self)
        self.set_name("station")

    def set_layout(self, context: Context, layout: Layout) -> None:
        """Puts every component where an episode begins, into the station's or the whole diagram's context."""
        for k, located in enumerate(layout.located):
            self._put(context, k, located)
        pile = self._pile.GetMyMutableContextFromRoot(context)
        pile.get_mutable_numeric_parameter(0).SetFromVector(layout.pile.ravel())

    def refill(self, context: Context, cube: int, sequence: int) -> None:
        """Puts a cube that has been taken out of the pile back into it, as a person would who empties the trays.

        Args:
            context: the station's or the whole diagram's.
            cube: index.
            sequence: number of the command that will fetch it.
        """
        component = self.components[cube]
        p_WO = self.component_pose(context, cube).translation()
        reach = np.array(component.spread[:2]) + 0.02  # it may have been nudged
        if np.all(np.abs(p_WO[:2] - component.located[:2]) <= reach) and p_WO[2] < 0.03:
            return
        parameter = self._pile.GetMyContextFromRoot(context).get_numeric_parameter(0).value()
        pile = parameter.reshape(NUM_ROBOT_DRAWS, -1, 3)
        self._put(context, cube, pile[(sequence - 1) % NUM_ROBOT_DRAWS, cube])

    def component_pose(self, context: Context, k: int) -> RigidTransform:
        """X_WO of a component."""
        return self.plant.EvalBodyPoseInWorld(self.plant.GetMyContextFromRoot(context), self._bodies[k])

    def _put(self, context: Context, k: int, located: np.ndarray) -> None:
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, self._bodies[k], self.components[k].pose(located))
        self.plant.SetFreeBodySpatialVelocity(plant_context, self._bodies[k], SpatialVelocity.Zero())

    def _add_control(self, builder: DiagramBuilder) -> None:
        # The actuated joints are the arm's and the first finger; the second finger mirrors it.
        panda = self.plant.GetModelInstanceByName("panda")
        desired_position = builder.AddNamedSystem("desired_position", Multiplexer([NUM_ARM_JOINTS, 1]))
        desired_finger = builder.AddNamedSystem("desired_finger", Gain(0.5, 1))
        desired_state = builder.AddNamedSystem(
            "desired_state",
            StateInterpolatorWithDiscreteDerivative(NUM_ARM_JOINTS + 1, self.workcell.reference_period),
        )
        builder.ExportInput(desired_position.get_input_port(0), "panda.position")
        builder.ExportInput(desired_finger.get_input_port(), "gripper.position")
        builder.Connect(desired_finger.get_output_port(), desired_position.get_input_port(1))
        builder.Connect(desired_position.get_output_port(), desired_state.get_input_port())
        # The implicit control law holds at the end of the step; the desired position is led there, or the arm would
        # lag by one step.
        num_desired = NUM_ARM_JOINTS + 1
        lead = np.eye(2 * num_desired)
        lead[:num_desired, num_desired:] = self.workcell.time_step * np.eye(num_desired)
        desired_state_lead = builder.AddNamedSystem("desired_state_lead", MatrixGain(lead))
        builder.Connect(desired_state.get_output_port(), desired_state_lead.get_input_port())
        builder.Connect(desired_state_lead.get_output_port(), self.plant.get_desired_state_input_port(panda))

    def _add_outputs(self, builder: DiagramBuilder) -> None:
        plant = self.plant

        def rows(name: str, matrix: np.ndarray, source: str) -> OutputPort:
            gain = builder.AddNamedSystem(name, MatrixGain(matrix))
            builder.Connect(plant.GetOutputPort(source), gain.get_input_port())
            return gain.get_output_port()

        # State of the instance: 7 + 2 positions, then 7 + 2 velocities.
        num_joints = NUM_ARM_JOINTS + NUM_FINGERS
        state = np.eye(2 * num_joints)
        width = np.vstack([state[NUM_ARM_JOINTS:num_joints].sum(0), state[num_joints + NUM_ARM_JOINTS :].sum(0)])
        for name, matrix, source in (
            ("panda.position_measured", state[:NUM_ARM_JOINTS], "panda_state"),
            ("panda.velocity_estimated", state[num_joints : num_joints + NUM_ARM_JOINTS], "panda_state"),
            ("gripper.state_measured", width, "panda_state"),
            ("panda.torque_external", np.eye(num_joints)[:NUM_ARM_JOINTS], "panda_generalized_contact_forces"),
        ):
            builder.ExportOutput(rows(name, matrix, source), name)
        poses = builder.AddNamedSystem("component_poses", Multiplexer([_POSE] * len(self.components)))
        for k, component in enumerate(self.components):
            pose = rows(f"{component.name}.pose", np.eye(2 * _POSE - 1)[:_POSE], f"{component.name}_state")
            builder.Connect(pose, poses.get_input_port(k))
        builder.ExportOutput(poses.get_output_port(), "component_poses")
        contact = builder.AddSystem(ContactMonitor(plant))
        builder.Connect(plant.get_contact_results_output_port(), contact.get_input_port())
        builder.ExportOutput(contact.get_output_port(), "contact")
        builder.ExportOutput(plant.get_contact_results_output_port(), "contact_results")

    def _add_person(self, builder: DiagramBuilder, seen: SceneGraph) -> None:
        person = builder.AddNamedSystem("person", Person(seen))
        builder.ExportInput(person.GetInputPort("p_WH"), "p_WH")
        builder.Connect(person.get_output_port(), seen.get_source_pose_port(person.source_id))
        keys = [
            (component, body)
            for component, body in zip(self.components, self._bodies, strict=True)
            if component.model == "allen_key"
        ]
        grip = builder.AddSystem(HumanGrip([body for _, body in keys], self.workcell.release_distance))
        builder.ConnectInput("p_WH", grip.GetInputPort("p_WH"))
        for k, (component, _) in enumerate(keys):
            builder.Connect(self.plant.GetOutputPort(f"{component.name}_state"), grip.GetInputPort(f"key_{k + 1}"))
        builder.Connect(grip.GetOutputPort("applied_spatial_force"), self.plant.get_applied_spatial_force_input_port())
        builder.ExportOutput(grip.GetOutputPort("key_taken"), "key_taken")


class _Pile(LeafSystem):
    """Where cubes lie when the pile is refilled: a parameter of the context, as it is drawn for each episode."""

    def __init__(self, layout: Layout) -> None:
        super().__init__()
        self.DeclareNumericParameter(BasicVector(layout.pile.ravel()))


def make_plant_station(
    workcell: Workcell,
    *,
    meshcat: Meshcat | None = None,
    initial_position: np.ndarray | None = None,
    cameras: bool = False,
) -> PlantStation:
    """Makes the station of the plant level.

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
    return PlantStation(workcell, meshcat, position, cameras)
