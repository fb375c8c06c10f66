"""Whether the robot keeps its distance: random hands reach for it, and a slow second look checks every instant.

Kinematic: the real RobotAction and SafetyMonitor lead planned motions, the arm is where it is told to be. The check
shares nothing with the monitor: forward kinematics by published Denavit-Hartenberg parameters, distances by a search
along the axes, closing speeds by finite differences of the positions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numba import njit
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pace_drake.safety.config import SafetyConfig
from pace_drake.safety.proximity import ArmCapsules
from pace_drake.safety.separation import protective_distance
from pace_drake.scenario import Scenario
from pace_drake.stations.arm_capsules import load_arm_capsules
from pace_drake.stations.components import nominal_poses
from pace_drake.stations.motions import MotionLibrary, plan_motions
from pace_drake.stations.person import LIMB_RADII, limb_segments
from pace_drake.systems.robot_action import STOP_TIME, RobotAction
from pace_drake.systems.safety_monitor import SafetyMonitor, pacing
from pace_drake.task import ActionKind, sample_episode

#: What hands do.
HAND_MOTIONS = ("reach", "sudden start", "hover", "sweep", "reach and retreat")
#: [s] between two instants of the check.
CHECK_STEP = 0.002
#: [s] of one hand motion at least, and of the time before it that is not counted: the arm starts at full rate, next to
#: a hand that nobody saw coming.
DURATION, SETTLING = 1.3, 0.4
CLOSING_SPEED = 1e-3
"""[m/s] a part that closes in faster is not at rest; twice what the monitor takes for rest."""
FAR = np.array([3.0, 0.0, 0.5])
"""[m] a hand that slows nothing."""


@dataclass(frozen=True)
class Trial:
    """One hand motion past one robot motion. Series over instants ``CHECK_STEP`` apart."""

    kind: str
    distance: np.ndarray  # (n, I, J) [m] between robot parts and limbs, by the second look
    closing: np.ndarray  # (n, I, J) [m/s] with which the robot closes in, the limb held still
    rate: np.ndarray  # (n,) [-] path rate
    distance_error: float  # [m] largest difference to the monitor's least distance, at its looks


@dataclass(frozen=True)
class SeparationResult:
    """Figures of many trials in one mode."""

    name: str
    config: SafetyConfig
    num_motions: int
    instants: int
    below: int
    """Instants at which a part closed in faster than contact_speed, nearer than its protective distance."""
    violations: int
    """Those of them at which it had been so for longer than the reaction time."""
    least_distance: float
    """[m]"""
    least_distance_closing: float
    """[m] while the robot closed in by itself."""
    share_slowed: float
    share_stopped: float
    contact_speeds: list[float]
    """[m/s] of the robot's part that was touched, towards the limb, for each hand motion that touched it, then."""
    distance_error: float
    """[m] largest difference between the monitor's distance and the check's."""
    least_distances: list[float]
    """[m] of each hand motion."""
    closing_speeds: list[float]
    """[m/s] largest closing speed of the robot in each hand motion."""


class SeparationBench:
    """RobotAction, SafetyMonitor and an arm that follows exactly; a hand for every look is put in from outside.

    Args:
        scenario: task, workcell, safety settings.
        motions: planned motions; None plans those of the scenario.
    """

    def __init__(self, scenario: Scenario, motions: MotionLibrary | None = None) -> None:
        task = scenario.task
        self.task, self.config = task, scenario.safety
        self.motions = motions or plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
        self.arm = load_arm_capsules()
        builder = DiagramBuilder()
        config = self.config
        poses = nominal_poses(scenario.workcell)
        n = len(poses) // 7
        self.robot_action = builder.AddSystem(RobotAction(task, self.motions, n, pacing=pacing(config)))
        for name, values in (("component_poses", poses), ("component_ages", np.zeros(n))):
            source = builder.AddSystem(ConstantVectorSource(values))
            builder.Connect(source.get_output_port(), self.robot_action.GetInputPort(name))
        self.monitor = builder.AddSystem(SafetyMonitor(config, self.arm))
        for output, target in (
            ("path_position", "path_position"),
            ("path_velocity", "path_velocity"),
            ("motion_progress", "motion_progress"),
            ("position", "position_measured"),
        ):
            builder.Connect(self.robot_action.GetOutputPort(output), self.monitor.GetInputPort(target))
        builder.Connect(
            self.robot_action.GetOutputPort("position"), self.robot_action.GetInputPort("position_measured")
        )
        builder.Connect(self.monitor.GetOutputPort("speed_scale"), self.robot_action.GetInputPort("speed_scale"))
        builder.ExportInput(self.monitor.GetInputPort("p_WH"), "p_WH")
        builder.ConnectInput("p_WH", self.robot_action.GetInputPort("p_WH"))
        builder.ExportInput(self.monitor.GetInputPort("hand_age"), "hand_age")
        builder.ExportInput(self.robot_action.GetInputPort("robot_action"), "robot_action")
        for name in ("hand_distance", "stop", "speed_scale"):
            builder.ExportOutput(self.monitor.GetOutputPort(name), name)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self._action_context = self.robot_action.GetMyMutableContextFromRoot(self.context)
        self._probe = self.robot_action.CreateDefaultContext()

    def start(self, kind: ActionKind, index: int, begun: float, rng: np.random.Generator) -> None:
        """Puts the arm into a motion that began ``begun`` [s] ago, a multiple of the period, and ran at full rate."""
        self.diagram.SetDefaultContext(self.context)
        episode = sample_episode(self.task, rng, [0] * self.task.num_human_actions)
        self.robot_action.set_episode(self._action_context, episode)
        self.context.SetTime(0.0)
        self.diagram.GetInputPort("p_WH").FixValue(self.context, FAR)
        self.diagram.GetInputPort("hand_age").FixValue(self.context, 0.0)
        self.diagram.GetInputPort("robot_action").FixValue(self.context, [float(kind), float(index), 1.0])
        values = self.robot_action.AllocateDiscreteVariables()
        values.SetFrom(self._action_context.get_discrete_state())
        self.robot_action.CalcForcedDiscreteVariableUpdate(self._action_context, values)
        self._action_context.SetDiscreteState(values)
        self.context.SetTime(begun)
        self.simulator.Initialize()

    def step(self, p_WH: np.ndarray, hand_age: float = 0.0) -> tuple[np.ndarray, np.ndarray, float]:
        """Goes on by one period with the hand seen at p_WH.

        Returns:
            positions (m, 7) [rad] and path rates (m,) at the instants in it, and the monitor's distance [m].
        """
        period, time = self.config.period, self.context.get_time()
        # The very number at which Drake's periodic updates are due: one that is a rounding error late misses the hand.
        after = (round(time / period) + 1) * period
        self.diagram.GetInputPort("p_WH").FixValue(self.context, p_WH)
        self.diagram.GetInputPort("hand_age").FixValue(self.context, hand_age)
        distance = self.output("hand_distance")
        self.simulator.AdvanceTo(after)
        self._probe.SetDiscreteState(self._action_context.get_discrete_state())
        positions, rates = [], []
        for k in range(round(period / CHECK_STEP)):
            self._probe.SetTime(time + k * CHECK_STEP)
            positions.append(self.robot_action.GetOutputPort("position").Eval(self._probe).copy())
            rates.append(self.robot_action.GetOutputPort("path_rate").Eval(self._probe)[0])
        return np.array(positions), np.array(rates), distance

    def output(self, name: str) -> float:
        """Value of one of the monitor's outputs."""
        return float(self.diagram.GetOutputPort(name).Eval(self.context)[0])

    def position_ahead(self, ahead: float) -> np.ndarray:
        """(7) [rad] where the arm would be after ``ahead`` [s] at the present rate."""
        self._probe.SetDiscreteState(self._action_context.get_discrete_state())
        self._probe.SetTime(self.context.get_time() + ahead)
        return self.robot_action.GetOutputPort("position").Eval(self._probe).copy()


# ---- the second look


def link_poses(q: np.ndarray) -> np.ndarray:
    """(n, 8, 4, 4) poses of base and links at positions q (n, 7) [rad], by Franka's table (modified DH)."""
    table = (
        (0.0, 0.333, 0.0), (0.0, 0.0, -np.pi / 2), (0.0, 0.316, np.pi / 2), (0.0825, 0.0, np.pi / 2),
        (-0.0825, 0.384, -np.pi / 2), (0.0, 0.0, np.pi / 2), (0.088, 0.0, np.pi / 2),
    )  # fmt: skip
    poses = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for k, (a, d, alpha) in enumerate(table):
        c, s = np.cos(q[:, k]), np.sin(q[:, k])
        ca, sa = np.cos(alpha), np.sin(alpha)
        zero, one = np.zeros_like(c), np.ones_like(c)
        rows = [
            [c, -s, zero, a * one],
            [s * ca, c * ca, -sa * one, -d * sa * one],
            [s * sa, c * sa, ca * one, d * ca * one],
            [zero, zero, zero, one],
        ]
        poses.append(poses[-1] @ np.moveaxis(np.array(rows), 2, 0))
    return np.stack(poses, axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _gap(a, b, share, c, d):
    """Distance [m] of the point at a share of segment a-b from segment c-d."""
    along = square = 0.0
    for x in range(3):
        along += (a[x] + share * (b[x] - a[x]) - c[x]) * (d[x] - c[x])
        square += (d[x] - c[x]) ** 2
    other = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    total = 0.0
    for x in range(3):
        total += (a[x] + share * (b[x] - a[x]) - c[x] - other * (d[x] - c[x])) ** 2
    return sqrt(total)


@njit(cache=True, nogil=True, error_model="numpy")
def _gaps(ends, limbs):
    """(n, I, J) [m] by ternary search: the distance of a point on a segment from another segment is convex."""
    n, parts, num_limbs = ends.shape[0], ends.shape[1], limbs.shape[1]
    found = np.empty((n, parts, num_limbs))
    for k in range(n):
        for i in range(parts):
            for j in range(num_limbs):
                a, b, c, d = ends[k, i, 0], ends[k, i, 1], limbs[k, j, 0], limbs[k, j, 1]
                low, high = 0.0, 1.0
                for _ in range(18):
                    first, second = low + (high - low) / 3, high - (high - low) / 3
                    if _gap(a, b, first, c, d) < _gap(a, b, second, c, d):
                        high = second
                    else:
                        low = first
                at_ends = min(_gap(a, b, 0.0, c, d), _gap(a, b, 1.0, c, d))
                found[k, i, j] = min(_gap(a, b, (low + high) / 2, c, d), at_ends)
    return found


def searched_distance(arm: ArmCapsules, q: np.ndarray, limbs: np.ndarray) -> np.ndarray:
    """(n, I, J) [m] between an arm's parts and limbs, for positions (n, 7) [rad] and limbs (n, J, 2, 3) [m]."""
    X = link_poses(q)[:, arm.links]
    ends = arm.segments @ np.swapaxes(X[..., :3, :3], -1, -2) + X[:, :, np.newaxis, :3, 3]
    return _gaps(ends, limbs) - arm.radii[:, np.newaxis] - LIMB_RADII


# ---- hands


def hand_motion(
    kind: str, target: np.ndarray, start: np.ndarray, speed: float, duration: float, rng: np.random.Generator
) -> np.ndarray:
    """Positions (n, 3) [m] of a hand, ``CHECK_STEP`` apart: it rests for SETTLING, then moves as ``kind`` says.

    Args:
        kind: one of HAND_MOTIONS.
        target: (3) [m] what it reaches for.
        start: (3) [m] where it rests.
        speed: [m/s] that neither the hand nor the forearm's other end exceeds.
        duration: [s] of the whole.
        rng: for what is left open.
    """
    num = round(duration / CHECK_STEP)
    way = np.linspace(0.0, 1.0, 2001)
    smooth = way**3 * (10 - 15 * way + 6 * way**2)  # minimum jerk
    there = start + smooth[:, np.newaxis] * (target - start)
    if kind == "sudden start":
        path = start + way[:, np.newaxis] * (target - start)
    elif kind == "hover":
        phases = rng.uniform(0, 2 * np.pi, 3)
        wiggle = 0.06 * (np.sin(4 * np.pi * way[:, np.newaxis] + phases) - np.sin(phases))
        path = np.concatenate([there, target + wiggle])
    elif kind == "sweep":
        beyond = target + (target - start) * 0.4 + rng.normal(0, 0.15, 3)
        path = np.concatenate(
            [start + way[:, np.newaxis] * (target - start), target + way[:, np.newaxis] * (beyond - target)]
        )
    elif kind == "reach and retreat":
        path = np.concatenate([there, there[::-1]])
    else:
        path = there
    # As fast as asked for, and slower where the forearm would be faster than that.
    limbs = np.array([limb_segments(p) for p in path])
    steps = np.linalg.norm(np.diff(limbs, axis=0), axis=3)
    least = np.max(steps, axis=(1, 2)) / speed
    if kind not in ("sudden start", "sweep"):
        least = np.maximum(least, steps[:, 0, 0].max() / speed)
    times = np.concatenate([[0.0], np.cumsum(least)])
    t = np.arange(num) * CHECK_STEP - SETTLING
    return np.stack([np.interp(t, times, path[:, x]) for x in range(3)], axis=1)


# ---- trials


def run_trial(bench: SeparationBench, number: int, seed: int) -> Trial:
    """Plays hand motion ``number``: the same seed and number give the same."""
    rng = np.random.default_rng([seed, number])
    config, motions = bench.config, bench.motions
    kind, index = list(motions)[rng.integers(len(motions))]
    while kind == ActionKind.JOINT:
        kind, index = list(motions)[rng.integers(len(motions))]
    period = config.period
    begun = period * int(rng.uniform(0.0, 0.85) * motions.minimum_duration(kind, index) / period)
    bench.start(kind, index, begun, rng)
    # The hand aims at a part of the arm, now or where it will be, and misses it by up to a few centimetres.
    part = int(rng.integers(3, len(bench.arm.radii)))
    q = bench.position_ahead(rng.uniform(0.0, 1.0))
    X = link_poses(q[np.newaxis])[0, bench.arm.links[part]]
    target = (X @ np.append(bench.arm.segments[part].mean(axis=0), 1.0))[:3] + rng.normal(0, 0.05, 3)
    away = np.array([1.0, 0.0, 0.2]) + rng.normal(0, 0.5, 3)
    start = target + rng.uniform(0.5, 1.1) * away / np.linalg.norm(away)
    what = HAND_MOTIONS[number % len(HAND_MOTIONS)]
    speed = config.human_speed * (1.0 if rng.random() < 0.5 else rng.uniform(0.3, 1.0))
    hand = hand_motion(what, target, start, speed, SETTLING + DURATION, rng)
    per_look = round(period / CHECK_STEP)
    looks = [bench.step(p_WH) for p_WH in hand[::per_look]]
    q, rate = np.concatenate([look[0] for look in looks]), np.concatenate([look[1] for look in looks])
    monitored = np.array([look[2] for look in looks])
    limbs = np.array([limb_segments(p) for p in hand])
    first = round(SETTLING / period) * per_look
    counted = slice(first, len(hand) - 1)
    distance = searched_distance(bench.arm, q[counted], limbs[counted])
    # The robot's own part of the change of the distance.
    closing = (distance - searched_distance(bench.arm, q[first + 1 :], limbs[counted])) / CHECK_STEP
    error = np.max(np.abs(distance[::per_look].min(axis=(1, 2)) - monitored[first // per_look :]))
    return Trial(what, distance, closing, rate[counted], float(error))


def below_protective(trial: Trial, config: SafetyConfig) -> np.ndarray:
    """(n, I, J) whether a part closes in faster than a contact may be, and is nearer than the protective distance."""
    closing = np.maximum(trial.closing, CLOSING_SPEED)
    # A path rate r comes to rest in r STOP_TIME; 1e-9 where it rests already.
    stop_time = np.maximum(trial.rate * STOP_TIME, 1e-9)[:, np.newaxis, np.newaxis]
    needed = protective_distance(config.human_speed, closing, config.reaction_time, closing / stop_time, config.margin)
    return (trial.closing > max(CLOSING_SPEED, config.contact_speed)) & (trial.distance < needed)


def longer_than(below: np.ndarray, num: int) -> np.ndarray:
    """(n, ...) whether the ``num`` instants before were below too."""
    run = np.zeros(below.shape[1:], dtype=int)
    found = np.zeros_like(below)
    for k, now in enumerate(below):
        run = np.where(now, run + 1, 0)
        found[k] = run > num
    return found


def measure_separation(
    bench: SeparationBench, name: str, num_motions: int, seed: int, done: Callable[[], None] = lambda: None
) -> SeparationResult:
    """Plays ``num_motions`` hand motions and counts.

    Args:
        bench: with the safety settings to be tried.
        name: of the mode.
        num_motions: hand motions, of all HAND_MOTIONS in turn.
        seed: of everything random.
        done: called after each.
    """
    config = bench.config
    instants = below = violations = slowed = stopped = 0
    errors, least, least_closing, fastest, touched = [], [], [], [], []
    for number in range(num_motions):
        trial = run_trial(bench, number, seed)
        bad = below_protective(trial, config)
        instants += len(trial.rate)
        below += int(bad.any(axis=(1, 2)).sum())
        late = longer_than(bad, round(config.reaction_time / CHECK_STEP))
        violations += int(late.any(axis=(1, 2)).sum())
        slowed += int((trial.rate < 1).sum())
        stopped += int((trial.rate == 0).sum())
        errors.append(trial.distance_error)
        least.append(float(trial.distance.min()))
        closes = trial.closing > CLOSING_SPEED
        least_closing.append(float(np.min(trial.distance, where=closes, initial=np.inf)))
        fastest.append(float(max(trial.closing.max(), 0.0)))
        touching = (trial.distance <= 0).any(axis=(1, 2))
        if touching.any():
            k = int(touching.argmax())
            touched.append(float(max(trial.closing[k][trial.distance[k] <= 0].max(), 0.0)))
        done()
    return SeparationResult(
        name=name,
        config=config,
        num_motions=num_motions,
        instants=instants,
        below=below,
        violations=violations,
        least_distance=min(least),
        least_distance_closing=min(least_closing),
        share_slowed=slowed / instants,
        share_stopped=stopped / instants,
        contact_speeds=touched,
        distance_error=max(errors),
        least_distances=least,
        closing_speeds=fastest,
    )


def time_to_standstill(bench: SeparationBench, seed: int) -> float:
    """[s] from the last sample of a hand that is far away until the arm stands still, in the middle of a motion."""
    rng = np.random.default_rng(seed)
    bench.start(ActionKind.ROBOT_TASK, 1, 1.0, rng)
    for _ in range(round(0.2 / bench.config.period)):
        bench.step(FAR)
    age = 0.0
    while True:
        _, rate, _ = bench.step(FAR, age)
        for k in range(len(rate)):
            if rate[k] == 0:
                return age + k * CHECK_STEP
        age += bench.config.period
