"""Policies: whether to go and assist, given the observation. No Drake import."""

from abc import ABC, abstractmethod

import numpy as np

from pace_drake.errors import require
from pace_drake.observation import check_observation


class Policy(ABC):
    """A pure function of the observation.

    Attributes:
        observation: the name of the set that it sees (``pace_drake.observation.OBSERVATION_SETS``).
    """

    observation: str

    @abstractmethod
    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """Decides for many observations (n, D): (n,) 1 to assist, 0 to go on, -1 if there is no answer."""

    def decide(self, observation: np.ndarray) -> int:
        """Decides for one observation (D,)."""
        return int(self.decide_all(np.asarray(observation)[np.newaxis])[0])


def check_policy(policy: object) -> None:
    """Raises InputError that says how to make one, unless it is a policy with an observation set."""
    how = "subclass pace_drake.policies.Policy, with observation and decide_all (docs/learning.md)"
    require(isinstance(policy, Policy), "policy", f"{how}; {policy!r} is none")
    check_observation(getattr(policy, "observation", ""), f"{type(policy).__name__}.observation")


__all__ = ["Policy", "check_policy"]
