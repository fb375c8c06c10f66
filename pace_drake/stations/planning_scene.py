"""The workcell as motions are planned in it: the arm, what it may carry, and everything it must keep away from."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil

import numpy as np
from pydrake.geometry import Box, CollisionFilterDeclaration, GeometryId, GeometrySet, Role
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import RigidBody
from pydrake.solvers import SnoptSolver
from pydrake.systems.framework import DiagramBuilder

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations.components import GRASPS, TRAY_FLOOR, Component, components
from pace_drake.stations.plant import NUM_ARM_JOINTS, NUM_FINGERS, add_furniture
from pace_drake.stations.workcell import Workcell

_MAX_CLEARANCE = 0.03  # [m] distances beyond this are not measured
_WAY_STEP = 0.02  # [rad] between postures at which a straight way is looked at
_WAY_CLEARANCE = 0.005  # [m] kept on it
_TOUCHING = 0.001  # [m] by which something may come nearer to an arm that is near already
_JOINT_LIMIT_MARGIN = 0.05  # [rad] kept from the joint limits by inverse kinematics

#: Zone of the chair's side once it lies on the rails.
PLACED_SIDE = "placed chair side"


class PlanningScene:
    """A kinematic model of the workcell, with everything in it that a motion must keep away from.

    Components stand in zones: boxes around every pose that they may have, so that a plan does not depend on where
    others lie. A zone has its component's name; trays are zones too, as high as a cube in them. What the gripper
    carries is a copy of that model's boxes on the hand.

    Args:
        workcell: where things stand.

    Raises:
        InputError: the home position is too near to a joint limit.
    """

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.components = components(workcell)
        builder = DiagramBuilder()
        # A discrete plant, as the mimic joint of the second finger asks for; never stepped.
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, workcell.time_step)
        add_furniture(self.plant, scene_graph, workcell)
        world, hand = self.plant.world_body(), self.plant.GetBodyByName("panda_hand")
        self.gripper = self.plant.GetFrameByName("panda_hand_tcp")
        boxes = {model: _boxes_of(model) for model in GRASPS}
        self._zones: dict[str, list[GeometryId]] = {}
        for component in self.components:
            self._zones[component.name] = [
                self._add_box(world, component.name, X_WB, size) for X_WB, size in _zone_of(component, boxes)
            ]
        placed = workcell.chair_side_placed.to_rigid_transform()
        self._zones[PLACED_SIDE] = [
            self._add_box(world, PLACED_SIDE, placed @ X_OB, size) for X_OB, size in boxes["chair_side"]
        ]
        (_, cube_size), *_ = boxes["cube"]
        for k, tray in enumerate(workcell.trays):
            body = self.plant.GetBodyByName("tray", self.plant.GetModelInstanceByName(f"tray_{k + 1}"))
            size = np.array([0.1, 0.1, cube_size[2]])
            X_WB = tray.to_rigid_transform() @ RigidTransform([0.0, 0.0, TRAY_FLOOR + size[2] / 2])
            self._zones[f"tray_{k + 1}"] = [self._add_box(world, f"cube in tray_{k + 1}", X_WB, size)]
            # A cube is put down on the tray's floor; its walls are kept away from as anything else.
            self._zones[f"floor of tray_{k + 1}"] = [
                geometry
                for geometry in self.plant.GetCollisionGeometriesForBody(body)
                if scene_graph.model_inspector().GetName(geometry).endswith("base")
            ]
        self._zones["chair_base"] = list(
            self.plant.GetCollisionGeometriesForBody(self.plant.GetBodyByName("chair_base"))
        )
        X_HandGripper = self.gripper.GetFixedPoseInBodyFrame()
        self._held: dict[str, list[GeometryId]] = {}
        for model, grasp in GRASPS.items():
            X_GO = grasp.X_OG(grasp.yaws[0]).inverse()
            self._held[model] = [
                self._add_box(hand, f"carried {model}", X_HandGripper @ X_GO @ X_OB, size)
                for X_OB, size in boxes[model]
            ]
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self._filters = scene_graph.collision_filter_manager(scene_graph.GetMyMutableContextFromRoot(self.context))
        self._everything = GeometrySet(list(scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)))
        carried = GeometrySet([geometry for ids in self._held.values() for geometry in ids])
        gripped = CollisionFilterDeclaration().ExcludeWithin(carried)
        for name in ("panda_leftfinger", "panda_rightfinger"):
            finger = self.plant.GetCollisionGeometriesForBody(self.plant.GetBodyByName(name))
            gripped.ExcludeBetween(carried, GeometrySet(finger))
        self._filters.Apply(gripped)
        self.fingers = np.full(NUM_FINGERS, workcell.gripper_open / 2)
        """(2) [m] as which the fingers are planned; see ``carrying``."""
        self.lower = self.plant.GetPositionLowerLimits()[:NUM_ARM_JOINTS] + _JOINT_LIMIT_MARGIN
        self.upper = self.plant.GetPositionUpperLimits()[:NUM_ARM_JOINTS] - _JOINT_LIMIT_MARGIN
        home = np.array(workcell.home)
        if np.any(home < self.lower) or np.any(home > self.upper):
            raise InputError(
                f"workcell.home: must stay {_JOINT_LIMIT_MARGIN} rad inside the joint limits, is {home.tolist()}"
            )

    def _add_box(self, body: RigidBody, name: str, X_FB: RigidTransform, size: np.ndarray) -> GeometryId:
        # Names of geometries must differ within a body.
        number = len(self.plant.GetCollisionGeometriesForBody(body))
        return self.plant.RegisterCollisionGeometry(body, X_FB, Box(*size), f"{name}#{number}", CoulombFriction())

    @contextmanager
    def carrying(self, held: str, ignored: tuple[str, ...], width: float) -> Iterator[None]:
        """Within it, the gripper is ``width`` [m] open, carries the model ``held`` ("": none), may enter some zones."""
        nothing = CollisionFilterDeclaration()
        for model, ids in self._held.items():
            if model != held:
                nothing.ExcludeBetween(GeometrySet(ids), self._everything)
        for zone in ignored:
            nothing.ExcludeBetween(GeometrySet(self._zones[zone]), self._everything)
        declaration = self._filters.ApplyTransient(nothing)
        fingers, self.fingers = self.fingers, np.full(NUM_FINGERS, width / 2)
        try:
            yield
        finally:
            self.fingers = fingers
            self._filters.RemoveDeclaration(declaration)

    def set_position(self, q: np.ndarray) -> None:
        """Puts the arm at q (7) [rad]."""
        self.plant.SetPositions(self.plant_context, np.concatenate([q, self.fingers]))

    def gripper_pose(self, q: np.ndarray) -> RigidTransform:
        """X_WG of the gripper's TCP at arm positions q (7) [rad]."""
        self.set_position(q)
        return self.gripper.CalcPoseInWorld(self.plant_context)

    def clearance(self, q: np.ndarray) -> tuple[float, str]:
        """Least distance [m] (at most 0.03) at arm positions q (7) [rad], and the names of the two geometries."""
        self.set_position(q)
        query = self.plant.get_geometry_query_input_port().Eval(self.plant_context)
        pairs = query.ComputeSignedDistancePairwiseClosestPoints(_MAX_CLEARANCE)
        if not pairs:
            return _MAX_CLEARANCE, ""
        nearest = min(pairs, key=lambda pair: pair.distance)
        inspector = query.inspector()

        def name(geometry: GeometryId) -> str:
            frame, own = inspector.GetName(inspector.GetFrameId(geometry)), inspector.GetName(geometry)
            return own.split("::")[-1].split("#")[0] if "#" in own else frame

        return nearest.distance, f"{name(nearest.id_A)} and {name(nearest.id_B)}"

    def is_free(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Whether the arm may go on a straight line from one position to another, each (7) [rad].

        An arm that already is near something, as when it holds a component, may go where nothing comes nearer.
        """
        count = ceil(np.max(np.abs(end - start)) / _WAY_STEP) + 1
        least = min(_WAY_CLEARANCE, self.clearance(start)[0], self.clearance(end)[0]) - _TOUCHING
        shares = np.linspace(0.0, 1.0, count)[1:-1]
        return all(self.clearance(start + share * (end - start))[0] >= least for share in shares)

    def solve_ik(
        self, X_WG: RigidTransform, near: np.ndarray, guess: np.ndarray, clearance: float
    ) -> tuple[float, np.ndarray] | None:
        """One attempt of inverse kinematics: (cost, q (7) [rad]), the posture nearest to ``near``, or None."""
        ik = InverseKinematics(self.plant, self.plant_context)
        prog, q = ik.get_mutable_prog(), ik.q()
        prog.AddBoundingBoxConstraint(self.lower, self.upper, q[:NUM_ARM_JOINTS])
        prog.AddBoundingBoxConstraint(self.fingers, self.fingers, q[NUM_ARM_JOINTS:])
        tolerance = np.full(3, 1e-4)
        world = self.plant.world_frame()
        p_WG = X_WG.translation()
        ik.AddPositionConstraint(self.gripper, np.zeros(3), world, p_WG - tolerance, p_WG + tolerance)
        ik.AddOrientationConstraint(world, X_WG.rotation(), self.gripper, RigidTransform().rotation(), 1e-3)
        ik.AddMinimumDistanceLowerBoundConstraint(clearance, 0.01)
        # The elbow's swivel costs more, the wrist's last turn less.
        weight = np.diag([1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 0.3])
        prog.AddQuadraticErrorCost(weight, near, q[:NUM_ARM_JOINTS])
        result = SnoptSolver().Solve(prog, np.concatenate([guess, self.fingers]), None)
        if not result.is_success():
            return None
        return result.get_optimal_cost(), result.GetSolution(q)[:NUM_ARM_JOINTS]


def _boxes_of(model: str) -> list[tuple[RigidTransform, np.ndarray]]:
    """Collision boxes of a model in its body's frame: (X_OB, size [m]). Its contact spheres lie within a millimetre."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    Parser(plant).AddModels(str(resource_path(f"models/{model}.sdf")))
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    return [
        (inspector.GetPoseInFrame(geometry), np.array(inspector.GetShape(geometry).size()))
        for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(model))
        if isinstance(inspector.GetShape(geometry), Box)
    ]


def _zone_of(
    component: Component, boxes: dict[str, list[tuple[RigidTransform, np.ndarray]]]
) -> list[tuple[RigidTransform, np.ndarray]]:
    """Boxes, aligned with the nominal pose, that hold the component at every pose of its spread."""
    dx, dy, dyaw = component.spread
    X_WO = component.nominal.to_rigid_transform()
    zone = []
    for X_OB, size in boxes[component.model]:
        # Corners turned by yaws up to the spread; the extremes of a sine in between lie at its ends or at the corner's
        # own angle, so a fan of yaws is enough.
        corners = np.array([[sx * size[0] / 2, sy * size[1] / 2] for sx in (-1, 1) for sy in (-1, 1)])
        corners = corners + X_OB.translation()[:2]
        fan = np.linspace(-dyaw, dyaw, 9)
        turned = np.concatenate([corners @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in fan])
        low, high = turned.min(axis=0), turned.max(axis=0)
        # The spread is along the axes of the world.
        R = np.abs(X_WO.rotation().matrix()[:2, :2].T) @ np.array([dx, dy])
        low, high = low - R, high + R
        centre = np.append((low + high) / 2, X_OB.translation()[2])
        zone.append((X_WO @ RigidTransform(centre), np.append(high - low, size[2])))
    return zone
