"""How much of the task's chart the checks and the traces hold in place: mutants of it must not survive both."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.statechart import Chart, CompiledChart, Transition, compile_chart
from pace_drake.statechart.check import check, load_spec
from pace_drake.statechart.expressions import Expression, negation
from tests.statechart.traces import agrees, shipped, traces

#: Mutants that do what the chart does, with the reason.
EQUIVALENT = {
    "t_start without ab = 0": "an aborted assistance is over (h_aborted) before an episode can end",
}


def mutants(chart: Chart) -> Iterator[tuple[str, Chart]]:
    """Guards negated, effects dropped, targets moved to the next two leaves."""

    def with_transition(k: int, transition: Transition) -> Chart:
        return replace(chart, transitions=(*chart.transitions[:k], transition, *chart.transitions[k + 1 :]))

    for k, transition in enumerate(chart.transitions):
        guard = Expression(f"!({transition.guard.text})", negation(transition.guard.tree))
        yield f"{transition.id} with its guard negated", with_transition(k, replace(transition, guard=guard))
        for n, (name, expression) in enumerate(transition.effects):
            effects = (*transition.effects[:n], *transition.effects[n + 1 :])
            yield (
                f"{transition.id} without {name} = {expression.text}",
                with_transition(k, replace(transition, effects=effects)),
            )
        ends = chart.possible_leaves(transition)
        others = [leaf for leaf in chart.leaves if leaf not in ends or len(ends) > 1]
        start = chart.leaves.index(ends[-1])
        for leaf in sorted(others, key=lambda leaf: (chart.leaves.index(leaf) - start - 1) % len(chart.leaves))[:2]:
            yield f"{transition.id} to {leaf}", with_transition(k, replace(transition, target=leaf))


def found_by_check(compiled: CompiledChart) -> bool:
    spec = load_spec(resource_path("statecharts/pace_task.checks.yaml"), parameters={"M": 2, "L": 1})
    parts = tuple(replace(part, compiled=compiled) if part.name == "task" else part for part in spec.components)
    try:
        return not check(replace(spec, components=parts), max_states=4000).holds  # the chart itself has 952
    except InputError:
        return True  # a timer without a length, or numbers without end: refused by name


@pytest.mark.slow
def test_mutants_are_found():
    survivors: list[str] = []
    by_traces, by_check, number = 0, 0, 0
    for name, chart in mutants(shipped("pace_task").chart):
        number += 1
        compiled = compile_chart(chart)
        traced = not all(agrees(compiled, trace) for trace in traces())
        checked = found_by_check(compiled)
        by_traces, by_check = by_traces + traced, by_check + checked
        if not traced and not checked:
            survivors.append(name)
    print(f"{number} mutants: {by_traces} found by traces, {by_check} by checks; survivors: {survivors}")
    assert number > 90
    assert len(survivors) <= 0.03 * number
    assert set(survivors) == set(EQUIVALENT)
