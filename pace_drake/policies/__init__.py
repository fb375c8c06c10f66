"""Policies: whether to go and assist, given the observation. No Drake import."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pace_drake.errors import require
from pace_drake.observation import check_observation

if TYPE_CHECKING:
    from pace_drake.dtw.estimator import Estimator
    from pace_drake.people import People
    from pace_drake.scenario import Scenario


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

    def check_estimates(self, scenario: "Scenario", people: "People", estimators: "Sequence[Estimator | None]") -> None:
        """Refuses estimators by which the policy must not decide; one that remembers none takes any.

        Args:
            scenario, people: that it is used in.
            estimators: those that ``people.estimators`` returned for them.

        Raises:
            InputError: it was made with estimators that say something else.
        """
        return


def check_policy(policy: object) -> None:
    """Raises InputError that says how to make one, unless it is a policy with an observation set."""
    how = "subclass pace_drake.policies.Policy, with observation and decide_all (docs/learning.md)"
    require(isinstance(policy, Policy), "policy", f"{how}; {policy!r} is none")
    check_observation(getattr(policy, "observation", ""), f"{type(policy).__name__}.observation")


__all__ = ["Policy", "check_policy"]
