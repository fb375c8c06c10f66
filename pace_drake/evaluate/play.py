"""Playing a policy on drawn episodes, by the compiled twin."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np

from pace_drake.envs.kernel import DECISION, FINISHED
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.policies import Policy


@dataclass(frozen=True)
class Played:
    """What came of E episodes.

    Attributes:
        robot_idle, human_idle: (E, L) [s] per joint action.
        cost: (E,) [s].
        time: (E,) [s] until the robot was home.
        decisions, finished: (E,) how many, and whether it came to its end; else it was truncated.
    """

    robot_idle: np.ndarray
    human_idle: np.ndarray
    cost: np.ndarray
    time: np.ndarray
    decisions: np.ndarray
    finished: np.ndarray


def play(twin: AssemblyTwin, parts: np.ndarray, policy: Policy) -> Played:
    """Plays a policy on episodes.

    Args:
        twin: with as many environments as episodes; what they did before is over.
        parts: (E, N + 3) rows of its pool's ``sample``.
        policy: which.

    Raises:
        RuntimeError: the policy gives no answer where the twin needs one.
    """

    def decide(envs: np.ndarray) -> np.ndarray:
        # As in the diagram: policies see single precision.
        observations = twin.observe(policy.observation, envs).astype(float)
        answers = policy.decide_all(observations)
        if (answers < 0).any():
            raise RuntimeError(f"{type(policy).__name__} gave no answer to {observations[answers < 0][0]}")
        return answers

    return play_by(twin, parts, decide, twin.scenario.max_decisions)


def play_by(
    twin: AssemblyTwin, parts: np.ndarray, decide: Callable[[np.ndarray], np.ndarray], max_decisions: float = inf
) -> Played:
    """Plays episodes by answers that may come from anything the twin knows.

    Args:
        twin, parts: as ``play``.
        decide: gives the answers (n,) of the environments (n,) that are at a decision.
        max_decisions: truncates.
    """
    twin.start(np.arange(len(parts)), parts)
    decisions = np.zeros(len(parts), dtype=int)
    while len(going := np.flatnonzero((twin.status == DECISION) & (decisions < max_decisions))):
        twin.step(decide(going), going)
        decisions[going] += 1
    return Played(
        twin.robot_idle.copy(), twin.human_idle.copy(), twin.cost, twin.time.copy(), decisions, twin.status == FINISHED
    )
