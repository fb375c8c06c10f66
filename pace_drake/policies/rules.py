"""Policies without learning: the paper's baselines and thresholds."""

from dataclasses import dataclass

import numpy as np

from pace_drake.policies import Policy
from pace_drake.task import Task


def joint_actions(task: Task) -> frozenset[int]:
    """The human action indices that are joint actions. A decision in one of them means that the person waits."""
    return frozenset(task.human_index_of_joint)


def person_waits(observations: np.ndarray, joint: frozenset[int]) -> np.ndarray:
    """(n,) whether the person waits for a joint action."""
    return np.isin(observations[:, 1], list(joint))


@dataclass(frozen=True)
class ExplicitQuery(Policy):
    """Assists when asked: the person presses the button once they wait (paper, Sec. V-D)."""

    joint: frozenset[int]
    observation = "none"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        return person_waits(observations, self.joint).astype(int)


@dataclass(frozen=True)
class AlwaysAssist(Policy):
    """Assists at every decision; the robot does nearly all the waiting."""

    observation = "none"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        return np.ones(len(observations), dtype=int)


@dataclass(frozen=True)
class NeverAssist(Policy):
    """Never assists: the episode does not end by itself, so it is truncated."""

    observation = "none"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        return np.zeros(len(observations), dtype=int)


@dataclass(frozen=True)
class Threshold(Policy):
    """Assists from a threshold of elapsed time or phase on, and whenever the person waits.

    Attributes:
        element: 2 for elapsed time [s], 3 for phase.
        thresholds: (N,) per human action; inf never assists during that action.
        joint: see ``joint_actions``.
    """

    element: int
    thresholds: tuple[float, ...]
    joint: frozenset[int]

    @property
    def observation(self) -> str:  # type: ignore[override]
        """See Policy."""
        return "none" if self.element == 2 else "paper"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        return _reached(observations, observations[:, self.element], self.thresholds, self.joint)


@dataclass(frozen=True)
class RemainingTimeThreshold(Policy):
    """Assists once the action's remaining time, by its phase, is no more than a threshold.

    What remains after e seconds at phase tau, if the person goes on at the same speed, is e (1 - tau) / tau.

    Attributes:
        thresholds: (N,) [s] per human action; -inf never assists during that action.
        joint: see ``joint_actions``.
    """

    thresholds: tuple[float, ...]
    joint: frozenset[int]
    observation = "paper"

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        below = tuple(-limit for limit in self.thresholds)
        return _reached(observations, -extrapolated_time(observations), below, self.joint)


def extrapolated_time(observations: np.ndarray) -> np.ndarray:
    """(n,) [s] remaining time e (1 - tau) / tau; inf at phase 0, NaN where e or tau is."""
    elapsed, phase = observations[:, 2], observations[:, 3]
    begun = np.where(phase == 0, 1.0, phase)
    left = np.where(phase == 0, np.inf, elapsed * (1 - phase) / begun)
    return left


def _reached(
    observations: np.ndarray, values: np.ndarray, thresholds: tuple[float, ...], joint: frozenset[int]
) -> np.ndarray:
    usable = np.isfinite(observations[:, 1]) & ~np.isnan(values)
    action = np.where(usable, observations[:, 1], 1).astype(int)
    assist = (values >= np.array(thresholds)[action - 1]) | np.isin(action, list(joint))
    return np.where(usable, assist, -1).astype(int)
