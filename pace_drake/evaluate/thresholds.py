"""The best threshold rules of a scenario, by search over the compiled twin."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import play
from pace_drake.policies import Policy
from pace_drake.policies.rules import RemainingTimeThreshold, Threshold, joint_actions
from pace_drake.task import Task

Rule = Literal["elapsed_threshold", "phase_threshold", "remaining_time_threshold"]


class _Kind(NamedTuple):
    candidates: np.ndarray
    relative: bool  # to the action's mean duration
    make: Callable[[tuple[float, ...], frozenset[int]], Policy]


_KINDS: dict[str, _Kind] = {
    "elapsed_threshold": _Kind(
        np.round(np.arange(0.02, 1.5001, 0.02), 3), True, lambda values, joint: Threshold(2, values, joint)
    ),
    "phase_threshold": _Kind(
        np.round(np.arange(0.02, 1.0001, 0.02), 3), False, lambda values, joint: Threshold(3, values, joint)
    ),
    "remaining_time_threshold": _Kind(np.round(np.arange(0.0, 40.1, 0.5), 3), False, RemainingTimeThreshold),
}
RULES: tuple[Rule, ...] = ("elapsed_threshold", "phase_threshold", "remaining_time_threshold")


@dataclass(frozen=True)
class ThresholdSearch:
    """Result of a search.

    Attributes:
        thresholds: per non-joint human action, by name; [s] or [-].
        policy: the rule with them.
        cost: [s] mean cost of the rule on the episodes it was found on.
        costs: (num candidates, L) [s] mean cost per joint action, for a look at how flat the optimum is.
    """

    thresholds: dict[str, float]
    policy: Policy
    cost: float
    costs: np.ndarray


def num_candidates(rule: Rule) -> int:
    """How many values a search tries."""
    return len(_KINDS[rule].candidates)


def search_thresholds(
    twin: AssemblyTwin,
    parts: np.ndarray,
    rule: Rule,
    progress: Callable[[int], None] = lambda _done: None,
) -> ThresholdSearch:
    """Finds the best threshold for each non-joint action, on common random numbers.

    What happens before one joint action depends on the thresholds of its own segment alone (the person's clock starts
    anew after each joint action, and the robot then decides after homing), so all segments are searched at once.
    Where a segment has several non-joint actions they share one candidate, relative to their means.

    Args:
        twin: with as many environments as episodes.
        parts: (E, N + 3) episodes of its pool.
        rule: which kind.
        progress: called with the number of candidates done.
    """
    task = twin.scenario.task
    kind = _KINDS[rule]
    joint = joint_actions(task)
    scale = _scale(task, kind.relative)
    costs = np.zeros((len(kind.candidates), task.num_joint_actions))
    for k, candidate in enumerate(kind.candidates):
        played = play(twin, parts, kind.make(tuple(candidate * scale), joint))
        costs[k] = (played.robot_idle + task.human_idle_weight * played.human_idle).mean(axis=0)
        progress(k + 1)
    best = kind.candidates[np.argmin(costs, axis=0)]
    values, segment = np.zeros(task.num_human_actions), 0
    for k, action in enumerate(task.human_actions):
        # After the last joint action, and in it, nothing is decided.
        values[k] = best[min(segment, len(best) - 1)] * scale[k]
        segment += action.joint
    values = np.round(values, 3)
    thresholds = {a.name: float(v) for a, v in zip(task.human_actions, values, strict=True) if not a.joint}
    return ThresholdSearch(thresholds, kind.make(tuple(values.tolist()), joint), float(costs.min(axis=0).sum()), costs)


def _scale(task: Task, relative: bool) -> np.ndarray:
    return np.array([action.duration.mean if relative else 1.0 for action in task.human_actions])
