"""What policies cost on the same episodes, by the compiled twin."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import stdtrit

from pace_drake.envs.pool import POOL_SIZE, make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.clairvoyant import clairvoyant_cost
from pace_drake.evaluate.play import Played, play
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.scenario import Scenario

#: Plays episodes ``parts`` on a twin with as many environments.
Player = Callable[[AssemblyTwin, np.ndarray], Played]


@dataclass(frozen=True)
class PolicyResult:
    """Means over episodes.

    Attributes:
        policy: its name.
        episodes: how many.
        robot_idle, human_idle: (L,) [s] per joint action.
        cost: [s]; cost_interval: 95 % confidence interval of its mean.
        saving: [s] mean cost of the first policy minus that of this one, on the same episodes; with its interval.
        decisions: per episode.
        truncated: share of episodes that were cut off after the scenario's ``max_decisions``.
        time: [s] until the robot is home after the last joint action.
        robot_task_rate: [1/min] of the robot's own tasks, such as cubes sorted.
        robot_idle_share, human_idle_share: R-IDLE, H-IDLE [%] of the time, on average (Hoffman 2019).
        concurrent_share: C-ACT [%], both are active.
        delay_share: F-DEL [%], one waits for the other; here R-IDLE + H-IDLE, as there is no other waiting.
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
    time: float
    robot_task_rate: float
    robot_idle_share: float
    human_idle_share: float
    concurrent_share: float
    delay_share: float

    def to_json(self) -> dict[str, Any]:
        """Plain data, with the totals of the idle times."""
        return {
            **asdict(self),
            "robot_idle_total": sum(self.robot_idle),
            "human_idle_total": sum(self.human_idle),
        }


def summarize(policy: str, played: Played, first: Played) -> PolicyResult:
    """Means of what one policy did.

    Args:
        policy: its name.
        played: what it did.
        first: what the first policy did in the same episodes.
    """
    joints = played.robot_idle.shape[1]
    robot, human = (100 * (idle.sum(axis=1) / played.time).mean() for idle in (played.robot_idle, played.human_idle))
    tasks = np.maximum(played.decisions - joints, 0)  # every other decision is an assistance
    saving = first.cost - played.cost
    return PolicyResult(
        policy=policy,
        episodes=len(played.cost),
        robot_idle=tuple(played.robot_idle.mean(axis=0).tolist()),
        human_idle=tuple(played.human_idle.mean(axis=0).tolist()),
        cost=float(played.cost.mean()),
        cost_interval=interval(played.cost),
        saving=float(saving.mean()),
        saving_interval=interval(saving),
        decisions=float(played.decisions.mean()),
        truncated=float(1 - played.finished.mean()),
        time=float(played.time.mean()),
        robot_task_rate=float(60 * (tasks / played.time).mean()),
        robot_idle_share=float(robot),
        human_idle_share=float(human),
        concurrent_share=float(100 - robot - human),
        delay_share=float(robot + human),
    )


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
    twin = AssemblyTwin(scenario, pool, episodes)
    return play_policies(twin, parts, policies), float(clairvoyant_costs(twin, parts).mean())


def play_policies(twin: AssemblyTwin, parts: np.ndarray, policies: Mapping[str, Policy]) -> list[PolicyResult]:
    """Plays every policy on the same episodes.

    Args:
        twin: with as many environments as episodes.
        parts: (E, N + 3) rows of its pool's ``sample``, at least 2.
        policies: by name; the first is what savings are counted from.

    Raises:
        RuntimeError: a policy gives no answer where the twin needs one.
    """
    played = play_all(twin, parts, {name: partial(play, policy=policy) for name, policy in policies.items()})
    first = next(iter(played.values()))
    return [summarize(name, one, first) for name, one in played.items()]


def play_all(twin: AssemblyTwin, parts: np.ndarray, players: Mapping[str, Player]) -> dict[str, Played]:
    """What each does in the same episodes."""
    return {name: player(twin, parts) for name, player in players.items()}


def clairvoyant_costs(twin: AssemblyTwin, parts: np.ndarray) -> np.ndarray:
    """(E,) [s] least possible costs."""
    return np.array([clairvoyant_cost(twin.scenario, twin.pool.episode(row)) for row in parts])


def interval(values: np.ndarray) -> tuple[float, float]:
    """95 % confidence interval of the mean (Student's t); of a single value it is that value."""
    mean = float(values.mean())
    if len(values) < 2:
        return mean, mean
    half = float(stdtrit(len(values) - 1, 0.975) * values.std(ddof=1) / np.sqrt(len(values)))
    return mean - half, mean + half
