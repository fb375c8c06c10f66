"""How well cameras find the components, against where they were put."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from pace_drake.evaluate.tagged_scene import TaggedScene
from pace_drake.perception import ComponentDetector, UprightPose
from pace_drake.stations.camera import pinhole_camera
from pace_drake.stations.components import components
from pace_drake.stations.tags import tags_of
from pace_drake.stations.workcell import Camera, Pose, Workcell

#: [m] other heights of the cameras over the tables, besides the workcell's.
OTHER_HEIGHTS = (0.65, 1.1, 1.4)
_OTHERS_EVERY = 4  # placements: from there, one is looked at

#: How pictures are taken: as rendered; with a blurred and noisy picture and a noisy depth; colour alone.
PICTURES = ("ideal", "noisy", "no depth")

_BLUR = 0.7  # [px] standard deviation of the lens
_COLOR_NOISE = 5.0  # [of 255] standard deviation a pixel and channel
_DEPTH_NOISE = 0.002  # [1/m] standard deviation a pixel, times depth squared, as stereo has it: 1.4 mm at 0.85 m
_DEPTH_STEP = 0.001  # [m]

#: Where components are put: middle and half width of x and y [m], height of the origin [m], middle and half width of
#: the yaw [rad].
_ZONES = {
    "cube": ((0.35, 0.14), (-0.32, 0.08), 0.02, (0.0, np.pi)),
    "chair_side": ((0.35, 0.01), (0.66, 0.02), 0.0, (np.pi / 2, 0.1)),
    "allen_key": ((0.35, 0.10), (0.35, 0.05), 0.0, (0.0, np.pi)),
}
_APART = {"cube": 0.06, "chair_side": 0.0, "allen_key": 0.10}  # [m] between the origins of components of one kind


@dataclass(frozen=True)
class Measurement:
    """One component in one picture; the errors are None where it was not seen."""

    number: int
    """Of the placement, from 0."""
    component: str
    camera: str
    height: float
    """[m] of the camera over the table."""
    pictures: str
    """One of ``PICTURES``."""
    position_error: float | None
    """[m] distance of the found origin from the true one."""
    yaw_error: float | None
    """[rad] absolute."""


@dataclass(frozen=True)
class Hidden:
    """One component under a plate, seen all the same or not."""

    number: int
    component: str
    camera: str
    covered: str
    """``whole``, or ``half``: the plate's edge runs over the tags' middle; of the chair's side two tags stay free."""
    position_error: float | None
    """[m] None where it was not seen, as it should be where it is covered whole."""


@dataclass(frozen=True)
class View:
    """What a camera saw once, to be drawn."""

    camera: str
    color: np.ndarray
    """(height, width, 4) uint8."""
    tags: list[tuple[int, np.ndarray]]
    """Ids and corners (4, 2) [px]."""
    found: dict[str, UprightPose]


@dataclass(frozen=True)
class Evaluation:
    """All that was measured."""

    workcell: Workcell
    measurements: list[Measurement]
    hidden: list[Hidden]
    views: list[View]
    """Of the first placement, as rendered, from the workcell's own height: one a camera."""
    render_times: list[float]
    """[s] of wall time, of one colour and depth picture each."""
    detect_times: list[float]
    """[s] likewise, of finding everything in them."""


def working_height(workcell: Workcell, camera: str) -> float:
    """[m] of a camera over its table, as the workcell has it."""
    return workcell.cameras[camera].pose.translation[2]


def random_poses(workcell: Workcell, rng: np.random.Generator) -> dict[str, UprightPose]:
    """Poses of all components within their zones, apart from each other."""
    poses: dict[str, UprightPose] = {}
    for name in (component.name for component in components(workcell)):
        kind = _kind(name)
        (x, dx), (y, dy), z, (yaw, dyaw) = _ZONES[kind]
        others = [pose for other, pose in poses.items() if _kind(other) == kind]
        while True:
            u = rng.uniform(-1.0, 1.0, 3)
            p_WO = np.array([x + dx * u[0], y + dy * u[1], z])
            if all(np.linalg.norm(p_WO - other.p_WO) >= _APART[kind] for other in others):
                break
        poses[name] = UprightPose(p_WO, yaw + dyaw * u[2])
    return poses


def with_noise(color: np.ndarray, depth: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Pictures as a camera might take them: blur, noise of every pixel, rounded depth."""
    from scipy.ndimage import gaussian_filter

    blurred = gaussian_filter(color[:, :, :3].astype(np.float32), (_BLUR, _BLUR, 0))
    blurred += _COLOR_NOISE * rng.standard_normal(blurred.shape, dtype=np.float32)
    # Depth is not finite where nothing is in range: it stays so.
    noisy = depth + _DEPTH_NOISE * depth**2 * rng.standard_normal(depth.shape, dtype=np.float32)
    rounded = np.round(noisy / _DEPTH_STEP) * _DEPTH_STEP
    return np.clip(blurred.round(), 0, 255).astype(np.uint8), rounded


def evaluate(workcell: Workcell, num_poses: int, seed: int, done: Callable[[], None]) -> Evaluation:
    """Puts the components somewhere, looks, and compares; again and again.

    Args:
        workcell: components, cameras.
        num_poses: how often everything is placed anew.
        seed: of places, noise, and what is hidden; same seed, same figures.
        done: called after each placement.

    Raises:
        InputError: this machine cannot render, OpenCV is not installed, or a component carries no tag.
    """
    camera_of = {component.name: component.camera for component in components(workcell)}
    names = list(camera_of)
    detector = ComponentDetector(tags_of(names))
    used = tuple(dict.fromkeys(camera_of.values()))
    cameras = dict(_cameras_at_heights(workcell, used))
    scene = TaggedScene(workcell, {_key(name, height): camera for (name, height), camera in cameras.items()})
    result = Evaluation(workcell, [], [], [], [], [])
    for number in range(num_poses):
        rng = np.random.default_rng([seed, number])
        truth = random_poses(workcell, rng)
        scene.place(truth)
        for (name, height), camera in cameras.items():
            working = height == working_height(workcell, name)
            if not working and number % _OTHERS_EVERY:
                continue
            here = {component: pose for component, pose in truth.items() if camera_of[component] == name}
            start = perf_counter()
            color, depth = scene.look(_key(name, height))
            rendered = perf_counter()
            pinhole = pinhole_camera(camera)
            found = {"ideal": detector.detect(color, depth, pinhole)}
            if number > 0:  # the first picture pays for setting up
                result.render_times.append(rendered - start)
                result.detect_times.append(perf_counter() - rendered)
            noisy_color, noisy_depth = with_noise(color, depth, rng)
            found["noisy"] = detector.detect(noisy_color, noisy_depth, pinhole)
            found["no depth"] = detector.detect(noisy_color, None, pinhole)
            for pictures, poses in found.items():
                for component, pose in here.items():
                    errors = _errors(poses.get(component), pose)
                    result.measurements.append(Measurement(number, component, name, height, pictures, *errors))
            if number == 0 and working:
                result.views.append(View(name, color, detector.find_tags(color), found["ideal"]))
        for name in used:
            here = {component: pose for component, pose in truth.items() if camera_of[component] == name}
            component = list(here)[int(rng.integers(len(here)))]
            reach = 0.18 if component == "chair_side" else 0.04
            for covered, offset in (("whole", 0.0), ("half", reach)):
                scene.cover(component, truth[component], offset)
                height = working_height(workcell, name)
                seen = detector.detect(*scene.look(_key(name, height)), pinhole_camera(cameras[name, height]))
                scene.uncover()
                error, _ = _errors(seen.get(component), truth[component])
                result.hidden.append(Hidden(number, component, name, covered, error))
        done()
    return result


def _cameras_at_heights(workcell: Workcell, names: tuple[str, ...]) -> Iterator[tuple[tuple[str, float], Camera]]:
    for name in names:
        camera = workcell.cameras[name]
        x, y, working = camera.pose.translation
        for height in sorted({working, *OTHER_HEIGHTS}):
            yield (name, height), replace(camera, pose=Pose(translation=[x, y, height], rpy=camera.pose.rpy))


def _key(camera: str, height: float) -> str:
    return f"{camera} at {height:g} m"


def _kind(component: str) -> str:
    return component.rstrip("0123456789").rstrip("_")


def _errors(found: UprightPose | None, truth: UprightPose) -> tuple[float | None, float | None]:
    if found is None:
        return None, None
    turn = found.yaw - truth.yaw
    return float(np.linalg.norm(found.p_WO - truth.p_WO)), abs(float(np.arctan2(np.sin(turn), np.cos(turn))))
