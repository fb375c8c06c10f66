"""The system that finds a workcell's components with its cameras."""

from functools import partial

from pace_drake.errors import InputError
from pace_drake.perception import ComponentDetector
from pace_drake.stations.camera import pinhole_camera
from pace_drake.stations.components import component_index, components
from pace_drake.stations.tags import tags_of
from pace_drake.stations.workcell import Workcell
from pace_drake.systems.component_locator import ComponentLocator, Wanted
from pace_drake.task import ActionKind


def make_component_locator(workcell: Workcell, reaction_period: float | None = None) -> ComponentLocator:
    """A locator that finds the workcell's components by their tags, on whichever table they lie.

    Raises:
        InputError: OpenCV is not installed, a component carries no tag, or a camera is missing.
    """
    found = components(workcell)
    names = [component.name for component in found]
    detector = ComponentDetector(tags_of(names))
    looks = {}
    for camera in dict.fromkeys(component.camera for component in found):
        if camera not in workcell.cameras or not workcell.cameras[camera].enabled:
            raise InputError(f"workcell.cameras.{camera}: must be there and enabled for perception=cameras")
        looks[camera] = partial(detector.detect, camera=pinhole_camera(workcell.cameras[camera]))

    def wanted(kind: ActionKind, index: int) -> Wanted | None:
        number = component_index(workcell, kind, index)
        return None if number is None else Wanted(found[number].name, found[number].camera)

    return ComponentLocator(names, looks, wanted, reaction_period=reaction_period)
