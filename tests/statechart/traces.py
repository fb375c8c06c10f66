"""Closed-loop traces of the task's chart: robot, person, operator and policy by chance, seeded."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from pace_drake.resources import resource_path
from pace_drake.statechart import CompiledChart, compile_chart, load_chart

NUM_TRACES, NUM_REACTIONS = 64, 200


@cache
def shipped(name: str) -> CompiledChart:
    return compile_chart(load_chart(resource_path(f"statecharts/{name}.scxml")))


@dataclass(frozen=True)
class Trace:
    """What was fed to a chart, and what it did.

    Attributes:
        parameters: values of the chart's parameters.
        inputs: for each reaction, the inputs by name.
        times: [s] of each reaction.
        fired: for each reaction, the transition or -1.
        states: for each reaction, x after it.
    """

    parameters: dict[str, float]
    inputs: list[dict[str, float]]
    times: list[float]
    fired: list[int]
    states: list[list[float]]


def record(seed: int) -> Trace:
    """Lets the shipped charts play against each other, each reading what the others were before."""
    rng = np.random.default_rng(seed)
    task, robot, human = shipped("pace_task"), shipped("robot"), shipped("human")
    parameters = {
        "M": float(rng.integers(1, 5)),
        "L": float(rng.integers(1, 4)),
        "D0": float(rng.integers(2)),
        "Tdec": float(rng.choice([0.5, 2.0])),
        "Twait": float(rng.choice([1.5, 1e9])),
    }
    arrives = float(rng.choice([0.3, 0.03]))
    stops = float(rng.choice([0.0, 0.03, 0.3]))
    p = task.parameters(**parameters).tolist()
    person_p = human.parameters(L=parameters["L"]).tolist()
    x, r, h = (chart.initial_state().tolist() for chart in (task, robot, human))
    time = 0.0
    trace = Trace(parameters, [], [], [], [])

    def chance(probability: float) -> float:
        return float(rng.random() < probability)

    for _ in range(NUM_REACTIONS):
        time += float(rng.exponential(0.5)) if rng.random() < 0.8 else 0.0
        kind, index, number, ready, *_ = task.outputs(x, p)
        done, busy = robot.outputs(r, [])
        here, finished = human.outputs(h, person_p)
        decision = float(rng.choice([-1.0, 0.0, 1.0], p=[0.5, 0.2, 0.3]))
        u = {
            "start": chance(0.7), "stop": chance(stops), "fault": chance(stops / 3), "ack": chance(0.5), "a": decision,
            "done": done, "rb": busy, "hj": here, "nj": finished,
        }  # fmt: skip
        robot_u = robot.inputs(
            kind=kind, index=index, number=number, look=chance(0.8), finish=chance(0.5), still=chance(0.7)
        )
        human_u = human.inputs(ready=ready, arrive=chance(arrives), finish=chance(0.5))
        x, fired = task.react(x, task.inputs(**u).tolist(), p, time)
        r, _ = robot.react(r, robot_u.tolist(), [], time)
        h, _ = human.react(h, human_u.tolist(), person_p, time)
        if task.leaf(x) == "READY":
            h = human.initial_state().tolist()  # another person begins
        trace.inputs.append(u)
        trace.times.append(time)
        trace.fired.append(fired)
        trace.states.append(x)
    return trace


@cache
def traces() -> tuple[Trace, ...]:
    return tuple(record(seed) for seed in range(NUM_TRACES))


def coverage() -> set[str]:
    """Transitions taken in some trace."""
    chart = shipped("pace_task").chart
    return {chart.transitions[k].id for trace in traces() for k in trace.fired if k >= 0}


def agrees(compiled: CompiledChart, trace: Trace) -> bool:
    """Whether a chart does the same when it is fed the same."""
    x = compiled.initial_state().tolist()
    p = compiled.parameters(**trace.parameters).tolist()
    for u, time, fired, state in zip(trace.inputs, trace.times, trace.fired, trace.states, strict=True):
        x, taken = compiled.react(x, compiled.inputs(**u).tolist(), p, time)
        if taken != fired or x != state:
            return False
    return True
