"""The event log of a run: one CSV row per reaction, decision, change of the person's activity and idle interval."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from pace_drake.simulation import Simulation
from pace_drake.task import ActionKind

#: Columns of events.csv; units: time, elapsed, start and duration in [s].
COLUMNS = (
    "episode",
    "time",
    "kind",
    "name",
    "source",
    "target",
    "robot_task",
    "human_action",
    "joint_action",
    "elapsed",
    "phase",
    "progress",
    "assist",
    "start",
    "duration",
)


def event_row(time: float, kind: str, **values: Any) -> dict[str, Any]:
    """An event as it is written; see ``COLUMNS``."""
    # repr of a float is exact: equal traces are equal files.
    row = {key: repr(float(v)) if isinstance(v, float | np.floating) else v for key, v in values.items()}
    return {"time": repr(float(time)), "kind": kind, **row}


class EventLog:
    """Appends rows to a file, one write each, so that a killed process leaves every event so far.

    Kinds of rows: ``episode`` (start and end), ``reaction`` (a transition), ``decision`` (what was observed and
    answered; ``progress`` is the true share of the action's time that has passed), ``human`` (an action or waiting
    begins), ``command`` (what the robot is told), ``robot_idle`` and ``human_idle`` (intervals, written at their end),
    ``phase`` (samples for the timeline), ``fault`` (what the gripper has lost; ``name`` says it).

    Args:
        path: created; it must not exist.
    """

    def __init__(self, path: Path) -> None:
        self._file: TextIO = path.open("x", newline="", encoding="utf-8", buffering=1)
        self._writer = csv.DictWriter(self._file, COLUMNS, restval="")
        self._writer.writeheader()

    def write(self, episode: int, time: float, kind: str, **values: Any) -> None:
        """Appends one row; see ``COLUMNS``."""
        self._writer.writerow({"episode": episode, **event_row(time, kind, **values)})

    def close(self) -> None:
        """Ends the log."""
        self._file.close()

    def __enter__(self) -> "EventLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class EventRecorder:
    """Turns what happens in one episode of a Simulation into rows; register it as a listener.

    Args:
        write: called as ``write(time, kind, **values)``; see ``COLUMNS``.
    """

    def __init__(self, write: Callable[..., None]) -> None:
        self._write = write
        self._human: tuple[int, bool] | None = None
        self._num_lost = 0
        self._command: tuple[float, ...] | None = None
        self._idle_since: dict[str, tuple[float, int] | None] = {"robot_idle": None, "human_idle": None}
        self._before: dict[str, float] = {}

    def __call__(self, simulation: Simulation, before: bool) -> None:
        """See ``pace_drake.simulation.Listener``."""
        assembly, context = simulation.assembly, simulation.context
        chart = assembly.task_statechart
        chart_context = chart.GetMyContextFromRoot(context)
        self._watch_human(simulation)
        self._watch_grasp(simulation)
        if before:
            self._before = self._observe(simulation) if simulation.decision_pending else {}
            return
        model = chart.compiled.chart
        for reaction in chart.reactions(chart_context):
            name, source = reaction.transition, reaction.source
            if model.states[source].decision is not None and self._before:
                self._write(simulation.time, "decision", name=name, **self._before)
            self._write(simulation.time, "reaction", name=name, source=source, target=reaction.target)
        command = tuple(simulation.output("robot_action"))
        if command[2] > 0 and command != self._command and command[0] > 0:
            self._command = command
            action_context = assembly.robot_action.GetMyContextFromRoot(context)
            end = assembly.robot_action.GetOutputPort("next_event_time").Eval(action_context)[0]
            kind = ActionKind(int(command[0]))
            duration = {} if not np.isfinite(end) else {"duration": end - simulation.time}
            index = {"robot_task" if kind == ActionKind.ROBOT_TASK else "joint_action": int(command[1])}
            self._write(simulation.time, "command", name=kind.name, **index, **duration)
        waiting = int(chart.GetOutputPort("robot_waiting").Eval(chart_context)[0])
        self._watch_idle(simulation.time, "robot_idle", waiting)

    def finish(self, time: float) -> None:
        """Writes the idle intervals that are still open at the end of the episode [s]."""
        for kind in self._idle_since:
            self._watch_idle(time, kind, joint=0)

    def _observe(self, simulation: Simulation) -> dict[str, Any]:
        robot_task, human_action, elapsed = simulation.output("observation")[:3]
        phase = simulation.output("phase")[0]
        assembly, context = simulation.assembly, simulation.context
        if assembly.decision is not None:
            port = assembly.decision.GetOutputPort("assist")
            assist = port.Eval(assembly.decision.GetMyContextFromRoot(context))[0]
        else:
            assist = assembly.GetInputPort("assist").Eval(context)[0]
        return {
            "robot_task": int(robot_task),
            "human_action": int(human_action),
            "joint_action": int(simulation.output("joint_action")[0]),
            "elapsed": elapsed,
            "phase": phase,
            "progress": assembly.human.progress(assembly.human.GetMyContextFromRoot(context)),
            "assist": int(assist),
        }

    def _watch_human(self, simulation: Simulation) -> None:
        action = int(simulation.output("human_action")[0])
        waiting = bool(simulation.output("human_waiting")[0])
        if (action, waiting) != self._human:
            self._human = (action, waiting)
            name = simulation.assembly.scenario.task.human_actions[action - 1].name
            start = simulation.time - float(simulation.output("human_elapsed")[0])
            self._write(
                simulation.time,
                "human",
                name=f"wait {name}" if waiting else name,
                human_action=action,
                start=start,
            )
        joint = simulation.assembly.scenario.task.human_index_of_joint.index(action) + 1 if waiting else 0
        self._watch_idle(simulation.time, "human_idle", joint)

    def _watch_grasp(self, simulation: Simulation) -> None:
        monitor = simulation.assembly.grasp_monitor
        if monitor is None:
            return
        context = monitor.GetMyContextFromRoot(simulation.context)
        if monitor.num_lost(context) > self._num_lost:
            self._write(simulation.time, "fault", name=monitor.describe(context))
        self._num_lost = monitor.num_lost(context)

    def _watch_idle(self, time: float, kind: str, joint: int) -> None:
        since = self._idle_since[kind]
        if since is not None and since[1] != joint:
            if time > since[0]:  # who arrives at the very instant at which the other is ready has not waited
                self._write(time, kind, joint_action=since[1], start=since[0], duration=time - since[0])
            self._idle_since[kind] = None
        if joint and self._idle_since[kind] is None:
            self._idle_since[kind] = (time, joint)
