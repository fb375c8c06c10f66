"""Does the robot really do it? Episodes of the plant level, and what became of cubes, components and limits."""

import gc
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from time import perf_counter, process_time

import numpy as np
import psutil

from pace_drake.errors import InputError
from pace_drake.evaluate.plant_log import LimitsKept, PlantLog, check_limits
from pace_drake.evaluate.report import Table
from pace_drake.simulation import Simulation
from pace_drake.stations.components import component_index, tray_index
from pace_drake.stations.plant import PlantStation
from pace_drake.task import ActionKind, Episode

#: [m] a sorted cube lies at most this far from the middle of its tray.
SORT_TOLERANCE = 0.015
#: [m] and the chair's side from its place on the rails.
PLACE_TOLERANCE = 0.01


@dataclass(frozen=True)
class Sort:
    """One finished robot task.

    Attributes:
        time: [s] when it was done.
        robot_task: i.
        error: [m] horizontal distance of the cube from the middle of its tray.
        height: [m] of the cube's centre over the tray's lower face.
    """

    time: float
    robot_task: int
    error: float
    height: float

    @property
    def good(self) -> bool:
        """Whether the cube lies in the right tray."""
        return self.error <= SORT_TOLERANCE and self.height < 0.05


@dataclass(frozen=True)
class Command:
    """One command that the robot has carried out."""

    kind: ActionKind
    index: int
    sequence: int
    duration: float
    """[s] that it took."""


@dataclass
class WorkcellRecorder:
    """A listener that keeps decisions, finished commands and sorts of one episode."""

    sorts: list[Sort] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    decisions: list[tuple[int, int, int]] = field(default_factory=list)
    """(robot task, human action, answer)."""
    _begun: dict[int, tuple[ActionKind, int, float]] = field(default_factory=dict)
    _latest: int = 0
    _seen: tuple[int, int] = (0, 0)

    def __call__(self, simulation: Simulation, before: bool) -> None:
        """See ``pace_drake.simulation.Listener``."""
        assembly = simulation.assembly
        robot_action = assembly.robot_action
        if before:
            if simulation.decision_pending:
                self._seen = (int(simulation.output("robot_task")[0]), int(simulation.output("human_action")[0]))
            context = robot_action.GetMyContextFromRoot(simulation.context)
            done = int(robot_action.GetOutputPort("motion_done").Eval(context)[0])
            if done in self._begun:
                kind, index, begin = self._begun.pop(done)
                self.commands.append(Command(kind, index, done, simulation.time - begin))
                if kind == ActionKind.ROBOT_TASK and isinstance(assembly.station, PlantStation):
                    self.sorts.append(_sort(simulation, assembly.station, index))
            return
        chart = assembly.task_statechart
        for reaction in chart.reactions(chart.GetMyContextFromRoot(simulation.context)):
            if reaction.transition in ("d_yes", "d_no", "d_timeout"):
                self.decisions.append((*self._seen, int(reaction.transition == "d_yes")))
        told, place, sequence = (int(value) for value in simulation.output("robot_action"))
        if told not in (ActionKind.NONE, ActionKind.HOLD) and sequence > self._latest:
            self._latest = sequence
            self._begun[sequence] = (ActionKind(told), place, simulation.time)


def _sort(simulation: Simulation, station: PlantStation, robot_task: int) -> Sort:
    workcell = station.workcell
    cube = component_index(workcell, ActionKind.ROBOT_TASK, robot_task)
    assert cube is not None
    X_WTray = workcell.trays[tray_index(workcell, robot_task)].to_rigid_transform()
    p_TrayO = (X_WTray.inverse() @ station.component_pose(simulation.context, cube)).translation()
    return Sort(simulation.time, robot_task, float(np.hypot(*p_TrayO[:2])), float(p_TrayO[2]))


def with_durations(episode: Episode, commands: list[Command]) -> Episode:
    """The episode with the robot's durations as they were; of those that it did not come to, as drawn."""
    robot, preparation, homing = episode.robot.copy(), episode.preparation.copy(), episode.homing.copy()
    for command in commands:
        place = command.index - 1
        if command.kind == ActionKind.ROBOT_TASK:
            robot[(command.sequence - 1) % len(robot), place] = command.duration
        elif command.kind == ActionKind.PREPARE:
            preparation[place] = command.duration
        elif command.kind in (ActionKind.HOME, ActionKind.HOME_ABORTED):
            homing[place] = command.duration
    return Episode(episode.human, episode.demonstration, robot, preparation, homing)


@dataclass(frozen=True)
class WorkcellEpisode:
    """What became of one episode.

    Attributes:
        seed: of the episode, with its number.
        finished: whether the assembly was finished.
        duration: [s] simulated.
        real_time_factor: [-] simulated time over wall time, planning included.
        cpu_real_time_factor: [-] simulated time over the process's CPU time: what one free core would give.
        sorts: of the cubes.
        joint_actions: how many were done.
        side_error: [m] of the chair's side from its place on the rails.
        keys_taken: how many Allen keys the person has.
        limits: how near the arm came to its limits.
        hand_distance: [m] least, of arm and hand; None without a safety monitor, as the next.
        slowed: [-] share of the looks at which the safety monitor slowed the arm.
        same_decisions: whether the task level, given the same durations, decides the same.
        memory: [bytes] resident, of the process, after the episode.
    """

    seed: tuple[int, int]
    finished: bool
    duration: float
    real_time_factor: float
    cpu_real_time_factor: float
    sorts: list[Sort]
    joint_actions: int
    side_error: float
    keys_taken: int
    limits: LimitsKept
    hand_distance: float | None
    slowed: float | None
    same_decisions: bool
    memory: int


def play_workcell(
    plant: Simulation,
    task: Simulation,
    seed: int,
    numbers: Iterable[int],
) -> Iterator[WorkcellEpisode]:
    """Plays episodes at the plant level, and each again at the task level with the durations that came out.

    Args:
        plant: of an assembly with a PlantStation and ``FULL_LOG``.
        task: of an assembly with the same scenario and policy, without a station.
        seed: with the number of the episode it seeds everything.
        numbers: of the episodes.

    Yields:
        What became of each.

    Raises:
        InputError: the plant is not logged.
    """
    station = plant.assembly.station
    if not isinstance(station, PlantStation) or "contact" not in plant.assembly.plant_log:
        raise InputError("play_workcell needs an assembly with a plant station, made with logged=FULL_LOG")
    for number in numbers:
        wall, cpu = perf_counter(), process_time()
        recorder = WorkcellRecorder()
        plant.listeners = (recorder,)
        episode = plant.sample_episode(np.random.default_rng([seed, number]))
        plant.reset(episode, plant.sample_layout(np.random.default_rng([seed, number, 1])))
        finished = plant.run()
        wall, cpu = perf_counter() - wall, process_time() - cpu
        again = WorkcellRecorder()
        task.listeners = (again,)
        task.reset(with_durations(episode, recorder.commands))
        task.run()
        limits, hand_distance, slowed = _look(plant, station)
        side = component_index(station.workcell, ActionKind.PREPARE, 1)
        assert side is not None
        placed = station.workcell.chair_side_placed.to_rigid_transform()
        gc.collect()
        yield WorkcellEpisode(
            seed=(seed, number),
            finished=finished,
            duration=plant.time,
            real_time_factor=plant.time / wall,
            cpu_real_time_factor=plant.time / cpu,
            sorts=recorder.sorts,
            joint_actions=sum(command.kind == ActionKind.JOINT for command in recorder.commands),
            side_error=float(
                np.linalg.norm(station.component_pose(plant.context, side).translation() - placed.translation())
            ),
            keys_taken=int(np.count_nonzero(plant.output("key_taken"))),
            limits=limits,
            hand_distance=hand_distance,
            slowed=slowed,
            same_decisions=recorder.decisions == again.decisions,
            memory=psutil.Process().memory_info().rss,
        )


def _look(plant: Simulation, station: PlantStation) -> tuple[LimitsKept, float | None, float | None]:
    """Limits, least distance of hand and arm [m], share of the looks at which the arm was slowed [-].

    The log is looked at where it lies and not held: copies of it, one of them through the next episode, are what made
    the process grow.
    """
    log = PlantLog.of(plant, copy=False)
    return (
        check_limits(log, station),
        None if log.hand_distance is None else float(log.hand_distance.min()),
        None if log.speed_scale is None else float(np.mean(log.speed_scale < 1)),
    )


def summarize(played: list[WorkcellEpisode], num_joint_actions: int) -> dict:
    """Figures over all episodes, as ``pace evaluate workcell --json`` writes them."""
    sorts = [sort for episode in played for sort in episode.sorts]
    errors = np.array([sort.error for sort in sorts])
    limits = [episode.limits for episode in played]
    first, last = played[0], played[-1]
    return {
        "episodes": len(played),
        "finished": sum(episode.finished for episode in played),
        "simulated": sum(episode.duration for episode in played),
        "real_time_factor": sum(e.duration for e in played) / sum(e.duration / e.real_time_factor for e in played),
        "cpu_real_time_factor": sum(e.duration for e in played)
        / sum(e.duration / e.cpu_real_time_factor for e in played),
        "sorts": len(sorts),
        "good_sorts": sum(sort.good for sort in sorts),
        "sort_error": {"median": float(np.median(errors)), "largest": float(errors.max())} if len(errors) else None,
        "joint_actions": sum(episode.joint_actions for episode in played),
        "joint_actions_due": len(played) * num_joint_actions,
        "sides_placed": sum(episode.side_error <= PLACE_TOLERANCE for episode in played),
        "largest_side_error": max(episode.side_error for episode in played),
        "keys_taken": sum(episode.keys_taken for episode in played),
        "limits_kept": sum(limit.kept for limit in limits),
        "least_distance_from_a_position_limit": min(limit.position for limit in limits),
        "largest_share_of_velocity_limit": max(limit.velocity for limit in limits),
        "largest_share_of_acceleration_limit": max(limit.acceleration for limit in limits),
        "largest_tracking_error": max(limit.tracking for limit in limits),
        "largest_penetration": max(limit.penetration for limit in limits),
        "self_contacts": sum(limit.self_contacts for limit in limits),
        "least_hand_distance": min((e.hand_distance for e in played if e.hand_distance is not None), default=None),
        "slowed": max((e.slowed for e in played if e.slowed is not None), default=None),
        "same_decisions_as_task_level": sum(episode.same_decisions for episode in played),
        "memory_growth_after_the_first": last.memory - first.memory,
        "each": [asdict(episode) for episode in played],
    }


def table(summary: dict) -> Table:
    """The figures for people."""
    n = summary["episodes"]
    error = summary["sort_error"] or {"median": float("nan"), "largest": float("nan")}
    rows = [
        ("episodes finished", f"{summary['finished']} of {n}"),
        (
            f"cubes in the right tray, at most {1e3 * SORT_TOLERANCE:.0f} mm off its middle",
            f"{summary['good_sorts']} of {summary['sorts']}",
        ),
        (
            "  off its middle: median, largest",
            f"{1e3 * error['median']:.1f}, {1e3 * error['largest']:.1f} mm",
        ),
        ("joint actions done", f"{summary['joint_actions']} of {summary['joint_actions_due']}"),
        ("  chair's side on the rails, largest error", f"{1e3 * summary['largest_side_error']:.1f} mm"),
        ("  keys in the person's hands", f"{summary['keys_taken']}"),
        ("episodes within all joint limits, no self-contact", f"{summary['limits_kept']} of {n}"),
        ("  least distance from a position limit", f"{summary['least_distance_from_a_position_limit']:.2f} rad"),
        ("  largest share of a velocity limit", f"{100 * summary['largest_share_of_velocity_limit']:.0f} %"),
        ("  largest share of an acceleration limit", f"{100 * summary['largest_share_of_acceleration_limit']:.0f} %"),
        ("  largest tracking error", f"{summary['largest_tracking_error']:.4f} rad"),
        ("largest penetration", f"{1e3 * summary['largest_penetration']:.2f} mm"),
        (
            "least distance of arm and hand; most of an episode slowed",
            "not monitored"
            if summary["least_hand_distance"] is None
            else f"{summary['least_hand_distance']:.3f} m, {100 * summary['slowed']:.0f} %",
        ),
        ("same decisions at the task level, given the durations", f"{summary['same_decisions_as_task_level']} of {n}"),
        (
            "times faster than real time: wall, CPU time",
            f"{summary['real_time_factor']:.1f}, {summary['cpu_real_time_factor']:.1f}",
        ),
        ("growth of memory after the first episode", f"{summary['memory_growth_after_the_first'] / 2**20:.1f} MiB"),
    ]
    return Table("Plant level", ("", "value"), rows)
