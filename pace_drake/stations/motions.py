"""What the arm does for every robot action: joint trajectories planned once, replayed at any slower speed.

A motion is a chain of legs that start and end at rest, with pauses in which the gripper opens or closes. A leg runs
through via positions from inverse kinematics with a clearance constraint, on a spline with continuous curvature, timed
by TOPPRA (Pham and Pham 2018, Drake's ``Toppra``) within the scaled joint velocity and acceleration limits. Every
finished motion is checked for clearance at dense samples.

At this stage the gripper stops ``grasp_standoff`` above what it would take: nothing is carried yet.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import atan2, pi

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.optimization import CalcGridPointsOptions, Toppra
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.solvers import SnoptSolver
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PathParameterizedTrajectory, PiecewisePolynomial

from pace_drake.errors import InputError
from pace_drake.stations.plant import NUM_ARM_JOINTS, NUM_FINGERS, add_workcell
from pace_drake.stations.workcell import Pose, Workcell
from pace_drake.task import ActionKind

_SAMPLE_STEP = 0.01  # [s] between the samples of the final clearance check
_MAX_CLEARANCE = 0.10  # [m] distances beyond this are not measured
_JOINT_LIMIT_MARGIN = 0.05  # [rad] kept from the joint limits by inverse kinematics
_IK_RESTARTS = 30
_SHORT_WAY = 1e-3  # [rad] a leg that stays within this takes _SHORT_TIME, as there is nothing for TOPPRA to time
_SHORT_TIME = 0.1  # [s]
_MAX_DETOURS = 3  # heights tried, in multiples of the approach height
_PATH_SAMPLES = 60  # of a leg's path, when detours are sought
_DOWN = (pi, 0.0)  # [rad] roll and pitch of a gripper that points down


@dataclass(frozen=True)
class _Grasp:
    """How the gripper meets an object O: the point under the TCP on its upper side, and the yaws that do equally."""

    p_O: tuple[float, float, float]  # [m]
    yaws: tuple[float, ...]  # [rad] of the gripper in O; its fingers close along its y axis


# Points and directions of the objects in models/.
_CUBE = _Grasp((0.0, 0.0, 0.02), (0.0, pi / 2, pi, -pi / 2))
_TRAY = _Grasp((0.0, 0.0, 0.028), (0.0, pi / 2, pi, -pi / 2))
_CHAIR_SIDE = _Grasp((-0.13, 0.0, 0.025), (pi / 2, -pi / 2))  # on the seat rail, which runs along y
_ALLEN_KEY = _Grasp((0.025, 0.0, 0.0125), (0.0, pi))  # on the grip, which runs along x


@dataclass(frozen=True)
class _Motion:
    """A time-optimal joint trajectory and the gripper's width along it."""

    trajectory: PiecewisePolynomial  # (7) [rad] over [0, duration]
    width_times: np.ndarray  # [s]
    widths: np.ndarray  # [m]

    @property
    def duration(self) -> float:
        return self.trajectory.end_time()


@dataclass(frozen=True)
class MotionLibrary:
    """Planned motions of all robot actions, by kind and 1-based index.

    ROBOT_TASK i starts and ends at ``home``; PREPARE l leads from ``home`` to the prepared position of joint action l;
    JOINT l from there to its end; HOME l from that end, and HOME_ABORTED l from the prepared position, to ``home``.
    Gripper widths join up in the same way.

    Iterating yields the (kind, index) of every motion. Looking up another one raises KeyError.
    """

    home: np.ndarray
    """(7) [rad] home position."""
    _motions: dict[tuple[ActionKind, int], _Motion] = field(repr=False)

    def position(self, kind: ActionKind, index: int, fraction: float) -> np.ndarray:
        """Returns the (7) joint positions [rad] at a fraction of the motion, clamped to [0, 1].

        The time-optimal trajectory is scaled linearly in time: replayed in ``k`` times its minimum duration, it has
        1/k of its velocities and 1/k^2 of its accelerations.
        """
        motion = self._motions[kind, index]
        return motion.trajectory.value(min(max(fraction, 0.0), 1.0) * motion.duration)[:, 0]

    def velocity(self, kind: ActionKind, index: int, fraction: float) -> np.ndarray:
        """Returns the (7) joint velocities [rad/s] at a fraction of the motion at full speed; zero outside [0, 1]."""
        motion = self._motions[kind, index]
        if not 0.0 <= fraction <= 1.0:
            return np.zeros(NUM_ARM_JOINTS)
        return motion.trajectory.EvalDerivative(fraction * motion.duration, 1)[:, 0]

    def gripper_width(self, kind: ActionKind, index: int, fraction: float) -> float:
        """Returns the desired width [m] between the fingers at a fraction of the motion, clamped to [0, 1]."""
        motion = self._motions[kind, index]
        time = min(max(fraction, 0.0), 1.0) * motion.duration
        return float(np.interp(time, motion.width_times, motion.widths))

    def minimum_duration(self, kind: ActionKind, index: int) -> float:
        """Returns the time [s] that the motion takes at full speed, gripper included."""
        return self._motions[kind, index].duration

    def __iter__(self) -> Iterator[tuple[ActionKind, int]]:
        return iter(self._motions)

    def __len__(self) -> int:
        return len(self._motions)


def plan_motions(workcell: Workcell, num_robot_tasks: int, num_joint_actions: int) -> MotionLibrary:
    """Plans the motions of all robot actions. The same arguments give the same library.

    Args:
        workcell: where things stand, limits, clearance.
        num_robot_tasks: M. Robot task i takes cube i to tray i, cyclically.
        num_joint_actions: L. Joint action 1 handles the chair's side, the others Allen keys, cyclically.

    Raises:
        InputError: the workcell cannot be used, a place is out of reach, or a motion comes nearer to something than
            ``workcell.clearance``.
    """
    workcell.validate()
    for name, number in (("num_robot_tasks", num_robot_tasks), ("num_joint_actions", num_joint_actions)):
        if number < 0:
            raise InputError(f"{name}: must be >= 0, is {number}")
    planner = _Planner(workcell)
    motions: dict[tuple[ActionKind, int], _Motion] = {}
    tasks: dict[tuple[int, int], _Motion] = {}
    for i in range(1, num_robot_tasks + 1):
        places = (i - 1) % len(workcell.cubes), (i - 1) % len(workcell.trays)
        if places not in tasks:
            tasks[places] = planner.plan_robot_task(i, *places)
        motions[ActionKind.ROBOT_TASK, i] = tasks[places]
    joints: dict[tuple[int, int], dict[ActionKind, _Motion]] = {}
    for index in range(1, num_joint_actions + 1):
        # The first presentation and the chair's side belong to joint action 1, the others repeat.
        presentation = 0 if index == 1 else 1 + (index - 2) % (len(workcell.presentations) - 1)
        key = -1 if index == 1 else (index - 2) % len(workcell.allen_keys)
        if (presentation, key) not in joints:
            joints[presentation, key] = planner.plan_joint_action(index, presentation, key)
        for kind, motion in joints[presentation, key].items():
            motions[kind, index] = motion
    return MotionLibrary(planner.home, motions)


@dataclass(frozen=True)
class _Via:
    """A via position; ``name`` says in errors where it is."""

    name: str
    q: np.ndarray  # (7) [rad]
    X_WG: RigidTransform  # of the gripper's TCP


class _Planner:
    """The workcell as a kinematic model, and what is asked of it."""

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.home = np.array(workcell.home, dtype=float)
        builder = DiagramBuilder()
        # A discrete plant, as the mimic joint of the second finger asks for; never stepped.
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, workcell.time_step)
        add_workcell(self.plant, scene_graph, workcell, free_cubes=False)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.gripper = self.plant.GetFrameByName("panda_hand_tcp")
        self._home_via = _Via("home", self.home, RigidTransform())
        # Fingers are planned as open as they ever are.
        self.fingers = np.full(NUM_FINGERS, workcell.gripper_open / 2)
        self.lower = self.plant.GetPositionLowerLimits()[:NUM_ARM_JOINTS] + _JOINT_LIMIT_MARGIN
        self.upper = self.plant.GetPositionUpperLimits()[:NUM_ARM_JOINTS] - _JOINT_LIMIT_MARGIN
        self.max_velocity = workcell.velocity_scale * self.plant.GetVelocityUpperLimits()[:NUM_ARM_JOINTS]
        self.max_acceleration = workcell.acceleration_scale * self.plant.GetAccelerationUpperLimits()[:NUM_ARM_JOINTS]
        if np.any(self.home < self.lower) or np.any(self.home > self.upper):
            raise InputError(
                f"workcell.home: must stay {_JOINT_LIMIT_MARGIN} rad inside the joint limits, is {self.home.tolist()}"
            )

    # ---- motions

    def plan_robot_task(self, i: int, cube: int, tray: int) -> _Motion:
        """Home, down to a cube, up, down to a tray, up, home."""
        rng = np.random.default_rng([self.workcell.seed, ActionKind.ROBOT_TASK, i])
        opened, closed = self.workcell.gripper_open, self.workcell.gripper_closed
        over_cube, at_cube = self._approach(f"cubes[{cube}]", self.workcell.cubes[cube], _CUBE, rng)
        over_tray, at_tray = self._approach(f"trays[{tray}]", self.workcell.trays[tray], _TRAY, rng)
        chain = _Chain(self, f"robot task {i}", self._home_via, opened)
        chain.move(over_cube, at_cube)
        chain.grip(closed)
        chain.move(over_cube, over_tray, at_tray)
        chain.grip(opened)
        chain.move(over_tray, self._home_via)
        return chain.finish()

    def plan_joint_action(self, index: int, presentation: int, key: int) -> dict[ActionKind, _Motion]:
        """The four motions around joint action ``index``; ``key`` -1 stands for the chair's side."""
        rng = np.random.default_rng([self.workcell.seed, ActionKind.PREPARE, index])
        opened, closed = self.workcell.gripper_open, self.workcell.gripper_closed
        if key < 0:
            over, at = self._approach("chair_side", self.workcell.chair_side, _CHAIR_SIDE, rng)
        else:
            over, at = self._approach(f"allen_keys[{key}]", self.workcell.allen_keys[key], _ALLEN_KEY, rng)
        place = self.workcell.presentations[presentation]
        where = f"presentations[{presentation}]"
        prepared = self._via(f"{where}.prepared", [place.prepared.to_rigid_transform()], rng)
        end = self._via(f"{where}.end", [place.end.to_rigid_transform()], rng, near=prepared.q)
        home = self._home_via

        prepare = _Chain(self, f"preparation {index}", home, opened)
        prepare.move(over, at)
        prepare.grip(closed)
        prepare.move(over, prepared)
        joint = _Chain(self, f"joint action {index}", prepared, closed)
        joint.move(end)
        joint.grip(opened)
        homing = _Chain(self, f"homing {index}", end, opened)
        homing.move(home)
        aborted = _Chain(self, f"aborted homing {index}", prepared, closed)
        aborted.move(home)
        aborted.grip(opened)
        return {
            ActionKind.PREPARE: prepare.finish(),
            ActionKind.JOINT: joint.finish(),
            ActionKind.HOME: homing.finish(),
            ActionKind.HOME_ABORTED: aborted.finish(),
        }

    # ---- postures

    def _approach(self, name: str, pose: Pose, grasp: _Grasp, rng: np.random.Generator) -> tuple[_Via, _Via]:
        """Vias above an object and at it, the gripper pointing down, in whichever equal yaw suits the arm best."""
        X_WO = pose.to_rigid_transform()
        p_WG = X_WO @ np.array(grasp.p_O) + [0.0, 0.0, self.workcell.grasp_standoff]
        yaw_WO = RollPitchYaw(X_WO.rotation()).yaw_angle()
        at = [RigidTransform(RollPitchYaw(*_DOWN, yaw_WO + yaw), p_WG) for yaw in grasp.yaws]
        lift = RigidTransform([0.0, 0.0, self.workcell.approach_height])
        over_via = self._via(name, [lift @ X_WG for X_WG in at], rng)
        at_via = self._via(name, [lift.inverse() @ over_via.X_WG], rng, near=over_via.q)
        return over_via, at_via

    def _via(
        self,
        name: str,
        candidates: Sequence[RigidTransform],
        rng: np.random.Generator,
        near: np.ndarray | None = None,
    ) -> _Via:
        """The posture nearest to ``near`` (by default the home posture turned towards the place) of all candidates."""
        if near is None:
            p_WG = candidates[0].translation()
            near = self.home.copy()
            near[0] = np.clip(near[0] + atan2(p_WG[1], p_WG[0]), self.lower[0], self.upper[0])
        best: tuple[float, np.ndarray, RigidTransform] | None = None
        for X_WG in candidates:
            solution = self._solve_ik(X_WG, near, near)
            if solution is not None and (best is None or solution[0] < best[0]):
                best = (*solution, X_WG)
        for _ in range(_IK_RESTARTS):
            if best is not None:
                return _Via(name, best[1], best[2])
            X_WG = candidates[int(rng.integers(len(candidates)))]
            solution = self._solve_ik(X_WG, near, rng.uniform(self.lower, self.upper))
            if solution is not None:
                best = (*solution, X_WG)
        p = candidates[0].translation()
        raise InputError(
            f"workcell.{name}: no posture of the arm reaches ({p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f}) m with"
            f" {self.workcell.clearance} m clearance; move it or reduce workcell.clearance"
        )

    def _solve_ik(self, X_WG: RigidTransform, near: np.ndarray, guess: np.ndarray) -> tuple[float, np.ndarray] | None:
        """One attempt of inverse kinematics: (cost, q), or None."""
        ik = InverseKinematics(self.plant, self.plant_context)
        prog, q = ik.get_mutable_prog(), ik.q()
        prog.AddBoundingBoxConstraint(self.lower, self.upper, q[:NUM_ARM_JOINTS])
        prog.AddBoundingBoxConstraint(self.fingers, self.fingers, q[NUM_ARM_JOINTS:])
        tolerance = np.full(3, 1e-4)
        world = self.plant.world_frame()
        p_WG = X_WG.translation()
        ik.AddPositionConstraint(self.gripper, np.zeros(3), world, p_WG - tolerance, p_WG + tolerance)
        ik.AddOrientationConstraint(world, X_WG.rotation(), self.gripper, RigidTransform().rotation(), 1e-2)
        ik.AddMinimumDistanceLowerBoundConstraint(1.1 * self.workcell.clearance, 0.01)
        # The elbow's swivel costs more, the wrist's last turn less.
        weight = np.diag([1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 0.3])
        prog.AddQuadraticErrorCost(weight, near, q[:NUM_ARM_JOINTS])
        result = SnoptSolver().Solve(prog, np.concatenate([guess, self.fingers]), None)
        if not result.is_success():
            return None
        return result.get_optimal_cost(), result.GetSolution(q)[:NUM_ARM_JOINTS]

    def clearance(self, q: np.ndarray) -> tuple[float, str]:
        """Least distance [m] (at most 0.10) at arm positions q (7), and the names of the two geometries."""
        self.plant.SetPositions(self.plant_context, np.concatenate([q, self.fingers]))
        query = self.plant.get_geometry_query_input_port().Eval(self.plant_context)
        pairs = query.ComputeSignedDistancePairwiseClosestPoints(_MAX_CLEARANCE)
        if not pairs:
            return _MAX_CLEARANCE, ""
        nearest = min(pairs, key=lambda pair: pair.distance)
        inspector = query.inspector()
        names = (inspector.GetName(inspector.GetFrameId(g)) for g in (nearest.id_A, nearest.id_B))
        return nearest.distance, " and ".join(names)

    # ---- paths

    def leg(self, vias: Sequence[_Via]) -> PathParameterizedTrajectory:
        """The fastest trajectory (9: arm and fingers) through the vias, at rest at both ends.

        A stretch of the spline that comes too near to something is led over it: straight up first, and straight down
        again at its end, higher at each attempt.
        """
        q = [vias[0].q]
        for via in vias[1:-1]:  # a spline needs ways between its vias
            if min(np.max(np.abs(via.q - other)) for other in (q[-1], vias[-1].q)) > _SHORT_WAY:
                q.append(via.q)
        q.append(vias[-1].q)
        path = self._spline(q)
        stretch = self._find_violation(path)
        for attempt in range(1, _MAX_DETOURS + 1):
            if stretch is None:
                break
            height = attempt * self.workcell.approach_height
            lifted = [self._lift(q[k], height) for k in (stretch, stretch + 1)]
            over = [via for via in lifted if via is not None]
            candidate = self._spline([*q[: stretch + 1], *over, *q[stretch + 1 :]])
            if self._find_violation(candidate) is None:
                path, stretch = candidate, None
        # What still comes too near is refused by the check of the finished motion, with its distance.
        limits = [np.append(limit, np.ones(NUM_FINGERS)) for limit in (self.max_velocity, self.max_acceleration)]
        start, end = path.start_time(), path.end_time()
        # TOPPRA's backward pass fails now and then for numerical reasons; other grid points help.
        for grid in (
            Toppra.CalcGridPoints(path, CalcGridPointsOptions()),
            np.linspace(start, end, 101),
            np.linspace(start, end, 201),
        ):
            toppra = Toppra(path, self.plant, grid)
            toppra.AddJointVelocityLimit(-limits[0], limits[0])
            toppra.AddJointAccelerationLimit(-limits[1], limits[1])
            timing = toppra.SolvePathParameterization()
            if timing is not None:
                return PathParameterizedTrajectory(path, timing)
        raise InputError(
            f"workcell: no timing found for the path from {vias[0].name} to {vias[-1].name}; move one of them slightly"
        )

    def _spline(self, q: Sequence[np.ndarray]) -> PiecewisePolynomial:
        """Cubic spline (9) with continuous second derivative; starts and ends straight along its outer chords."""
        samples = np.array([np.concatenate([via, self.fingers]) for via in q])
        chords = np.diff(samples, axis=0)
        lengths = np.max(np.abs(chords[:, :NUM_ARM_JOINTS]) / self.max_velocity, axis=1)
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            breaks, samples.T, chords[0] / lengths[0], chords[-1] / lengths[-1]
        )

    def _find_violation(self, path: PiecewisePolynomial) -> int | None:
        """Index of the first segment of the path that comes too near to something."""
        for s in np.linspace(path.start_time(), path.end_time(), _PATH_SAMPLES):
            if self.clearance(path.value(s)[:NUM_ARM_JOINTS, 0])[0] < self.workcell.clearance:
                return path.get_segment_index(s)
        return None

    def _lift(self, q: np.ndarray, height: float) -> np.ndarray | None:
        """The posture (7) with the gripper raised by ``height`` [m], None if there is none."""
        self.plant.SetPositions(self.plant_context, np.concatenate([q, self.fingers]))
        X_WG = self.gripper.CalcPoseInWorld(self.plant_context)
        solution = self._solve_ik(RigidTransform([0.0, 0.0, height]) @ X_WG, q, q)
        return None if solution is None else solution[1]


class _Chain:
    """A motion under construction: legs and gripper pauses, one after the other."""

    def __init__(self, planner: _Planner, name: str, start: _Via, width: float) -> None:
        self._planner = planner
        self._name = name
        self._times = [0.0]
        self._positions = [start.q]
        self._velocities = [np.zeros(NUM_ARM_JOINTS)]
        self._width_times = [0.0]
        self._widths = [width]

    def move(self, *vias: _Via) -> None:
        """Moves from where the chain is, at rest, through the vias to rest at the last one."""
        here = _Via("its start", self._positions[-1], RigidTransform())
        if all(np.max(np.abs(via.q - here.q)) < _SHORT_WAY for via in vias):
            self._append(_SHORT_TIME, vias[-1].q, self._widths[-1])
            return
        leg = self._planner.leg([here, *vias])
        # Between TOPPRA's grid points the path acceleration is constant: a cubic through them loses nothing.
        times = np.array(leg.time_scaling().get_segment_times())
        begin = self._times[-1]
        for t in times[1:]:
            self._times.append(begin + t - times[0])
            self._positions.append(leg.value(t)[:NUM_ARM_JOINTS, 0])
            self._velocities.append(leg.EvalDerivative(t, 1)[:NUM_ARM_JOINTS, 0])
        self._velocities[-1] = np.zeros(NUM_ARM_JOINTS)
        self._width_times.append(self._times[-1])
        self._widths.append(self._widths[-1])

    def grip(self, width: float) -> None:
        """Waits while the gripper changes its width [m]."""
        duration = abs(width - self._widths[-1]) / self._planner.workcell.gripper_speed
        if duration > 0:
            self._append(duration, self._positions[-1], width)

    def _append(self, duration: float, q: np.ndarray, width: float) -> None:
        """Goes to q (7) and to the width on a cubic, from rest to rest."""
        self._times.append(self._times[-1] + duration)
        self._positions.append(q)
        self._velocities.append(np.zeros(NUM_ARM_JOINTS))
        self._width_times.append(self._times[-1])
        self._widths.append(width)

    def finish(self) -> _Motion:
        """Checks the clearance of the whole motion and returns it."""
        trajectory = PiecewisePolynomial.CubicHermite(
            self._times, np.array(self._positions).T, np.array(self._velocities).T
        )
        for t in np.linspace(0.0, self._times[-1], int(self._times[-1] / _SAMPLE_STEP) + 2):
            distance, names = self._planner.clearance(trajectory.value(t)[:, 0])
            if distance < self._planner.workcell.clearance:
                raise InputError(
                    f"workcell: {self._name} leaves only {distance:.4f} m between {names}, clearance is"
                    f" {self._planner.workcell.clearance} m; move the places apart or reduce workcell.clearance"
                )
        return _Motion(trajectory, np.array(self._width_times), np.array(self._widths))
