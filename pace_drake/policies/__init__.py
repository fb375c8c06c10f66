"""Policies: whether to go and assist, given the observation. No Drake import."""

from typing import Protocol

import numpy as np


class Policy(Protocol):
    """A policy is a pure function of the observation (4,): robot_task, human_action, human_elapsed [s], phase."""

    def decide(self, observation: np.ndarray) -> int:
        """Returns 1 to assist, 0 to go on with the robot's own tasks, -1 if there is no answer."""


__all__ = ["Policy"]
