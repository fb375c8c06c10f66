"""Legs: joint trajectories from rest to rest through via postures, clear of everything, as fast as the limits allow.

A leg is a spline with continuous curvature through its vias, timed by TOPPRA (Pham and Pham 2018, Drake's ``Toppra``)
within the scaled joint velocity and acceleration limits. Where the spline comes too near to something, it is led over
it; where that fails, Drake's ``KinematicTrajectoryOptimization`` bends it away. Every leg is checked at dense samples.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.multibody.optimization import CalcGridPointsOptions, Toppra
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver
from pydrake.trajectories import BsplineTrajectory, PathParameterizedTrajectory, PiecewisePolynomial, Trajectory

from pace_drake.errors import InputError
from pace_drake.stations.planning_scene import PlanningScene
from pace_drake.stations.plant import NUM_ARM_JOINTS, NUM_FINGERS

#: [rad] a leg that stays within this takes ``SHORT_TIME``, as there is nothing for TOPPRA to time.
SHORT_WAY = 1e-3
SHORT_TIME = 0.1
"""[s]"""
_NEAR_RESTARTS = 8  # of inverse kinematics, before it is tried from anywhere
_MAX_DETOURS = 3  # heights tried, in multiples of the approach height
_PATH_SAMPLES = 60  # of a leg's path, when detours are sought
_SAMPLE_STEP = 0.01  # [s] between the samples of the final clearance check
_NUM_CONTROL_POINTS = 12  # of the trajectory optimisation's B-spline
_NUM_COLLISION_SAMPLES = 30  # at which it keeps clear


@dataclass(frozen=True)
class Via:
    """A via posture; ``name`` says in errors where it is."""

    name: str
    q: np.ndarray
    """(7) [rad]"""
    X_WG: RigidTransform
    """Of the gripper's TCP."""


@dataclass(frozen=True)
class Load:
    """What the gripper carries along a leg, and what the leg may touch."""

    held: str = ""
    """Model of the carried component; empty if the gripper is."""
    touched: tuple[str, ...] = ()
    """Zones that may be entered on the straight ways."""
    absent: tuple[str, ...] = ()
    """Zones that are empty."""
    width: float = 0.07
    """[m] of the gripper."""


@dataclass(frozen=True)
class Leg:
    """Knots of a cubic Hermite spline from rest to rest."""

    times: np.ndarray
    """(n) [s], from 0."""
    positions: np.ndarray
    """(n, 7) [rad]"""
    velocities: np.ndarray
    """(n, 7) [rad/s]"""

    def lasting(self, duration: float) -> "Leg":
        """The same way in another time [s]."""
        slower = duration / self.times[-1]
        return Leg(slower * self.times, self.positions, self.velocities / slower)


class LegPlanner:
    """Plans legs in a scene. The same arguments give the same leg.

    Args:
        scene: the workcell.
    """

    def __init__(self, scene: PlanningScene) -> None:
        self.scene = scene
        self._workcell = scene.workcell
        plant = scene.plant
        self._max_velocity = self._workcell.velocity_scale * plant.GetVelocityUpperLimits()[:NUM_ARM_JOINTS]
        self._max_acceleration = self._workcell.acceleration_scale * plant.GetAccelerationUpperLimits()[:NUM_ARM_JOINTS]

    def via(
        self,
        name: str,
        candidates: Sequence[RigidTransform],
        rng: np.random.Generator,
        near: np.ndarray,
        load: Load,
        clearance: float,
        restarts: int,
    ) -> Via:
        """The posture nearest to ``near`` of those that bring the gripper to one of the candidates.

        Args:
            name: what is there.
            candidates: X_WG that do equally.
            rng: draws the restarts of inverse kinematics.
            near: (7) [rad]
            load: what is carried and touched there.
            clearance: [m] kept there.
            restarts: how often it is tried from elsewhere.

        Raises:
            InputError: there is no posture.
        """
        scene = self.scene
        with scene.carrying("", load.touched + load.absent, load.width):
            best: tuple[float, np.ndarray, RigidTransform] | None = None
            for X_WG in candidates:
                solution = scene.solve_ik(X_WG, near, near, clearance)
                if solution is not None and (best is None or solution[0] < best[0]):
                    best = (*solution, X_WG)
            for restart in range(restarts):
                if best is not None:
                    break
                X_WG = candidates[int(rng.integers(len(candidates)))]
                guess = rng.uniform(scene.lower, scene.upper)
                if restart < _NEAR_RESTARTS:
                    guess = np.clip(near + rng.normal(0.0, 0.2, NUM_ARM_JOINTS), scene.lower, scene.upper)
                solution = scene.solve_ik(X_WG, near, guess, clearance)
                if solution is not None:
                    best = (*solution, X_WG)
        if best is not None:
            return Via(name, best[1], best[2])
        p = candidates[0].translation()
        raise InputError(
            f"workcell.{name}: no posture of the arm reaches ({p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f}) m with"
            f" {clearance:.4f} m clearance; move it or reduce the clearance"
        )

    def plan(self, name: str, vias: Sequence[Via], load: Load, *, leave: bool = False, arrive: bool = False) -> Leg:
        """Plans the fastest leg through the vias.

        Args:
            name: of the motion, for errors.
            vias: at least two.
            load: what is carried, and which zones are touched on the straight ways; elsewhere they are kept clear.
            leave: whether the way to the second via leads straight up from something that was touched.
            arrive: whether the way from the last but one via leads straight down to something to be touched.

        Raises:
            InputError: the leg comes nearer to something than the workcell's clearance (on the straight ways,
                its ``contact_clearance``, and what is carried is not looked at there), or cannot be timed.
        """
        q = [via.q for via in vias]
        if max(np.max(np.abs(a - q[0])) for a in q) < SHORT_WAY:
            return Leg(np.array([0.0, SHORT_TIME]), np.array([q[0], q[-1]]), np.zeros((2, NUM_ARM_JOINTS)))
        # A spline needs ways between its vias.
        kept = [0, *(k for k in range(1, len(q) - 1) if _apart(q[k], q[k - 1]) and _apart(q[k], q[-1])), len(q) - 1]
        q = [q[k] for k in kept]
        way = _Way(self, load, leave and len(q) > 2, arrive and len(q) > 2)
        path: Trajectory = way.spline(q)
        violated = way.violated_segment(path)
        for attempt in range(1, _MAX_DETOURS + 1):
            if violated is None:
                break
            height = attempt * self._workcell.approach_height
            with way.checked(contact=False):
                lifted = [self._lift(q[k], height) for k in (violated, violated + 1)]
            over = [*q[: violated + 1], *(a for a in lifted if a is not None), *q[violated + 1 :]]
            candidate = way.spline(over)
            if way.violated_segment(candidate) is None:
                q, path, violated = over, candidate, None
        if violated is not None:
            optimised = self._optimise(way, q)
            if optimised is not None:
                path = optimised
        leg, trajectory = self._time(path, vias)
        times = np.linspace(0.0, leg.times[-1], int(leg.times[-1] / _SAMPLE_STEP) + 2)
        scaling = trajectory.time_scaling()
        start = scaling.start_time()
        distance, names = way.least(path, [float(scaling.value(start + t)[0, 0]) for t in times])
        if distance < 0:
            raise InputError(
                f"workcell: {name} leaves {-distance:.4f} m too little between {names}; clearance is"
                f" {self._workcell.clearance} m; move the places apart or reduce workcell.clearance"
            )
        return leg

    def _time(self, path: Trajectory, vias: Sequence[Via]) -> tuple[Leg, PathParameterizedTrajectory]:
        limits = [np.append(limit, np.ones(NUM_FINGERS)) for limit in (self._max_velocity, self._max_acceleration)]
        start, end = path.start_time(), path.end_time()
        # TOPPRA's backward pass fails now and then for numerical reasons; other grid points help.
        for grid in (
            Toppra.CalcGridPoints(path, CalcGridPointsOptions()),
            np.linspace(start, end, 101),
            np.linspace(start, end, 201),
        ):
            toppra = Toppra(path, self.scene.plant, grid)
            toppra.AddJointVelocityLimit(-limits[0], limits[0])
            toppra.AddJointAccelerationLimit(-limits[1], limits[1])
            timing = toppra.SolvePathParameterization()
            if timing is not None:
                break
        else:
            raise InputError(
                f"workcell: no timing found for the path from {vias[0].name} to {vias[-1].name}; move one of them"
            )
        trajectory = PathParameterizedTrajectory(path, timing)
        # Between TOPPRA's grid points the path acceleration is constant: a cubic through them loses nothing.
        times = np.array(timing.get_segment_times())
        positions = np.array([trajectory.value(t)[:NUM_ARM_JOINTS, 0] for t in times])
        velocities = np.array([trajectory.EvalDerivative(t, 1)[:NUM_ARM_JOINTS, 0] for t in times])
        velocities[[0, -1]] = 0.0
        return Leg(times - times[0], positions, velocities), trajectory

    def _lift(self, q: np.ndarray, height: float) -> np.ndarray | None:
        """The posture (7) with the gripper raised by ``height`` [m], None if there is none."""
        X_WG = self.scene.gripper_pose(q)
        lift = RigidTransform([0.0, 0.0, height])
        solution = self.scene.solve_ik(lift @ X_WG, q, q, self._workcell.clearance)
        return None if solution is None else solution[1]

    def _optimise(self, way: "_Way", q: Sequence[np.ndarray]) -> Trajectory | None:
        """Bends the free part of the way, between its straight ends, away from what it comes too near to."""
        first, last = int(way.leave), len(q) - 1 - int(way.arrive)
        start, end = q[first], q[last]
        problem = KinematicTrajectoryOptimization(NUM_ARM_JOINTS + NUM_FINGERS, _NUM_CONTROL_POINTS)
        prog = problem.get_mutable_prog()
        problem.AddPathEnergyCost(1.0)  # with the length as the cost the solver fails
        with way.checked(contact=False):
            fingers = self.scene.fingers
            problem.AddPositionBounds(np.append(self.scene.lower, fingers), np.append(self.scene.upper, fingers))
            for s, at in ((0.0, start), (1.0, end)):
                both = np.append(at, fingers)
                problem.AddPathPositionConstraint(both, both, s)
            problem.AddDurationConstraint(1.0, 1.0)
            guess = np.linspace(np.append(start, fingers), np.append(end, fingers), _NUM_CONTROL_POINTS).T
            # From a straight line a solver may stay stuck in the obstacle; lifted in the middle it is led over it.
            middle = self._lift((start + end) / 2, 2 * self._workcell.approach_height)
            if middle is not None:
                bump = np.sqrt(np.sin(np.linspace(0.0, np.pi, _NUM_CONTROL_POINTS)))
                guess[:NUM_ARM_JOINTS] += np.outer(middle - (start + end) / 2, bump)
            problem.SetInitialGuess(BsplineTrajectory(problem.basis(), guess))
            constraint = MinimumDistanceLowerBoundConstraint(
                self.scene.plant, 1.5 * self._workcell.clearance, self.scene.plant_context, None, 0.02
            )
            for s in np.linspace(0.0, 1.0, _NUM_COLLISION_SAMPLES)[1:-1]:
                problem.AddPathPositionConstraint(constraint, s)
            result = SnoptSolver().Solve(prog, None, None)
            if not result.is_success():
                return None
            bent = problem.ReconstructTrajectory(result)
        inner = [bent.value(s)[:NUM_ARM_JOINTS, 0] for s in np.linspace(0.0, 1.0, 2 * _NUM_CONTROL_POINTS)]
        return way.spline([*q[:first], *inner, *q[last + 1 :]])


class _Way:
    """The path of one leg, and what is too near along it."""

    def __init__(self, planner: LegPlanner, load: Load, leave: bool, arrive: bool) -> None:
        self._planner, self._scene, self._load = planner, planner.scene, load
        self.leave, self.arrive = leave, arrive

    def spline(self, q: Sequence[np.ndarray]) -> PiecewisePolynomial:
        """Cubic spline (9) with continuous second derivative; starts and ends straight along its outer chords."""
        fingers = np.full(NUM_FINGERS, self._load.width / 2)
        samples = np.array([np.append(via, fingers) for via in q])
        chords = np.diff(samples, axis=0)
        lengths = np.max(np.abs(chords[:, :NUM_ARM_JOINTS]) / self._planner._max_velocity, axis=1)
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            breaks, samples.T, chords[0] / lengths[0], chords[-1] / lengths[-1]
        )

    def breaks(self, path: PiecewisePolynomial) -> tuple[float, float]:
        """Path parameters between which the leg is free of its straight ends."""
        times = path.get_segment_times()
        return times[1] if self.leave else times[0], times[-2] if self.arrive else times[-1]

    def checked(self, *, contact: bool) -> AbstractContextManager[None]:
        """The scene as it is looked at on the straight ends (``contact``), or between them."""
        load = self._load
        if contact:
            return self._scene.carrying("", load.touched + load.absent, load.width)
        return self._scene.carrying(load.held, load.absent, load.width)

    def violated_segment(self, path: PiecewisePolynomial) -> int | None:
        """Index of the segment in which the free part first comes too near to something."""
        first, last = self.breaks(path)
        samples = np.linspace(path.start_time(), path.end_time(), _PATH_SAMPLES)
        with self.checked(contact=False):
            for s in samples[(first <= samples) & (samples <= last)]:
                distance, _ = self._scene.clearance(path.value(s)[:NUM_ARM_JOINTS, 0])
                if distance < self._scene.workcell.clearance:
                    return path.get_segment_index(s)
        return None

    def least(self, path: Trajectory, samples: Sequence[float]) -> tuple[float, str]:
        """Least distance [m] beyond what must be kept, and between what, at path parameters."""
        free = self.breaks(path)
        workcell = self._scene.workcell
        worst = (np.inf, "")
        for contact, kept in ((False, workcell.clearance), (True, workcell.contact_clearance)):
            with self.checked(contact=contact):
                for s in samples:
                    if (free[0] <= s <= free[1]) is contact:
                        continue
                    distance, names = self._scene.clearance(path.value(s)[:NUM_ARM_JOINTS, 0])
                    if distance - kept < worst[0]:
                        worst = (distance - kept, names)
        return worst


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.max(np.abs(a - b)) > SHORT_WAY)
