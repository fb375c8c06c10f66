"""The person of the plant level: a figure whose right hand is where the hand source says."""

from math import cos, hypot, sin, sqrt

import numpy as np
from numba import njit
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    Capsule,
    CollisionFilterDeclaration,
    Ellipsoid,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    GeometrySet,
    IllustrationProperties,
    PerceptionProperties,
    ProximityProperties,
    Rgba,
    Role,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

#: [m] between the hip joints, in world.
P_WHIP = np.array([1.42, 0.0, 0.17])
#: [m] right shoulder from the hips, trunk upright (the person faces -x).
P_TRUNK_SHOULDER = np.array([0.0, 0.19, 0.44])
UPPER_ARM = 0.30  # [m] shoulder to elbow
FOREARM = 0.33  # [m] elbow to the middle of the hand
MAX_LEAN = 0.9  # [rad]
HAND_RADIUS = 0.045  # [m]
FOREARM_RADIUS = 0.037  # [m]
FOREARM_START = 0.05  # [m] of the forearm's capsule from the middle of the hand
#: (2,) [m] of hand and forearm, in the order of ``limb_segments``.
LIMB_RADII = np.array([HAND_RADIUS, FOREARM_RADIUS])


@njit(cache=True, nogil=True)
def arm_posture(p_WH):
    """Posture for a hand's position p_WH (3) [m], in closed form and continuous in it.

    Returns:
        R_WT (3, 3) of the trunk, p_WS (3) [m] shoulder, p_WE (3) [m] elbow.
    """
    reach = 0.97 * (UPPER_ARM + FOREARM)

    # Lean about the horizontal axis square to the direction of the hand.
    to_hand = p_WH - P_WHIP - P_TRUNK_SHOULDER
    horizontal = hypot(to_hand[0], to_hand[1])
    distance = sqrt(horizontal**2 + to_hand[2] ** 2)
    lean = min(max((distance - reach) / P_TRUNK_SHOULDER[2], 0.0), MAX_LEAN)
    s, c = sin(lean), cos(lean)
    ux, uy = to_hand[0] / max(horizontal, 1e-9), to_hand[1] / max(horizontal, 1e-9)
    # Rodrigues' formula about (-uy, ux, 0).
    R_WT = np.array(
        [
            [c + (1 - c) * uy * uy, -(1 - c) * ux * uy, s * ux],
            [-(1 - c) * ux * uy, c + (1 - c) * ux * ux, s * uy],
            [-s * ux, -s * uy, c],
        ]
    )
    p_WS = P_WHIP + np.sum(R_WT * P_TRUNK_SHOULDER, axis=1)

    # Elbow: intersection of two spheres, on the side that is down and outwards.
    p_SH = p_WH - p_WS
    distance = max(sqrt(np.sum(p_SH**2)), 1e-6)
    n = p_SH / distance
    along = (UPPER_ARM**2 - FOREARM**2 + distance**2) / (2 * distance)
    along = min(max(along, 0.0), UPPER_ARM)
    outwards = np.array([0.0, 0.6, -1.0])
    outwards -= np.sum(outwards * n) * n
    outwards /= max(sqrt(np.sum(outwards**2)), 1e-6)
    p_WE = p_WS + along * n + sqrt(UPPER_ARM**2 - along**2) * outwards
    return R_WT, p_WS, p_WE


@njit(cache=True, nogil=True)
def limb_segments(p_WH):
    """(2, 2, 3) [m] ends of the axes of hand (a sphere) and forearm in world, for a hand's position p_WH (3) [m]."""
    _, _, p_WE = arm_posture(p_WH)
    to_elbow = p_WE - p_WH
    n = to_elbow / max(sqrt(np.sum(to_elbow**2)), 1e-6)
    segments = np.empty((2, 2, 3))
    segments[0, 0], segments[0, 1] = p_WH, p_WH
    segments[1, 0], segments[1, 1] = p_WH + FOREARM_START * n, p_WH + FOREARM * n
    return segments


class Person(LeafSystem):
    """The person at the assembly table, whose right hand follows a point: kinematic geometry for a SceneGraph.

    The trunk leans from the hips as far as the hand is out of reach; the elbow hangs down and outwards. Hand and arm
    have the proximity role with every contact filtered: distance queries find them, the plant never feels them.

    Inputs:
        p_WH (3) [m]: centre of the right hand.

    Outputs:
        geometry_pose: FramePoseVector of the trunk, upper arm and hand frames. Depends on p_WH only.
    """

    def __init__(self, scene_graph: SceneGraph) -> None:
        """Registers the person's geometry with ``scene_graph``; connect its pose port for ``source_id`` afterwards."""
        super().__init__()
        self.source_id = scene_graph.RegisterSource("person")
        self._frames = {
            name: scene_graph.RegisterFrame(self.source_id, GeometryFrame(name))
            for name in ("trunk", "upper_arm", "hand")
        }
        skin, shirt, trousers, hair = (
            Rgba(*rgb, 1.0) for rgb in ([0.80, 0.60, 0.47], [0.16, 0.33, 0.50], [0.21, 0.22, 0.26], [0.22, 0.15, 0.11])
        )
        scene_graph_ids: list = []

        def add(
            frame: str | None, name: str, shape: Shape, X: RigidTransform, color: Rgba, touch: bool = False
        ) -> None:
            instance = GeometryInstance(X, shape, name)
            illustration, perception = IllustrationProperties(), PerceptionProperties()
            illustration.AddProperty("phong", "diffuse", color)
            perception.AddProperty("phong", "diffuse", color)
            instance.set_illustration_properties(illustration)
            instance.set_perception_properties(perception)
            if touch:
                instance.set_proximity_properties(ProximityProperties())
            if frame is None:
                geometry_id = scene_graph.RegisterAnchoredGeometry(self.source_id, instance)
            else:
                geometry_id = scene_graph.RegisterGeometry(self.source_id, self._frames[frame], instance)
            if touch:
                scene_graph_ids.append(geometry_id)

        def capsule(a: list[float], b: list[float], radius: float) -> tuple[Shape, RigidTransform]:
            p, q = np.array(a), np.array(b)
            R = RotationMatrix.MakeFromOneVector(q - p, 2)
            return Capsule(radius, float(np.linalg.norm(q - p))), RigidTransform(R, (p + q) / 2)

        hip = P_WHIP
        for side, y in (("right", 0.10), ("left", -0.10)):
            foot = [hip[0] + 0.02, y, -0.71]
            add(None, f"{side}_leg", *capsule([hip[0], y * 0.9, hip[2] - 0.03], foot, 0.07), trousers)
            add(None, f"{side}_shoe", *capsule(foot, [foot[0] - 0.13, y, -0.715], 0.035), hair)
        add(None, "hips", Ellipsoid(0.11, 0.165, 0.10), RigidTransform(hip), trousers)
        add("trunk", "waist", *capsule([0, -0.07, 0.06], [0, 0.07, 0.06], 0.105), shirt)
        add("trunk", "chest", Ellipsoid(0.125, 0.185, 0.27), RigidTransform([0, 0, 0.26]), shirt)
        add("trunk", "shoulders", *capsule([0, -0.17, 0.44], [0, 0.17, 0.44], 0.065), shirt)
        add("trunk", "neck", *capsule([0, 0, 0.47], [-0.01, 0, 0.56], 0.05), skin)
        add("trunk", "head", Ellipsoid(0.095, 0.078, 0.115), RigidTransform([-0.02, 0, 0.65]), skin)
        add("trunk", "hair", Ellipsoid(0.095, 0.084, 0.095), RigidTransform([0.005, 0, 0.685]), hair)
        add("trunk", "left_upper_arm", *capsule([0, -0.20, 0.43], [0.03, -0.25, 0.15], 0.047), shirt)
        add("trunk", "left_forearm", *capsule([0.03, -0.25, 0.15], [-0.12, -0.22, -0.06], 0.037), skin)
        add("trunk", "left_hand", Ellipsoid(0.045, 0.03, 0.055), RigidTransform([-0.14, -0.215, -0.09]), skin)
        # z of the arm frames points from the hand or the elbow towards the shoulder.
        add("upper_arm", "upper_arm", *capsule([0, 0, 0], [0, 0, UPPER_ARM], 0.049), shirt, touch=True)
        add("hand", "hand", Sphere(HAND_RADIUS), RigidTransform(), skin, touch=True)
        forearm = capsule([0, 0, FOREARM_START], [0, 0, FOREARM], FOREARM_RADIUS)
        add("hand", "forearm", *forearm, skin, touch=True)

        inspector = scene_graph.model_inspector()
        everything = GeometrySet(list(inspector.GetAllGeometryIds(Role.kProximity)))
        manager = scene_graph.collision_filter_manager()
        arm = GeometrySet(scene_graph_ids)
        manager.Apply(CollisionFilterDeclaration().ExcludeBetween(arm, everything).ExcludeWithin(arm))

        self.DeclareVectorInputPort("p_WH", BasicVector(3))
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self.CalcGeometryPose,
            prerequisites_of_calc={self.input_port_ticket(self.GetInputPort("p_WH").get_index())},
        )

    def CalcGeometryPose(self, context: Context, output: Value) -> None:
        """Poses of the frames for the hand's position, in closed form and continuous in it."""
        p_WH = self.GetInputPort("p_WH").Eval(context)
        R_WT, p_WS, p_WE = arm_posture(p_WH)
        poses = FramePoseVector()
        poses.set_value(self._frames["trunk"], RigidTransform(RotationMatrix(R_WT), P_WHIP))
        poses.set_value(
            self._frames["upper_arm"], RigidTransform(RotationMatrix.MakeFromOneVector(p_WS - p_WE, 2), p_WE)
        )
        poses.set_value(self._frames["hand"], RigidTransform(RotationMatrix.MakeFromOneVector(p_WE - p_WH, 2), p_WH))
        output.set_value(poses)
