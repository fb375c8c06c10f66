"""The system that says where components are, as a scenario wants it."""

from functools import partial

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from pace_drake.errors import InputError
from pace_drake.perception import ComponentDetector
from pace_drake.stations.camera import pinhole_camera
from pace_drake.stations.components import camera_of, component_names, component_of
from pace_drake.stations.tags import tags_of
from pace_drake.stations.workcell import Workcell
from pace_drake.systems.component_locator import ComponentLocator, Wanted
from pace_drake.systems.true_poses import TruePoses
from pace_drake.task import ActionKind


def make_true_poses(workcell: Workcell, station: Diagram) -> TruePoses:
    """The truth about the components of a plant station."""
    plant: MultibodyPlant = station.GetSubsystemByName("plant")
    bodies = []
    for name in component_names(workcell):
        (index,) = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
        bodies.append(index)
    return TruePoses(bodies)


def make_component_locator(workcell: Workcell, reaction_period: float | None = None) -> ComponentLocator:
    """A locator that finds the workcell's components by their tags, on whichever table they lie.

    Raises:
        InputError: OpenCV is not installed, a component carries no tag, or a camera is missing.
    """
    names = component_names(workcell)
    detector = ComponentDetector(tags_of(names))
    looks = {}
    for camera in dict.fromkeys(camera_of(name) for name in names):
        if camera not in workcell.cameras or not workcell.cameras[camera].enabled:
            raise InputError(f"workcell.cameras.{camera}: must be there and enabled for perception=cameras")
        looks[camera] = partial(detector.detect, camera=pinhole_camera(workcell.cameras[camera]))

    def wanted(kind: ActionKind, index: int) -> Wanted | None:
        name = component_of(workcell, kind, index)
        return None if name is None else Wanted(name, camera_of(name))

    return ComponentLocator(names, looks, wanted, reaction_period=reaction_period)
