"""The chart that a scenario names, ready to run: compiled, with the scenario's parameters, and at its beginning."""

from typing import NamedTuple

import numpy as np

from pace_drake.errors import InputError
from pace_drake.scenario import Scenario
from pace_drake.statechart import Chart, CompiledChart, compile_chart, load_chart

#: What a chart must have to decide about the robot's actions; others may lie beside these.
NEEDED = {
    "inputs": ("a", "done", "rb", "hj", "nj"),
    "outputs": (
        *("kind", "index", "number", "robot_task", "joint_action", "joint_ready", "robot_waiting"),
        "decision_index",
    ),
    "variables": ("i",),
}


class TaskChart(NamedTuple):
    """A chart, its parameters p, and its state x before the first reaction."""

    compiled: CompiledChart
    parameters: np.ndarray
    initial_state: np.ndarray


def check_task_chart(chart: Chart) -> None:
    """Raises InputError that names all that a chart lacks of ``NEEDED``."""
    lacks = {group: [n for n in names if n not in getattr(chart, group)] for group, names in NEEDED.items()}
    if any(lacks.values()):
        text = ", ".join(f"{group} {', '.join(names)}" for group, names in lacks.items() if names)
        raise InputError(
            f"{chart.path}: no chart of the collaboration, it lacks {text}; begin with a copy of pace_task.scxml"
        )


def make_task_chart(scenario: Scenario) -> TaskChart:
    """Compiles the chart of a scenario.

    Args:
        scenario: a validated one.

    Raises:
        InputError: the chart cannot be read, or lacks something that is ``NEEDED``.
    """
    compiled = compile_chart(load_chart(scenario.chart_path()))
    check_task_chart(compiled.chart)
    task, declared = scenario.task, compiled.chart.parameters
    values = {
        "M": float(task.num_robot_tasks),
        "L": float(task.num_joint_actions),
        "D0": float(scenario.decide_at_start),
        "Tdec": scenario.decision_timeout,
        "Twait": scenario.wait_timeout,
    }
    return TaskChart(
        compiled,
        compiled.parameters(**{name: value for name, value in values.items() if name in declared}),
        # A first decision at t = 0 sees the last robot task as done (docs/departures.md).
        compiled.initial_state(i=float(task.num_robot_tasks if scenario.decide_at_start else 1)),
    )
