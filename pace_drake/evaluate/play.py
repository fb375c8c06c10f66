"""Playing a policy on drawn episodes, by the compiled twin."""

from dataclasses import dataclass

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
    scenario, episodes = twin.scenario, len(parts)
    twin.start(np.arange(episodes), parts)
    decisions = np.zeros(episodes, dtype=int)
    while len(going := np.flatnonzero((twin.status == DECISION) & (decisions < scenario.max_decisions))):
        # As in the diagram: policies see single precision.
        observations = twin.observe(policy.observation, going).astype(float)
        answers = policy.decide_all(observations)
        if (answers < 0).any():
            raise RuntimeError(f"{type(policy).__name__} gave no answer to {observations[answers < 0][0]}")
        twin.step(answers, going)
        decisions[going] += 1
    return Played(
        twin.robot_idle.copy(), twin.human_idle.copy(), twin.cost, twin.time.copy(), decisions, twin.status == FINISHED
    )
