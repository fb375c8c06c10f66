"""Were the decisions of a run those that the task level makes, given what happened?

The durations that the robot's motions really took are put into the task level, which then plays the episode without
robot, plant or network, reacting at the same instants. Its decisions must be the run's.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from pace_drake.bridge.session import REACTION_PERIOD
from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.evaluate.event_log import EventRecorder
from pace_drake.evaluate.workcell import Command, with_durations
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation
from pace_drake.task import ActionKind, Episode

#: Transitions of the chart that end a motion.
_ENDS = ("r_done", "p_joint", "p_wait", "j_done", "h_next", "h_end", "h_aborted")
#: [s] by which a motion is shortened, so that rounding cannot put its end behind the instant at which it was seen.
_ROUNDING = 1e-6
#: What a decision is made from; times may differ by rounding, nothing else may.
_DECIDED = ("robot_task", "human_action", "joint_action", "assist", "name", "phase")


@dataclass(frozen=True)
class Retraced:
    """How the decisions of a run compare with the task level's."""

    num_decisions: int
    num_equal: int
    """the leading decisions that are the same, with the same observation."""
    difference: str
    """What differs first; empty if nothing does."""

    @property
    def equal(self) -> bool:
        """Whether all are."""
        return not self.difference


def episode_to_json(episode: Episode) -> dict:
    """An episode as it is written into a run folder; floats stay exact."""
    return {name: np.asarray(value).tolist() for name, value in asdict(episode).items()}


def read_episode(path: Path) -> Episode:
    """Reads what ``episode_to_json`` wrote.

    Raises:
        InputError: the file cannot be read, or is no episode.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Episode(**{name: np.array(value) for name, value in content.items()})
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: cannot read the episode: {error}") from error


def retrace(
    events: Iterable[dict[str, str]], scenario: Scenario, policy: Policy, episode: Episode, people: People | None = None
) -> Retraced:
    """Plays a run again at the task level and compares the decisions.

    Args:
        events: rows of the run's events.csv.
        scenario: of the run.
        policy: of the run.
        episode: what was drawn for it.
        people: None loads those of the scenario.

    Raises:
        InputError: the events are not those of a run that has begun.
    """
    rows = list(events)
    start = next((float(row["time"]) for row in rows if row["kind"] == "episode"), None)
    if start is None:
        raise InputError("the events hold no start of an episode: the collaboration had not begun")
    decided = [row for row in rows if row["kind"] == "decision"]
    commands = _commands(rows)
    measured = with_durations(episode, commands)
    # The robot's part of a joint action takes as long as it took; the person's is drawn.
    joint = episode.human[[j - 1 for j in scenario.task.human_index_of_joint]]
    for command in commands:
        if command.kind == ActionKind.JOINT:
            joint[command.index - 1] = command.duration
    assembly = Assembly(scenario, policy, people=people)
    repeated: list[dict[str, Any]] = []

    def note(time: float, kind: str, **values: Any) -> None:
        if kind == "decision":
            repeated.append({"time": time, **values})

    simulation = Simulation(assembly, (EventRecorder(note),), period=REACTION_PERIOD)
    simulation.reset(measured, time=start)
    action = assembly.robot_action
    action.set_durations(action.GetMyMutableContextFromRoot(simulation.context), measured, joint)
    while len(repeated) < len(decided) and not simulation.finished:
        simulation.advance(simulation.time + 10.0)
    for k, row in enumerate(decided):
        if k >= len(repeated):
            return Retraced(len(decided), k, f"decision {k + 1} was not asked for")
        if difference := _difference(row, repeated[k]):
            return Retraced(len(decided), k, f"decision {k + 1}: {difference}")
    return Retraced(len(decided), len(decided), "")


def _difference(row: dict[str, str], again: dict[str, Any]) -> str:
    for name in _DECIDED:
        there, here = row[name], again[name]
        if (there != here) if name == "name" else (float(there) != float(here)):
            return f"{name} {there} in the run, {here} at the task level"
    for name in ("time", "elapsed"):
        if not isclose(float(row[name]), float(again[name]), abs_tol=1e-6):
            return f"{name} {row[name]} in the run, {again[name]} at the task level"
    return ""


def _commands(rows: list[dict[str, str]]) -> list[Command]:
    """The motions of a run, each once: one that was held and issued again counts from its first command."""
    commands: list[Command] = []
    began = None
    for row in rows:
        if row["kind"] == "command" and began is None and row["name"] != ActionKind.HOLD.name:
            began = row
        elif row["kind"] == "reaction" and row["name"] in _ENDS and began is not None:
            kind, index = ActionKind[began["name"]], int(began["robot_task"] or began["joint_action"])
            duration = float(row["time"]) - float(began["time"]) - _ROUNDING
            commands.append(Command(kind, index, len(commands) + 1, duration))
            began = None
    return commands
