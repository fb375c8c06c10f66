"""A fitted optimum: about the best that a policy can do with an observation, for the learned ones to be held against.

Between two joint actions the problem is one of optimal stopping, and it is solved by regression over simulated paths
(Longstaff and Schwartz 2001). The robot goes on with its own tasks until the person waits. At every decision on the
way the cost of assisting there is known in hindsight, and that of going on by what the policy so far would do later;
both are fitted as smooth surfaces over elements of the observation, for every human action, and the smaller one says
what to do. A few rounds settle it.

The surfaces are multilinear between nodes, with a penalty on second differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import sparse
from scipy.sparse.linalg import splu

from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import play_by
from pace_drake.observation import OBSERVATION
from pace_drake.policies import Policy
from pace_drake.policies.rules import joint_actions, person_waits

_ROUNDS = 8
#: How much a second difference of a surface costs, relative to one sample at each node.
_SMOOTHNESS = 3.0
#: Nodes along each axis, by how many axes there are.
_NODES = {1: (60,), 2: (24, 24), 3: (14, 14, 9)}


@dataclass(frozen=True)
class _Grid:
    """Nodes along each axis, for multilinear interpolation."""

    nodes: tuple[np.ndarray, ...]

    def basis(self, points: np.ndarray) -> sparse.csr_matrix:
        """(n, number of nodes) weights of the nodes at points (n, axes)."""
        lows, fractions = [], []
        for axis, nodes in enumerate(self.nodes):
            x = np.clip(points[:, axis], nodes[0], nodes[-1])
            low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
            lows.append(low)
            fractions.append((x - nodes[low]) / (nodes[low + 1] - nodes[low]))
        shape = tuple(len(nodes) for nodes in self.nodes)
        rows, columns, weights = [], [], []
        for corner in product((0, 1), repeat=len(shape)):
            index = np.ravel_multi_index(tuple(low + c for low, c in zip(lows, corner, strict=True)), shape)
            weight = reduce(np.multiply, [f if c else 1 - f for f, c in zip(fractions, corner, strict=True)])
            rows.append(np.arange(len(points)))
            columns.append(index)
            weights.append(weight)
        content = np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))
        return sparse.csr_matrix(content, shape=(len(points), int(np.prod(shape))))

    def roughness(self) -> sparse.csr_matrix:
        """Sum over all axes of the squared second differences of the values at the nodes, as a matrix."""
        shape = [len(nodes) for nodes in self.nodes]
        total = sparse.csr_matrix((int(np.prod(shape)),) * 2)
        for axis, n in enumerate(shape):
            second = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n))
            parts = [second if k == axis else sparse.eye_array(m) for k, m in enumerate(shape)]
            d = reduce(sparse.kron, parts)
            total = total + d.T @ d
        return sparse.csr_matrix(total)


class _Surface:
    """A penalised regression on one set of points; fitted again and again to other values."""

    def __init__(self, grid: _Grid, points: np.ndarray) -> None:
        self.basis = grid.basis(points)
        per_node = len(points) / self.basis.shape[1]
        matrix = self.basis.T @ self.basis + _SMOOTHNESS * per_node * grid.roughness()
        # Where no sample ever came, the surface goes on straight; a trace of a ridge makes that unique.
        self._solver = splu(sparse.csc_matrix(matrix + 1e-6 * per_node * sparse.eye_array(matrix.shape[0])))

    def fit(self, values: np.ndarray) -> np.ndarray:
        """Values at the nodes."""
        return self._solver.solve(self.basis.T @ values)


@dataclass(frozen=True)
class FittedTable(Policy):
    """Assists where that is expected to cost no more than going on, and whenever the person waits.

    Attributes:
        observation: what it sees.
        axes: which elements of it.
        grids, stop, go_on: by human action, the two fitted costs [s].
        joint: see ``rules.joint_actions``.
    """

    observation: str
    axes: tuple[int, ...]
    grids: dict[int, _Grid]
    stop: dict[int, np.ndarray]
    go_on: dict[int, np.ndarray]
    joint: frozenset[int]

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        usable = np.isfinite(observations[:, [1, *self.axes]]).all(axis=1)
        action = np.where(usable, observations[:, 1], 0).astype(int)
        answers = np.where(usable, person_waits(observations, self.joint), -1).astype(int)
        for j, grid in self.grids.items():
            rows = np.flatnonzero(action == j)
            if len(rows):
                basis = grid.basis(observations[rows][:, self.axes])
                answers[rows] = basis @ self.stop[j] <= basis @ self.go_on[j]
        return answers


def fitted_optimum(
    twin: AssemblyTwin, parts: np.ndarray, observation: str = "paper", elements: Sequence[str] = ()
) -> FittedTable:
    """Fits the policy.

    Args:
        twin: with as many environments as paths.
        parts: (E, N + 3) episodes of its pool, tens of thousands; in each, every segment gives one path.
        observation: the set that the policy sees.
        elements: the elements of it that it goes by; by default human_elapsed and phase.
    """
    task = twin.scenario.task
    axes = tuple(OBSERVATION.index(name) for name in (elements or ("human_elapsed", "phase")))
    joint, weight = joint_actions(task), task.human_idle_weight
    paths = _paths(twin, parts, observation)
    # Assisting at each of these decisions would have cost, in hindsight:
    early = paths.ready - paths.preparation
    now = np.maximum(early, 0.0) + weight * np.maximum(-early, 0.0)
    grids: dict[int, _Grid] = {}
    stop: dict[int, np.ndarray] = {}
    go_on: dict[int, np.ndarray] = {}
    surfaces: dict[int, tuple[np.ndarray, _Surface]] = {}
    action = paths.seen[:, 1].astype(int)
    for j in sorted(set(range(1, task.num_human_actions + 1)) - joint):
        rows = np.flatnonzero(action == j)
        if len(rows):
            points = paths.seen[rows][:, axes]
            grids[j] = _grid(points, _NODES[len(axes)])
            surfaces[j] = rows, _Surface(grids[j], points)
            stop[j] = surfaces[j][1].fit(now[rows])
    chosen = np.ones(len(now), dtype=bool)  # at first: assist at the next decision
    for _ in range(_ROUNDS):
        later = _cost_of_going_on(now, chosen, paths.following, weight * paths.waited)
        for j, (rows, surface) in surfaces.items():
            go_on[j] = surface.fit(later[rows])
            chosen[rows] = surface.basis @ stop[j] <= surface.basis @ go_on[j]
    return FittedTable(observation, axes, grids, stop, go_on, joint)


class _Paths(NamedTuple):
    """All decisions of many paths, in order of time.

    Attributes:
        seen: (n, D) observations.
        ready: (n,) [s] until the person is ready; 0 when they wait.
        preparation: (n,) [s] that the robot would need.
        following: (n,) the next decision of the path; -1 if the person waits here.
        waited: (n,) [s] that the person waits until that next decision.
    """

    seen: np.ndarray
    ready: np.ndarray
    preparation: np.ndarray
    following: np.ndarray
    waited: np.ndarray


def _paths(twin: AssemblyTwin, parts: np.ndarray, observation: str) -> _Paths:
    """Assists only when the person waits; every segment of an episode is one path."""
    task, pool = twin.scenario.task, twin.pool
    joint = joint_actions(task)
    columns: list[tuple[np.ndarray, ...]] = []
    following = np.empty(0, dtype=int)
    last = np.full(len(parts), -1)  # the decision before, in the same segment

    def decide(envs: np.ndarray) -> np.ndarray:
        nonlocal following
        seen = twin.observe(observation, envs).astype(float)
        waits, ready = person_waits(seen, joint), twin.time_until_ready(envs)
        preparation = pool.preparation[parts[envs, task.num_human_actions + 1], twin.segment(envs)]
        index = len(following) + np.arange(len(envs))
        following = np.concatenate([following, np.full(len(envs), -1)])
        before = last[envs]
        following[before[before >= 0]] = index[before >= 0]
        last[envs] = np.where(waits, -1, index)
        columns.append((seen, ready, preparation, np.where(waits, seen[:, 2], 0.0)))
        return waits

    play_by(twin, parts, decide)
    seen, ready, preparation, elapsed = (np.concatenate(column) for column in zip(*columns, strict=True))
    return _Paths(seen, ready, preparation, following, np.where(following >= 0, elapsed[following], 0.0))


@njit(cache=True)
def _cost_of_going_on(now: np.ndarray, chosen: np.ndarray, following: np.ndarray, idle: np.ndarray) -> np.ndarray:
    """(n,) cost of going on at each decision and then doing what is chosen.

    Args:
        now: (n,) cost of assisting.
        chosen: (n,) whether to assist.
        following: (n,) see ``_Paths``.
        idle: (n,) cost of the person's waiting until the next decision.
    """
    cost = np.zeros(len(now))
    for k in range(len(now) - 1, -1, -1):
        after = following[k]
        if after >= 0:
            assists = chosen[after] or following[after] < 0
            cost[k] = idle[k] + (now[after] if assists else cost[after])
    return cost


def _grid(points: np.ndarray, num: tuple[int, ...]) -> _Grid:
    nodes = []
    for axis, n in enumerate(num):
        low, high = np.quantile(points[:, axis], [0.001, 0.999])
        nodes.append(np.linspace(low, max(high, low + 1e-3), n))
    return _Grid(tuple(nodes))
