"""How the Panda looks: its own simple shapes, or the meshes of Drake's model package."""

from pathlib import Path

from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from pace_drake.errors import InputError

_URL = "package://drake_models/franka_description/urdf/panda_arm_hand.urdf"


def wear_drake_models(
    plant: MultibodyPlant, scene_graph: SceneGraph, panda: ModelInstanceIndex, package: Path | None = None
) -> None:
    """Replaces the visual shapes of the Panda by those of the links of the same names in Drake's model.

    Only looks change: joints, limits, masses, actuators, collision shapes and frames stay those of ``panda.urdf``,
    whose link frames are laid as in Franka's description.

    Args:
        plant: not yet finalized, registered with ``scene_graph``.
        scene_graph: holds the visual shapes.
        panda: the instance whose looks change.
        package: a copy of ``drake_models``; None lets Drake fetch it at the first use.

    Raises:
        InputError: the package cannot be had, or its arm is not built from the same links in the same frames.
    """
    # Drake's parser wants a plant; this one only lends its shapes, for as long as its builder lives.
    builder = DiagramBuilder()
    other, other_graph = AddMultibodyPlant(MultibodyPlantConfig(), builder)
    parser = Parser(other, other_graph)
    if package is not None:
        parser.package_map().Remove("drake_models")
        parser.package_map().Add("drake_models", str(package))
    try:
        (model,) = parser.AddModels(url=_URL)
    except RuntimeError as error:
        raise InputError(
            "workcell.robot_model: drake_models cannot be had; Drake fetches it once from the internet. Be online, or"
            f" use pace_drake ({' '.join(str(error).split())[:160]})"
        ) from error
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(panda)]
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(panda)]
    for body in bodies:
        if not other.HasBodyNamed(body.name(), model):
            raise InputError(f"workcell.robot_model: {_URL} has no link {body.name()}; use pace_drake")
    for joint in joints:
        if joint.num_positions() == 0:
            continue
        places = [
            whose.GetJointByName(joint.name(), instance).frame_on_parent().GetFixedPoseInBodyFrame()
            for whose, instance in ((plant, panda), (other, model))
            if whose.HasJointNamed(joint.name(), instance)
        ]
        if len(places) < 2 or not places[0].IsNearlyEqualTo(places[1], 1e-3):
            raise InputError(f"workcell.robot_model: {_URL} has {joint.name()} in another place; use pace_drake")

    inspector = other_graph.model_inspector()
    for body in bodies:
        frame = plant.GetBodyFrameIdOrThrow(body.index())
        for role in (Role.kIllustration, Role.kPerception):
            scene_graph.RemoveRole(plant.get_source_id(), frame, role)
        for geometry_id in other.GetVisualGeometriesForBody(other.GetBodyByName(body.name(), model)):
            plant.RegisterVisualGeometry(body, inspector.CloneGeometryInstance(geometry_id))
