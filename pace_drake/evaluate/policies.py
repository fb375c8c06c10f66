"""What policies cost on the same episodes, by the compiled twin."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.clairvoyant import clairvoyant_cost
from pace_drake.evaluate.play import Played, play
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.scenario import Scenario

#: (demonstration, duration) pairs of each human action, of which episodes are put together.
POOL_SIZE = 512


@dataclass(frozen=True)
class PolicyResult:
    """Means over episodes.

    Attributes:
        robot_idle, human_idle: (L,) [s] per joint action.
        cost: [s]; cost_interval: 95 % confidence interval of its mean.
        saving: [s] mean cost of the first policy minus that of this one, on the same episodes; with its interval.
        decisions: per episode.
        truncated: share of episodes that were cut off after the scenario's ``max_decisions``.
    """

    policy: str
    episodes: int
    robot_idle: tuple[float, ...]
    human_idle: tuple[float, ...]
    cost: float
    cost_interval: tuple[float, float]
    saving: float
    saving_interval: tuple[float, float]
    decisions: float
    truncated: float

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def evaluate_policies(
    scenario: Scenario, people: People, policies: Mapping[str, Policy], episodes: int, seed: int
) -> tuple[list[PolicyResult], float]:
    """Plays every policy on the same drawn episodes.

    Args:
        scenario: its own split of people is used.
        people: of the scenario.
        policies: by name; the first is what savings are counted from.
        episodes: how many, at least 2.
        seed: of all draws.

    Returns:
        (a result for each policy, mean of the least possible costs of these episodes [s]).

    Raises:
        InputError: the scenario cannot be run by the twin.
        RuntimeError: a policy gives no answer where the twin needs one.
    """
    rng = np.random.default_rng(seed)
    pool = make_pool(scenario, people, POOL_SIZE, rng)
    parts = pool.sample(episodes, rng)
    results = play_policies(AssemblyTwin(scenario, pool, episodes), parts, policies)
    return results, float(np.mean([clairvoyant_cost(scenario, pool.episode(row)) for row in parts]))


def play_policies(twin: AssemblyTwin, parts: np.ndarray, policies: Mapping[str, Policy]) -> list[PolicyResult]:
    """Plays every policy on the same episodes.

    Args:
        twin: with as many environments as episodes.
        parts: (E, N + 3) rows of its pool's ``sample``, at least 2.
        policies: by name; the first is what savings are counted from.

    Raises:
        RuntimeError: a policy gives no answer where the twin needs one.
    """
    results: list[PolicyResult] = []
    first: np.ndarray | None = None
    for name, policy in policies.items():
        played = play(twin, parts, policy)
        first = played.cost if first is None else first
        results.append(summarize(name, played, first))
    return results


def summarize(name: str, played: Played, first: np.ndarray) -> PolicyResult:
    """Means over at least 2 episodes; ``first``: (E,) [s] costs of the policy that savings are counted from."""
    cost = played.cost
    return PolicyResult(
        name,
        len(cost),
        tuple(played.robot_idle.mean(axis=0).tolist()),
        tuple(played.human_idle.mean(axis=0).tolist()),
        float(cost.mean()),
        _interval(cost),
        float((first - cost).mean()),
        _interval(first - cost),
        float(played.decisions.mean()),
        float(1 - played.finished.mean()),
    )


def _interval(values: np.ndarray) -> tuple[float, float]:
    """95 % confidence interval of the mean (Student's t)."""
    half = float(stdtrit(len(values) - 1, 0.975) * values.std(ddof=1) / np.sqrt(len(values)))
    mean = float(values.mean())
    return mean - half, mean + half
