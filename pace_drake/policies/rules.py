"""Policies without learning: the paper's baselines and thresholds."""

from dataclasses import dataclass

import numpy as np

from pace_drake.task import Task


def joint_actions(task: Task) -> frozenset[int]:
    """The human action indices that are joint actions. A decision in one of them means that the person waits."""
    return frozenset(task.human_index_of_joint)


@dataclass(frozen=True)
class ExplicitQuery:
    """Assists when asked: the person presses the button once they wait (paper, Sec. V-D)."""

    joint: frozenset[int]

    def decide(self, observation: np.ndarray) -> int:
        """See Policy."""
        return int(int(observation[1]) in self.joint)


@dataclass(frozen=True)
class AlwaysAssist:
    """Assists at every decision; the robot does nearly all the waiting."""

    def decide(self, observation: np.ndarray) -> int:
        """See Policy."""
        return 1


@dataclass(frozen=True)
class NeverAssist:
    """Never assists: the episode does not end by itself, so it is truncated."""

    def decide(self, observation: np.ndarray) -> int:
        """See Policy."""
        return 0


@dataclass(frozen=True)
class Threshold:
    """Assists from a threshold of one element of the observation on, and whenever the person waits.

    Attributes:
        element: index into the observation: 2 for elapsed time [s], 3 for phase.
        thresholds: (N,) per human action; inf never assists during that action.
        joint: see ``joint_actions``.
    """

    element: int
    thresholds: tuple[float, ...]
    joint: frozenset[int]

    def decide(self, observation: np.ndarray) -> int:
        """See Policy."""
        value = observation[self.element]
        if np.isnan(value):
            return -1
        action = int(observation[1])
        return int(action in self.joint or value >= self.thresholds[action - 1])
