"""Where things stand in the workcell, and how the arm is driven: one typed configuration for plant and motions."""

from dataclasses import dataclass, field
from math import isfinite, pi

from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.errors import InputError


@dataclass(kw_only=True)
class Pose:
    """A pose X_WF of some frame F in the world frame W (robot base at the origin, x forward, z = 0 the table top)."""

    translation: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """[m] x, y, z."""
    rpy: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """[rad] roll, pitch, yaw. A gripper that points straight down has roll pi."""

    def to_rigid_transform(self) -> RigidTransform:
        """Returns the pose as Drake's type."""
        return RigidTransform(RollPitchYaw(self.rpy), self.translation)

    def validate(self, name: str) -> None:
        """Raises InputError that names the field if a value cannot be used."""
        _require_numbers(self.translation, 3, f"{name}.translation")
        _require_numbers(self.rpy, 3, f"{name}.rpy")


@dataclass(kw_only=True)
class Presentation:
    """Where the gripper waits for the human before a joint action, and where the joint action ends."""

    prepared: Pose = field(default_factory=Pose)
    """X_WG of the gripper (frame ``panda_hand_tcp``) when the robot is prepared."""
    end: Pose = field(default_factory=Pose)
    """X_WG when the joint action ends."""


@dataclass(kw_only=True)
class Camera:
    """A colour and depth camera; both pictures have the same pose and lens, without distortion."""

    pose: Pose = field(default_factory=Pose)
    """X_WC; z forward, x right and y down in the picture."""
    width: int = 1280
    """[px]"""
    height: int = 720
    """[px]"""
    fov_y: float = 0.6
    """[rad] angle of view from the picture's upper to its lower edge."""
    enabled: bool = True
    """Whether there is one."""

    def validate(self, name: str) -> None:
        """Raises InputError that names the field if a value cannot be used."""
        self.pose.validate(f"{name}.pose")
        for attribute in ("width", "height"):
            if not 16 <= getattr(self, attribute) <= 8192:
                raise InputError(f"{name}.{attribute}: must lie in [16, 8192] [px], is {getattr(self, attribute)}")
        if not 0 < self.fov_y < pi:
            raise InputError(f"{name}.fov_y: must lie in (0, pi) [rad], is {self.fov_y}")


def _cameras() -> dict[str, Camera]:
    # Straight down from above the middle of each table, all of which is seen, the picture's longer side along its.
    places = {
        "sorting_camera": [0.35, -0.50, 0.85],
        "warehouse_camera": [0.35, 0.55, 0.85],
        "assembly_camera": [0.85, 0.0, 0.97],
    }
    return {name: Camera(pose=Pose(translation=p_WC, rpy=[pi, 0.0, pi / 2])) for name, p_WC in places.items()}


def _down(x: float, y: float, z: float, *, pitch: float = 0.0) -> Pose:
    return Pose(translation=[x, y, z], rpy=[pi, pitch, 0.0])


def _presentations() -> list[Presentation]:
    return [
        # The chair's side over the near edge of the assembly table, then lowered onto the rails.
        Presentation(prepared=_down(0.56, 0.0, 0.40), end=_down(0.65, 0.0, 0.29)),
        # The Allen keys, gripper tilted towards the person, then held out a little further.
        Presentation(prepared=_down(0.60, 0.10, 0.30, pitch=-pi / 3), end=_down(0.66, 0.10, 0.28, pitch=-pi / 3)),
        Presentation(prepared=_down(0.60, -0.10, 0.30, pitch=-pi / 3), end=_down(0.66, -0.10, 0.28, pitch=-pi / 3)),
    ]


@dataclass(kw_only=True)
class Workcell:
    """The workcell of the plant level: placed objects, poses used by the motions, limits and gains.

    Tables, pedestal and the chair under assembly stand in ``models/workcell.dmd.yaml``; everything that a motion
    refers to is placed by this class, so that scene and motions cannot disagree.
    """

    time_step: float = 0.005
    """[s] of the discrete plant."""
    reference_period: float = 0.01
    """[s] over which desired positions are differenced to desired velocities. A reference that changes in steps should
    change once in this period; a continuous one may take any."""

    home: list[float] = field(default_factory=lambda: [0.0, -pi / 4, 0.0, -3 * pi / 4, 0.0, pi / 2, pi / 4])
    """[rad] (7) the arm's home position: Franka's "ready" pose."""
    proportional_gain: list[float] = field(
        default_factory=lambda: [6000.0, 6000.0, 6000.0, 5000.0, 5000.0, 4000.0, 4000.0]
    )
    """[N m/rad] (7) joint stiffness: twice the default joint impedance of the Franka Control Interface."""
    derivative_gain: list[float] = field(default_factory=lambda: [150.0, 150.0, 120.0, 100.0, 60.0, 50.0, 50.0])
    """[N m s/rad] (7) joint damping."""
    gripper_proportional_gain: float = 2000.0
    """[N/m] stiffness of the finger actuator."""
    gripper_derivative_gain: float = 80.0
    """[N s/m] damping of the finger actuator."""

    cubes: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, y, 0.02]) for x in (0.33, 0.41) for y in (-0.27, -0.35)]
    )
    """X_WO of the cubes' centres in the pile on the sorting table; robot task i takes cube i, cyclically."""
    trays: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, y, 0.0]) for x in (0.27, 0.43) for y in (-0.49, -0.63)]
    )
    """X_WO of the centres of the trays' lower faces; robot task i ends over tray i, cyclically."""
    colors: list[list[float]] = field(
        default_factory=lambda: [
            [0.86, 0.22, 0.20, 1.0],
            [0.98, 0.75, 0.18, 1.0],
            [0.18, 0.62, 0.38, 1.0],
            [0.16, 0.44, 0.80, 1.0],
        ]
    )
    """[0..1] red, green, blue, alpha of cube and tray i, cyclically."""

    chair_side: Pose = field(default_factory=lambda: Pose(translation=[0.35, 0.66, 0.0], rpy=[0.0, 0.0, pi / 2]))
    """X_WO of the chair's loose side on the warehouse table: fetched for joint action 1."""
    allen_keys: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, 0.38, 0.0], rpy=[0.0, 0.0, 0.3]) for x in (0.28, 0.44)]
    )
    """X_WO of the Allen keys on the warehouse table: fetched for joint actions 2, 3, ..., cyclically."""
    presentations: list[Presentation] = field(default_factory=_presentations)
    """For joint action 1 (the chair's side), then for 2, 3, ..., which take the rest cyclically."""
    cameras: dict[str, Camera] = field(default_factory=_cameras)
    """Over the tables, by name; they are there where ``perception`` is ``cameras``."""

    grasp_standoff: float = 0.03
    """[m] height of the gripper's TCP over the object's top where it would grasp it."""
    approach_height: float = 0.12
    """[m] length of the straight way down to a grasp and up from it."""
    gripper_open: float = 0.07
    """[m] width of the open gripper, at home and on the way to a grasp."""
    gripper_closed: float = 0.045
    """[m] width of the closed gripper."""
    gripper_speed: float = 0.08
    """[m/s] rate at which the width changes (the Franka Hand allows 0.1)."""

    velocity_scale: float = 0.75
    """[-] share of the joint velocity limits that a motion may use."""
    acceleration_scale: float = 0.5
    """[-] share of the joint acceleration limits that a motion may use."""
    clearance: float = 0.015
    """[m] least distance between the arm and anything else, itself included, along every motion."""
    seed: int = 0
    """Seed of the restarts of inverse kinematics."""

    def validate(self, name: str = "workcell") -> None:
        """Raises InputError that names the field if a value cannot be used."""
        for attribute in (
            "time_step",
            "reference_period",
            "gripper_proportional_gain",
            "gripper_derivative_gain",
            "grasp_standoff",
            "approach_height",
            "gripper_speed",
            "velocity_scale",
            "acceleration_scale",
            "clearance",
        ):
            value = getattr(self, attribute)
            if not (isfinite(value) and value > 0):
                raise InputError(f"{name}.{attribute}: must be > 0, is {value}")
        for attribute in ("velocity_scale", "acceleration_scale"):
            if getattr(self, attribute) > 1:
                raise InputError(f"{name}.{attribute}: must be <= 1, is {getattr(self, attribute)}")
        if not 0 <= self.gripper_closed <= self.gripper_open <= MAX_GRIPPER_WIDTH:
            raise InputError(
                f"{name}.gripper_open: 0 <= gripper_closed <= gripper_open <= {MAX_GRIPPER_WIDTH} [m] must hold,"
                f" are {self.gripper_closed} and {self.gripper_open}"
            )
        for attribute in ("home", "proportional_gain", "derivative_gain"):
            _require_numbers(getattr(self, attribute), 7, f"{name}.{attribute}")
        for attribute in ("proportional_gain", "derivative_gain"):
            if min(getattr(self, attribute)) <= 0:
                raise InputError(f"{name}.{attribute}: every gain must be > 0, are {getattr(self, attribute)}")
        for attribute, least in (
            ("cubes", 1),
            ("trays", 1),
            ("colors", 1),
            ("allen_keys", 1),
            ("presentations", 2),
        ):
            if len(getattr(self, attribute)) < least:
                raise InputError(f"{name}.{attribute}: needs at least {least}, has {len(getattr(self, attribute))}")
        for attribute in ("cubes", "trays", "allen_keys"):
            for k, pose in enumerate(getattr(self, attribute)):
                pose.validate(f"{name}.{attribute}[{k}]")
        self.chair_side.validate(f"{name}.chair_side")
        for k, presentation in enumerate(self.presentations):
            presentation.prepared.validate(f"{name}.presentations[{k}].prepared")
            presentation.end.validate(f"{name}.presentations[{k}].end")
        for camera_name, camera in self.cameras.items():
            camera.validate(f"{name}.cameras.{camera_name}")
        for k, color in enumerate(self.colors):
            _require_numbers(color, 4, f"{name}.colors[{k}]")
            if not all(0 <= channel <= 1 for channel in color):
                raise InputError(f"{name}.colors[{k}]: every channel must lie in [0, 1], are {color}")


MAX_GRIPPER_WIDTH = 0.08
"""[m] stroke of the Franka Hand, 0.04 a finger."""


def _require_numbers(values: list[float], size: int, name: str) -> None:
    if len(values) != size or not all(isfinite(value) for value in values):
        raise InputError(f"{name}: must be {size} finite numbers, is {values}")
