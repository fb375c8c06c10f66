"""Running one episode and saying what it cost."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from time import perf_counter

import numpy as np

from pace_drake.evaluate.event_log import EventRecorder
from pace_drake.simulation import Listener, Simulation
from pace_drake.stations.layout import Layout
from pace_drake.task import Episode

#: [s] between samples of the phase for the timeline, and between looks at the progress.
SAMPLE_PERIOD = 0.5


def by_joint(values: Sequence[float]) -> dict[str, float]:
    """Idle times (L) [s] by the 1-based joint action, and their total."""
    return {**{str(k): value for k, value in enumerate(values, start=1)}, "total": sum(values)}


@dataclass(frozen=True)
class EpisodeResult:
    """What one episode was like.

    Attributes:
        robot_idle, human_idle: (L,) [s] per joint action.
        cost: [s] robot idle + lambda * human idle (Eq. 1).
        decisions: how many were asked for (a whole number, but for a mean).
        finished: False if truncated.
        duration: [s] simulated.
        real_time_factor: simulated over wall time.
        phase_rmse: root mean square error of the phase at the decisions made during non-joint actions, against the
            true linear progress; None if there were none.
        truncation: why it was truncated; None if it was not, and of a mean.
    """

    robot_idle: tuple[float, ...]
    human_idle: tuple[float, ...]
    cost: float
    decisions: float
    finished: bool
    duration: float
    real_time_factor: float
    phase_rmse: float | None
    truncation: str | None = None

    def to_json(self) -> dict:
        """Idle times keyed by the 1-based joint action, and their total."""
        content = asdict(self)
        for agent in ("robot_idle", "human_idle"):
            content[agent] = by_joint(content[agent])
        return content


def run_episode(
    simulation: Simulation,
    episode: Episode,
    write: Callable[..., None] = lambda *_, **__: None,
    *,
    progress: Callable[[float], None] = lambda _time: None,
    sample_phase: bool = False,
    layout: Layout | None = None,
    listeners: tuple[Listener, ...] = (),
) -> EpisodeResult:
    """Runs one episode with the policy inside the diagram.

    Args:
        simulation: its listeners are replaced for the run by the event recorder and ``listeners``.
        episode: what was drawn.
        write: takes the events, ``write(time, kind, **values)``.
        progress: called with the simulated time [s].
        sample_phase: also write the phase every ``SAMPLE_PERIOD``.
        layout: where the components lie; see ``Simulation.reset``.
        listeners: see ``Simulation``.
    """
    scenario = simulation.assembly.scenario
    joint = set(scenario.task.human_index_of_joint)
    errors: list[float] = []

    def observe_and_write(time: float, kind: str, **values) -> None:
        if kind == "decision" and values["human_action"] not in joint:
            errors.append(values["phase"] - values["progress"])
        write(time, kind, **values)

    recorder = EventRecorder(observe_and_write)
    simulation.listeners = (recorder, *listeners)

    def observe() -> None:
        if sample_phase and not simulation.finished:
            write_phase(simulation, write)
        progress(simulation.time)

    start = perf_counter()
    simulation.reset(episode, layout)
    write(0.0, "episode", name="start")
    finished = simulation.run(observe=observe, period=SAMPLE_PERIOD)
    wall = perf_counter() - start
    recorder.finish(simulation.time)
    write(simulation.time, "episode", name="finished" if finished else "truncated")
    return EpisodeResult(
        robot_idle=tuple(simulation.output("robot_idle").tolist()),
        human_idle=tuple(simulation.output("human_idle").tolist()),
        cost=float(simulation.output("cost")[0]),
        decisions=simulation.num_decisions,
        finished=finished,
        duration=simulation.time,
        real_time_factor=simulation.time / wall,
        phase_rmse=float(np.sqrt(np.mean(np.square(errors)))) if errors else None,
        truncation=simulation.truncation,
    )


def write_phase(simulation: Simulation, write: Callable[..., None]) -> None:
    """Writes a sample of the phase, for the timeline."""
    human = simulation.assembly.human
    write(
        simulation.time,
        "phase",
        human_action=int(simulation.output("human_action")[0]),
        phase=simulation.output("phase")[0],
        progress=human.progress(human.GetMyContextFromRoot(simulation.context)),
    )


def mean_result(results: list[EpisodeResult]) -> dict:
    """Means over episodes, in the layout of ``EpisodeResult.to_json``."""
    rmse = [r.phase_rmse**2 for r in results if r.phase_rmse is not None]
    return EpisodeResult(
        robot_idle=tuple(np.mean([r.robot_idle for r in results], axis=0).tolist()),
        human_idle=tuple(np.mean([r.human_idle for r in results], axis=0).tolist()),
        cost=float(np.mean([r.cost for r in results])),
        decisions=float(np.mean([r.decisions for r in results])),
        finished=all(r.finished for r in results),
        duration=float(np.mean([r.duration for r in results])),
        real_time_factor=sum(r.duration for r in results) / sum(r.duration / r.real_time_factor for r in results),
        phase_rmse=float(np.sqrt(np.mean(rmse))) if rmse else None,
    ).to_json()
