"""What must happen at last, under fairness: a search for a lasso, a way round for ever, on which it never happens.

A fair lasso avoids the goal, and for each assumption "if ``when`` again and again, then ``then`` again and again" it
has a step of ``then``, or none of ``when``. Such lassos live in strongly connected components; steps of a ``when`` that
cannot be answered there are taken out, and what is left is searched again (Streett emptiness, Emerson and Lei 1987).
"""

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True)
class Lasso:
    """States of a way that comes from the start and goes round for ever.

    Attributes:
        stem: from the first state to where the loop begins.
        loop: from there, round, to the same state.
    """

    stem: list[int]
    loop: list[int]


def fair_components(
    num_states: int, sources: np.ndarray, targets: np.ndarray, pairs: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Finds the steps that lie on fair loops.

    Args:
        num_states: number of states.
        sources, targets: (steps,) of every step.
        pairs: for each assumption, (steps,) whether ``when`` and whether ``then`` holds.

    Returns:
        (steps,) the number of the fair component to which the step belongs; -1 for none.
    """
    alive = np.ones(len(sources), dtype=bool)
    while True:
        kept = np.flatnonzero(alive)
        graph = coo_array((np.ones(len(kept), dtype=bool), (sources[kept], targets[kept])), (num_states, num_states))
        _, label = connected_components(graph, connection="strong")
        inside = kept[label[sources[kept]] == label[targets[kept]]]
        component = label[sources[inside]]
        out = np.zeros(len(inside), dtype=bool)
        for when, then in pairs:
            answered = np.zeros(num_states, dtype=bool)
            answered[component[then[inside]]] = True
            out |= when[inside] & ~answered[component]
        if not out.any():
            result = np.full(len(sources), -1)
            result[inside] = component
            return result
        alive[:] = False
        alive[inside[~out]] = True


def find_lasso(
    num_states: int,
    before: tuple[np.ndarray, np.ndarray],
    starts: np.ndarray,
    round_: tuple[np.ndarray, np.ndarray],
    pairs: list[tuple[np.ndarray, np.ndarray]],
) -> Lasso | None:
    """The lasso whose loop is reached soonest, or None if there is none.

    Args:
        num_states: number of states.
        before: sources and targets of the steps of the stem.
        starts: states in which the stem may begin.
        round_: sources and targets of the steps of the loop.
        pairs: of the steps of the loop, see ``fair_components``.
    """
    sources, targets = round_
    component = fair_components(num_states, sources, targets, pairs)
    entry: dict[int, int] = {}
    for state, number in zip(sources[component >= 0].tolist(), component[component >= 0].tolist(), strict=True):
        entry[state] = number
    stem = _shortest(_neighbours(*before), starts.tolist(), entry)
    if stem is None:
        return None
    own = component == entry[stem[-1]]
    near = _neighbours(sources[own], targets[own])
    loop = [stem[-1]]
    for when, then in pairs:
        wanted = own & then
        if not (own & when).any() or any(
            (sources[wanted] == a).any() and (targets[wanted][sources[wanted] == a] == b).any()
            for a, b in itertools.pairwise(loop)
        ):
            continue
        goals = dict.fromkeys(sources[wanted].tolist(), 0)
        way = _shortest(near, [loop[-1]], goals)
        assert way is not None, "a strongly connected component is connected"
        loop += [*way[1:], int(targets[wanted][sources[wanted] == way[-1]][0])]
    if len(loop) == 1:
        loop.append(near[loop[0]][0])
    back = _shortest(near, [loop[-1]], {loop[0]: 0})
    assert back is not None, "a strongly connected component is connected"
    return Lasso(stem, [*loop, *back[1:]])


def _neighbours(sources: np.ndarray, targets: np.ndarray) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for source, target in zip(sources.tolist(), targets.tolist(), strict=True):
        found.setdefault(source, []).append(target)
    return found


def _shortest(near: dict[int, list[int]], starts: list[int], goals: dict[int, int]) -> list[int] | None:
    """The states of a shortest way from one of the starts to one of the goals."""
    came: dict[int, int] = dict.fromkeys(starts, -1)
    queue = deque(starts)
    while queue:
        state = queue.popleft()
        if state in goals:
            way = [state]
            while came[way[-1]] >= 0:
                way.append(came[way[-1]])
            return way[::-1]
        for following in near.get(state, ()):
            if following not in came:
                came[following] = state
                queue.append(following)
    return None
