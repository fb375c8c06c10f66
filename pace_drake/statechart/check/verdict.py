"""Runs a whole check and gives a verdict on each property, with the shortest counterexample."""

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pace_drake.statechart.check.explore import MAX_STATES, Composition, Graph, Step, explore, restricted_steps
from pace_drake.statechart.check.fairness import find_lasso
from pace_drake.statechart.check.guards import check_guards
from pace_drake.statechart.check.spec import Property, Spec
from pace_drake.statechart.model import Chart


@dataclass(frozen=True)
class Row:
    """One tick of a counterexample.

    Attributes:
        tick: from 1 on; in it every chart reacts once.
        inputs: ``component.input`` -> value, of the free inputs that were read and are not 0.
        fired: component -> transitions taken.
        leaves: component -> leaf after it.
        changed: ``component.variable`` -> value after it, where it changed.
    """

    tick: int
    inputs: dict[str, float]
    fired: dict[str, list[str]]
    leaves: dict[str, str]
    changed: dict[str, float]


@dataclass(frozen=True)
class Verdict:
    """What was found out about one property.

    Attributes:
        holds: whether the property holds.
        text: the property as written, or what went wrong.
        examined: how many states were visited, or questions answered by z3.
        unit: ``states`` or ``queries``.
        seconds: [s] it took; states visited once for several properties take the time once.
        rows: the shortest counterexample, or the shortest way to what should be reachable.
        loop: tick at which a counterexample without end begins to repeat; None if it has an end.
        reachable: whether something was to be found, rather than to be excluded.
    """

    name: str
    holds: bool
    text: str
    examined: int
    unit: str
    seconds: float
    rows: tuple[Row, ...] = ()
    loop: int | None = None
    reachable: bool = False


@dataclass(frozen=True)
class Report:
    """All verdicts of one check.

    Attributes:
        states, steps: reachable states and steps between them.
    """

    path: str
    states: int
    steps: int
    verdicts: tuple[Verdict, ...] = field(default_factory=tuple)

    @property
    def holds(self) -> bool:
        """Whether every property holds."""
        return all(verdict.holds for verdict in self.verdicts)


def check(spec: Spec, max_states: int = MAX_STATES) -> Report:
    """Checks every property.

    Args:
        spec: what, of which charts.
        max_states: give up beyond.

    Raises:
        InputError: the composition has too many states, or a horizon is missing.
    """
    charts = {part.compiled.chart.path: part.compiled.chart for part in spec.components}
    verdicts = [verdict for chart in charts.values() for verdict in _guard_verdicts(chart)]
    composition = Composition(spec)
    simple = [p for p in spec.properties if p.form != "eventually"]
    final = [p for p in spec.properties if p.form == "eventually"]
    started = time.perf_counter()
    marked = [formula for p in final for formula in (p.formula, *([p.start] if p.start else []))]
    graph = explore(composition, simple, marked, max_states)
    seconds = time.perf_counter() - started
    if graph.failed is not None:
        state, what = graph.failed
        rows = _rows(composition, graph.path(state))
        verdicts.append(Verdict("no chart fails", False, what, len(graph.states), "states", seconds, rows))
        return Report(spec.path, len(graph.states), len(graph.sources), tuple(verdicts))
    verdicts.append(Verdict("no chart fails", True, "every reaction has a value", len(graph.states), "states", seconds))
    for prop in simple:
        hit = graph.found.get(prop.name)
        rows = _rows(composition, [*graph.path(hit[0]), hit]) if hit is not None else ()
        reachable = prop.form == "reachable"
        verdicts.append(
            Verdict(
                prop.name,
                (hit is not None) == reachable,
                prop.formula.text,
                len(graph.states),
                "states",
                seconds,
                rows,
                reachable=reachable,
            )
        )
    column = 0
    for prop in final:
        verdicts.append(_eventually(composition, graph, prop, column))
        column += 1 if prop.start is None else 2
    return Report(spec.path, len(graph.states), len(graph.sources), tuple(verdicts))


def check_chart(chart: Chart) -> Report:
    """Checks one chart without surroundings: determinism and dead transitions."""
    return Report(chart.path, 0, 0, tuple(_guard_verdicts(chart)))


def _guard_verdicts(chart: Chart) -> list[Verdict]:
    started = time.perf_counter()
    report = check_guards(chart)
    seconds = time.perf_counter() - started
    faults = [f"in {leaf}, {a} and {b} are both enabled ({example})" for leaf, a, b, example in report.overlaps]
    faults += [f"not proven: {what}" for what in report.unproven]
    dead = ", ".join(report.dead)
    return [
        Verdict(
            f"{chart.name} is deterministic",
            not faults,
            "; ".join(faults) or "no two transitions of one state are ever enabled together",
            report.queries,
            "queries",
            seconds,
        ),
        Verdict(
            f"{chart.name} has no dead transition",
            not dead,
            f"{chart.path}: {dead} can never be taken" if dead else "every transition can be taken in some leaf",
            report.queries,
            "queries",
            seconds,
        ),
    ]


def _eventually(composition: Composition, graph: Graph, prop: Property, column: int) -> Verdict:
    started = time.perf_counter()
    spec = composition.spec
    index = {component.name: k for k, component in enumerate(spec.components)}
    fixed = {}
    for text, value in prop.at_last.items():
        component, _, name = text.partition(".")
        fixed[index[component], name] = value
    formulas = [prop.formula, *(f for fairness in prop.fairness for f in (fairness.when, fairness.then))]
    sources, targets, marks = restricted_steps(composition, graph, fixed, formulas)
    off = ~marks[:, 0]
    before = ~graph.marks[:, column]
    starts = np.array([0]) if prop.start is None else np.unique(graph.sources[graph.marks[:, column + 1]])
    pairs = [(marks[off, 1 + 2 * k], marks[off, 2 + 2 * k]) for k in range(len(prop.fairness))]
    lasso = find_lasso(
        len(graph.states), (graph.sources[before], graph.targets[before]), starts, (sources[off], targets[off]), pairs
    )
    text = prop.formula.text
    if lasso is None:
        seconds = time.perf_counter() - started
        return Verdict(prop.name, True, text, len(graph.states), "states", seconds)
    path = graph.path(lasso.stem[0])
    path += _steps_along(composition, graph, lasso.stem, {})
    loop = len(path) + 1
    path += _steps_along(composition, graph, lasso.loop, fixed)
    seconds = time.perf_counter() - started
    return Verdict(prop.name, False, text, len(graph.states), "states", seconds, _rows(composition, path), loop)


def _steps_along(
    composition: Composition, graph: Graph, way: Sequence[int], fixed: dict[tuple[int, str], float]
) -> list[tuple[int, Step]]:
    """A step from each state of a way to the next."""
    steps = []
    for at, following in itertools.pairwise(way):
        options = composition.steps(graph.states[at], fixed)
        steps.append((at, next(step for step, end in options if end == graph.states[following])))
    return steps


def _rows(composition: Composition, path: list[tuple[int, Step]]) -> tuple[Row, ...]:
    """Plays a path with the charts themselves: real times and numbers, and a test of the exploration's own short cuts.

    Raises:
        RuntimeError: the charts do not do what exploration says; a mistake in this package.
    """
    spec = composition.spec
    compiled = [component.compiled for component in spec.components]
    x = [c.initial_state(**part.initial).tolist() for c, part in zip(compiled, spec.components, strict=True)]
    p = [c.parameters(**part.parameters).tolist() for c, part in zip(compiled, spec.components, strict=True)]
    rows = []
    for tick, (_, step) in enumerate(path, 1):
        after: list[list[float]] = []
        row = Row(tick, {}, {}, {}, {})
        for k, part in enumerate(spec.components):
            u = compiled[k].inputs().tolist()
            for name, place in compiled[k].input_index.items():
                if (k, name) in spec.connections:
                    source = spec.connections[k, name].source
                    values = after[source] if source in spec.immediate else x[source]
                    u[place] = _value(spec, p, k, name, values)
                elif (k, name) in spec.free:
                    u[place] = step[k].u[place]
                    if u[place] != 0 and name in composition.components[k].open_reads(int(x[k][0])):
                        row.inputs[f"{part.name}.{name}"] = u[place]
            y, fired = composition.components[k].step(x[k], u, tick - 1.0)
            if fired != step[k].fired and composition.components[k].tells_transitions_apart:
                raise RuntimeError(f"exploration and the chart {part.name} differ at tick {tick}; please report this")
            row.leaves[part.name] = compiled[k].leaf(y)
            if fired:
                row.fired[part.name] = [compiled[k].chart.transitions[n].id for n in fired]
            for name, place in compiled[k].variable_index.items():
                if y[place] != x[k][place]:
                    row.changed[f"{part.name}.{name}"] = y[place]
            after.append(list(y))
        rows.append(row)
        x = after
    return tuple(rows)


def _value(spec: Spec, p: list[list[float]], reader: int, name: str, values: list[float]) -> float:
    connection = spec.connections[reader, name]
    compiled = spec.components[connection.source].compiled
    if connection.kind == "state":
        return float(connection.name in compiled.chart.ancestors(compiled.leaf(values)))
    if connection.kind == "variable":
        return values[compiled.variable_index[connection.name]]
    return compiled.outputs(values, p[connection.source])[compiled.output_index[connection.name]]
