"""Where things stand in the workcell, and how the arm is driven: one typed configuration for plant and motions."""

from dataclasses import dataclass, field
from math import isfinite, pi

from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.errors import InputError

ROBOT_MODELS = ("pace_drake", "drake_models")
"""Whose shapes the Panda shows: our own simple ones, or the meshes of Drake's model package."""


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
    """How a key is handed over: two poses of the gripper (frame ``panda_hand_tcp``), a place of the person's hand."""

    prepared: Pose = field(default_factory=Pose)
    """X_WG where the robot, prepared, waits for the person."""
    end: Pose = field(default_factory=Pose)
    """X_WG where it holds the thing out."""
    hand: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """[m] p_WH where the person's hand takes it."""

    def validate(self, name: str) -> None:
        """Raises InputError that names the field if a value cannot be used."""
        self.prepared.validate(f"{name}.prepared")
        self.end.validate(f"{name}.end")
        _require_numbers(self.hand, 3, f"{name}.hand")


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


def _presentations() -> list[Presentation]:
    # The gripper tilted towards the person; then held out a little further, the key's short end up to the person.
    return [
        Presentation(
            prepared=Pose(translation=[0.56, y, 0.32], rpy=[pi, -pi / 4, 0.0]),
            end=Pose(translation=[0.64, y, 0.32], rpy=[pi, -pi / 4, 0.0]),
            hand=[0.71, y, 0.39],
        )
        for y in (0.10, -0.10)
    ]


@dataclass(kw_only=True)
class Workcell:
    """The workcell of the plant level: placed objects, poses used by the motions, limits and gains.

    Tables, pedestal and the chair under assembly stand in ``models/workcell.dmd.yaml``; everything that a motion
    refers to is placed by this class, so that scene and motions cannot disagree.
    """

    robot_model: str = "pace_drake"
    """How the Panda looks: ``pace_drake`` or ``drake_models`` (Drake's meshes, from the internet at the first use)."""
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
    gripper_proportional_gain: float = 8000.0
    """[N/m] stiffness of the finger actuator."""
    gripper_derivative_gain: float = 160.0
    """[N s/m] damping of the finger actuator."""

    cubes: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, y, 0.02]) for x in (0.29, 0.41) for y in (-0.25, -0.36)]
    )
    """X_WO of the cubes' centres in the pile on the sorting table; robot task i takes cube i, cyclically."""
    cube_spread: list[float] = field(default_factory=lambda: [0.01, 0.01, 0.4])
    """[m, m, rad] a cube lies at most this far from its place in the pile: x, y, yaw, each drawn evenly."""
    trays: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, y, 0.0]) for x in (0.27, 0.43) for y in (-0.49, -0.63)]
    )
    """X_WO of the centres of the trays' lower faces; robot task i puts its cube into tray i, cyclically."""
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
    chair_side_spread: list[float] = field(default_factory=lambda: [0.008, 0.015, 0.06])
    """[m, m, rad] as ``cube_spread``; its feet must stay on the table."""
    chair_side_prepared: Pose = field(default_factory=lambda: Pose(translation=[0.66, 0.0, 0.37]))
    """X_WO where the robot, prepared, holds the chair's side until the person takes the far end."""
    chair_side_placed: Pose = field(default_factory=lambda: Pose(translation=[0.80, 0.0, 0.225]))
    """X_WO of the chair's side on the rails, where robot and person carry it."""
    allen_keys: list[Pose] = field(
        default_factory=lambda: [Pose(translation=[x, 0.38, 0.0], rpy=[0.0, 0.0, 0.3 - pi]) for x in (0.26, 0.44)]
    )
    """X_WO of the Allen keys on the warehouse table: fetched for joint actions 2, 3, ..., cyclically."""
    allen_key_spread: list[float] = field(default_factory=lambda: [0.015, 0.015, 0.3])
    """[m, m, rad] as ``cube_spread``."""
    presentations: list[Presentation] = field(default_factory=_presentations)
    """For joint actions 2, 3, ..., which take them cyclically."""
    cameras: dict[str, Camera] = field(default_factory=_cameras)
    """Over the tables, by name; they are there where ``perception`` is ``cameras``."""

    approach_height: float = 0.10
    """[m] length of the straight way down to a grasp and up from it."""
    carry_height: float = 0.33
    """[m] at least as high above the table is the chair's side carried."""
    release_gap: float = 0.002
    """[m] between a thing and what it is put on, when the gripper opens."""
    release_distance: float = 0.05
    """[m] a key is let go when the person's hand is within this of where it takes it."""
    gripper_open: float = 0.06
    """[m] width of the open gripper, at home and on the way to a grasp."""
    gripper_release: float = 0.052
    """[m] width to which it opens to let go of something between other things."""
    gripper_squeeze: float = 0.016
    """[m] by which the desired width of the closed gripper is less than that of what it holds; with the gain this gives
    the force: 32 N a finger."""
    gripper_speed: float = 0.1
    """[m/s] rate at which the width changes, the Franka Hand's."""
    grip_time: float = 0.1
    """[s] the arm rests after the gripper has closed or opened."""

    velocity_scale: float = 0.8
    """[-] share of the joint velocity limits that a motion may use."""
    acceleration_scale: float = 0.6
    """[-] share of the joint acceleration limits that a motion may use."""
    clearance: float = 0.015
    """[m] least distance between the arm, with what it carries, and anything else, itself included, in every motion."""
    contact_clearance: float = 0.003
    """[m] likewise on the straight way to a grasp or a place and back, but for what is gripped or put down on."""
    seed: int = 0
    """Seed of the restarts of inverse kinematics."""

    def validate(self, name: str = "workcell") -> None:
        """Raises InputError that names the field if a value cannot be used."""
        if self.robot_model not in ROBOT_MODELS:
            raise InputError(f"{name}.robot_model: must be one of {', '.join(ROBOT_MODELS)}, is {self.robot_model!r}")
        for attribute in (
            "time_step",
            "reference_period",
            "gripper_proportional_gain",
            "gripper_derivative_gain",
            "approach_height",
            "carry_height",
            "release_gap",
            "release_distance",
            "gripper_squeeze",
            "gripper_speed",
            "grip_time",
            "velocity_scale",
            "acceleration_scale",
            "clearance",
            "contact_clearance",
        ):
            value = getattr(self, attribute)
            if not (isfinite(value) and value > 0):
                raise InputError(f"{name}.{attribute}: must be > 0, is {value}")
        for attribute in ("velocity_scale", "acceleration_scale"):
            if getattr(self, attribute) > 1:
                raise InputError(f"{name}.{attribute}: must be <= 1, is {getattr(self, attribute)}")
        if not 0 < self.gripper_release <= self.gripper_open <= MAX_GRIPPER_WIDTH:
            raise InputError(
                f"{name}.gripper_open: 0 < gripper_release <= gripper_open <= {MAX_GRIPPER_WIDTH} [m] must hold, are"
                f" {self.gripper_release} and {self.gripper_open}"
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
            ("presentations", 1),
        ):
            if len(getattr(self, attribute)) < least:
                raise InputError(f"{name}.{attribute}: needs at least {least}, has {len(getattr(self, attribute))}")
        for attribute in ("cubes", "trays", "allen_keys"):
            for k, pose in enumerate(getattr(self, attribute)):
                pose.validate(f"{name}.{attribute}[{k}]")
        for attribute in ("chair_side", "chair_side_prepared", "chair_side_placed"):
            getattr(self, attribute).validate(f"{name}.{attribute}")
        for attribute in ("cube_spread", "chair_side_spread", "allen_key_spread"):
            _require_numbers(getattr(self, attribute), 3, f"{name}.{attribute}")
            if min(getattr(self, attribute)) < 0:
                raise InputError(f"{name}.{attribute}: must be >= 0, is {getattr(self, attribute)}")
        for k, presentation in enumerate(self.presentations):
            presentation.validate(f"{name}.presentations[{k}]")
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
