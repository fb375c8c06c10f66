"""What the guards of one chart say by themselves, for every value: determinism and dead transitions, by z3."""

import itertools
from dataclasses import dataclass

from pace_drake.statechart.disjoint import Solver, UnprovenError
from pace_drake.statechart.expressions import negation
from pace_drake.statechart.model import Chart


@dataclass(frozen=True)
class GuardReport:
    """What was found.

    Attributes:
        overlaps: ``(leaf, transition, transition, example)``: both enabled, and neither goes before the other.
        dead: transitions that can be taken in no leaf.
        unproven: questions without an answer.
        queries: how many questions were asked.
    """

    overlaps: tuple[tuple[str, str, str, str], ...]
    dead: tuple[str, ...]
    unproven: tuple[str, ...]
    queries: int


def check_guards(chart: Chart) -> GuardReport:
    """Asks for each leaf: can two transitions of one state both be enabled; which can be taken at all."""
    solver = Solver(chart)
    overlaps: list[tuple[str, str, str, str]] = []
    unproven: list[str] = []
    alive: set[str] = set()
    for leaf in chart.leaves:
        candidates = chart.candidates(leaf)
        for first, second in itertools.combinations(candidates, 2):
            if first.source != second.source:
                continue
            try:
                example = solver.example(first.guard.tree, second.guard.tree)
            except UnprovenError as error:
                unproven.append(f"{first.id} and {second.id} in {leaf}: {error}")
                continue
            if example is not None:
                overlaps.append((leaf, first.id, second.id, example))
        for k, transition in enumerate(candidates):
            earlier = [negation(t.guard.tree) for t in candidates[:k] if t.source != transition.source]
            try:
                if solver.example(transition.guard.tree, *earlier) is not None:
                    alive.add(transition.id)
            except UnprovenError as error:
                unproven.append(f"{transition.id} in {leaf}: {error}")
                alive.add(transition.id)
    dead = tuple(t.id for t in chart.transitions if t.id not in alive)
    return GuardReport(tuple(overlaps), dead, tuple(unproven), solver.queries)
