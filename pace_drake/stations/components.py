"""What the robot takes hold of: the components of a workcell, in one order, and how each is gripped."""

from dataclasses import dataclass
from math import atan2, pi

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.stations.workcell import Pose, Workcell
from pace_drake.task import ActionKind


@dataclass(frozen=True)
class Grasp:
    """How the gripper meets an object O from above: where its TCP goes, and the yaws that do equally."""

    p_OG: tuple[float, float, float]
    """[m] TCP in the object's frame."""
    yaws: tuple[float, ...]
    """[rad] of the gripper in O; its fingers close along its y axis. Several only where O looks the same from each."""
    width: float
    """[m] of the object between the fingers."""

    def X_OG(self, yaw: float) -> RigidTransform:
        """Pose of the gripper (frame ``panda_hand_tcp``), which points down, at one of the yaws."""
        return RigidTransform(RollPitchYaw(pi, 0.0, yaw), self.p_OG)


# Points and directions of the objects in models/.
GRASPS = {
    "cube": Grasp((0.0, 0.0, 0.001), (0.0, pi / 2, pi, -pi / 2), 0.04),
    "chair_side": Grasp((-0.09, 0.0, 0.016), (pi / 2,), 0.032),  # on the seat rail, which runs along y
    "allen_key": Grasp((0.025, 0.0, 0.015), (pi,), 0.024),  # on the handle, which runs along x; the short end ahead
}


#: [m] height of a tray's floor over its lower face (models/tray.sdf).
TRAY_FLOOR = 0.006


@dataclass(frozen=True)
class Component:
    """One object that the robot fetches."""

    name: str
    """Of its model instance."""
    model: str
    """Its file in models/, without suffix; also the name of its body."""
    nominal: Pose
    """X_WO in the middle of its zone."""
    spread: tuple[float, float, float]
    """[m, m, rad] largest differences of x, y and yaw from the nominal pose."""

    @property
    def camera(self) -> str:
        """Name of the camera over the table on which it lies."""
        return "sorting_camera" if self.model == "cube" else "warehouse_camera"

    @property
    def grasp(self) -> Grasp:
        """How it is gripped."""
        return GRASPS[self.model]

    def pose(self, located: np.ndarray) -> RigidTransform:
        """X_WO of the component where it lies flat at ``located`` = (x [m], y [m], yaw [rad])."""
        x, y, yaw = located
        roll, pitch, _ = self.nominal.rpy
        return RigidTransform(RollPitchYaw(roll, pitch, yaw), [x, y, self.nominal.translation[2]])

    @property
    def located(self) -> np.ndarray:
        """(3) x [m], y [m], yaw [rad] of the nominal pose."""
        return flat(self.nominal.to_rigid_transform())


def closed_width(workcell: Workcell, component: Component) -> float:
    """[m] desired width of the gripper that holds a component: less than the component's, which gives the force."""
    return max(component.grasp.width - workcell.gripper_squeeze, 0.0)


def flat(X_WO: RigidTransform) -> np.ndarray:
    """(3) x [m], y [m], yaw [rad] of an object that lies flat."""
    R, p = X_WO.rotation().matrix(), X_WO.translation()
    return np.array([p[0], p[1], atan2(R[1, 0], R[0, 0])])


def components(workcell: Workcell) -> list[Component]:
    """All components, in the order of every list of components: cubes, the chair's side, Allen keys."""
    w = workcell
    cube, side, key = (
        (spread[0], spread[1], spread[2]) for spread in (w.cube_spread, w.chair_side_spread, w.allen_key_spread)
    )
    return [
        *(Component(f"cube_{k + 1}", "cube", pose, cube) for k, pose in enumerate(w.cubes)),
        Component("chair_side", "chair_side", w.chair_side, side),
        *(Component(f"allen_key_{k + 1}", "allen_key", pose, key) for k, pose in enumerate(w.allen_keys)),
    ]


def nominal_poses(workcell: Workcell) -> np.ndarray:
    """(7 n) quaternion w, x, y, z and position [m] of all components in the middle of their zones."""
    poses = [component.nominal.to_rigid_transform() for component in components(workcell)]
    return np.concatenate([np.append(X_WO.rotation().ToQuaternion().wxyz(), X_WO.translation()) for X_WO in poses])


def component_index(workcell: Workcell, kind: ActionKind, index: int) -> int | None:
    """Which component, as an index into ``components``, an action fetches; None if it fetches none.

    Robot task i takes cube i, cyclically; joint action 1 the chair's side, 2, 3, ... the Allen keys, cyclically.
    """
    if kind == ActionKind.ROBOT_TASK:
        return (index - 1) % len(workcell.cubes)
    if kind == ActionKind.PREPARE:
        return len(workcell.cubes) + (0 if index == 1 else 1 + (index - 2) % len(workcell.allen_keys))
    return None


def tray_index(workcell: Workcell, robot_task: int) -> int:
    """Which tray robot task i fills, as an index into ``workcell.trays``: tray i, cyclically."""
    return (robot_task - 1) % len(workcell.trays)


def presentation_index(workcell: Workcell, joint_action: int) -> int:
    """How joint action 2, 3, ... hands over its key, as an index into ``workcell.presentations``: they take turns."""
    return (joint_action - 2) % len(workcell.presentations)
