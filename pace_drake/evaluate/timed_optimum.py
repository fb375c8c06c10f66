"""The exact optimum without phase: what a policy can reach that knows the clock, but nothing of the hand.

Between two joint actions the problem is one of optimal stopping with little state: the last robot task i, the person's
action j, and the time e since it began. All durations are put on a grid of ``STEP`` (rounded to the nearest point, so
means stay), and the value follows by one sweep backwards in time, without iteration, as a robot task takes time:

    Q1(i, j, e) = E[(W - P)+] + lambda E[(P - W)+] + C(l + 1, i)           assist; W: time until the person is ready
    Q0(i, j, e) = E[lambda (wait within R) + V(i + 1, where R later)]      go on
    C(l, i) = E[lambda (wait within E) + V(i, where E after the start)]    E: homing after joint action l - 1

This is exact, up to the grid, where the durations of a segment's actions are independent of each other; with a pace
of people (``human.pace_correlation``) that holds if every segment has one action, as in the paper's task.
"""

from dataclasses import dataclass

import numpy as np

from pace_drake.policies import Policy
from pace_drake.policies.rules import joint_actions, person_waits
from pace_drake.scenario import Scenario
from pace_drake.task import Duration

#: [s]
STEP = 0.05
#: Durations longer than this quantile are cut off.
_TAIL = 1 - 1e-9


@dataclass(frozen=True)
class ElapsedTable(Policy):
    """Looks up robot task, human action and elapsed time; assists whenever the person waits.

    Attributes:
        assist: (M, N, n) whether to assist, at elapsed times 0, step, ...; the last stands for all later ones.
        step: [s].
        joint: see ``rules.joint_actions``.
    """

    assist: np.ndarray
    step: float
    joint: frozenset[int]
    observation = "none"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        usable = np.isfinite(observations[:, :3]).all(axis=1)
        seen = np.where(usable[:, np.newaxis], observations[:, :3], 1.0)
        at = np.clip(np.round(seen[:, 2] / self.step), 0, self.assist.shape[2] - 1).astype(int)
        answers = self.assist[seen[:, 0].astype(int) - 1, seen[:, 1].astype(int) - 1, at]
        return np.where(usable, answers | person_waits(seen, self.joint), -1).astype(int)


@dataclass(frozen=True)
class TimedOptimum:
    """The best policy without phase, and its expected cost [s]."""

    policy: ElapsedTable
    cost: float


def timed_optimum(scenario: Scenario, step: float = STEP) -> TimedOptimum:
    """Solves the scenario's task for a policy that sees robot task, human action and elapsed time.

    Args:
        scenario: gives the task, and whether the first decision is at the start.
        step: [s] of the grid.
    """
    task = scenario.task
    weight, num_tasks = task.human_idle_weight, task.num_robot_tasks
    human = [on_grid(action.duration, step) for action in task.human_actions]
    robot = [on_grid(one.duration, step) for one in task.robot_tasks]
    size = max(len(p) for p in human)
    assist = np.ones((num_tasks, task.num_human_actions, size), dtype=bool)
    ahead = np.zeros(num_tasks)  # C(l + 1, i)
    for joint in reversed(range(task.num_joint_actions)):
        last = task.human_index_of_joint[joint] - 1  # of the joint action, from 0
        first = task.human_index_of_joint[joint - 1] if joint else 0
        preparation = on_grid(task.assistances[joint].preparation, step)
        before = None if joint == 0 else on_grid(task.assistances[joint - 1].homing, step)
        horizon = max(len(p) for p in (*robot, *([] if before is None else [before])))
        # Waiting, the robot comes at once: value, and what n more steps of waiting until a decision cost.
        waiting = weight * step * (preparation @ np.arange(len(preparation))) + ahead
        later = weight * step * np.arange(horizon)[np.newaxis] + waiting[:, np.newaxis]  # (M, n)
        # Cost of assisting when the person is ready in k steps.
        to_wait = assistance_cost(preparation, sum(len(human[k]) for k in range(first, last)) + 1, weight, step)
        for k in reversed(range(first, last)):
            value, chosen = _solve(human[k], robot, later, to_wait, ahead)
            assist[:, k, : chosen.shape[1]] = chosen
            later = _from_start(human[k], later, value, horizon)
            to_wait = np.array([human[k] @ to_wait[n : n + len(human[k])] for n in range(len(to_wait) - len(human[k]))])
        ahead = later[:, 0] if before is None else later[:, : len(before)] @ before
    # Where it does not decide at the start, robot task 1 comes first.
    cost = ahead[num_tasks - 1] if scenario.decide_at_start else later[0, : len(robot[0])] @ robot[0]
    return TimedOptimum(ElapsedTable(assist, step, joint_actions(task)), float(cost))


def on_grid(duration: Duration, step: float) -> np.ndarray:
    """Probabilities of 0, 1, ... steps, each duration rounded to the nearest."""
    num = int(np.ceil(float(duration.quantile(_TAIL)) / step)) + 2
    edges = (np.arange(num + 1) - 0.5) * step
    p = np.diff(duration.cdf(edges))
    return p / p.sum()


def assistance_cost(preparation: np.ndarray, size: int, weight: float, step: float) -> np.ndarray:
    """(size,) expected cost [s] of assisting when the person is ready in 0, 1, ... steps."""
    ready, prepared = np.arange(size)[:, np.newaxis], np.arange(len(preparation))
    cost = np.where(ready > prepared, ready - prepared, weight * (prepared - ready))
    return step * (cost @ preparation)


def _solve(
    human: np.ndarray, robot: list[np.ndarray], later: np.ndarray, to_wait: np.ndarray, ahead: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Value (M, n) and best decision (M, n) at elapsed 0, 1, ... steps of one action.

    Args:
        human: (n,) of the action's duration.
        robot: of each robot task.
        later: (M, horizon) value at the action's end, by how many steps later the next decision is.
        to_wait: expected cost of assisting, by how many steps from now this action ends.
        ahead: (M,) value after the assistance.
    """
    size, num_tasks = len(human), len(robot)
    survival = 1.0 - np.cumsum(human)  # T > e
    survival[survival < 1e-12] = 0.0
    # Assisting: the action ends in k >= 1 steps.
    padded = np.concatenate([human, np.zeros(len(to_wait))])
    now = np.array([padded[e + 1 : e + len(to_wait)] @ to_wait[1:] for e in range(size)])
    # Going on: the action ends m steps from now, within the task, and the next decision is the rest of it later.
    following = [(i + 1) % num_tasks for i in range(num_tasks)]
    ends = []
    for i in range(num_tasks):
        r = robot[following[i]]
        after = np.array([r[m:] @ later[following[i], : len(r) - m] for m in range(len(r))])
        padded = np.concatenate([human, np.zeros(len(r))])
        ends.append(np.array([padded[e + 1 : e + len(r)] @ after[1:] for e in range(size)]))
    longest = max(len(r) for r in robot)
    value = np.zeros((num_tasks, size + longest))  # times survival
    chosen = np.ones((num_tasks, size), dtype=bool)
    for e in reversed(range(size)):
        if survival[e] == 0.0:
            continue
        for i in range(num_tasks):
            r = robot[following[i]]
            stop = now[e] + ahead[i] * survival[e]
            # A task of no step at all would ask again at once; none is that short on the grid.
            go_on = ends[i][e] + r[1:] @ value[following[i], e + 1 : e + len(r)]
            chosen[i, e] = stop <= go_on
            value[i, e] = min(stop, go_on)
    return value[:, :size], chosen


def _from_start(human: np.ndarray, later: np.ndarray, value: np.ndarray, horizon: int) -> np.ndarray:
    """(M, horizon) value at the action's start, by how many steps after it the next decision is.

    ``value`` is that at each elapsed time, times the probability that the action still goes on.
    """
    num_tasks = len(later)
    found = np.zeros((num_tasks, horizon))
    for n in range(horizon):
        most = min(n, len(human) - 1)
        found[:, n] = later[:, n - most : n + 1][:, ::-1] @ human[: most + 1]
        if n < value.shape[1]:
            found[:, n] += value[:, n]
    return found
