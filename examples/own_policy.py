"""A policy of your own: a function of the observation, compared with one of the package's on the same episodes.

python examples/own_policy.py [episodes]
"""

import sys

import numpy as np

from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.policies import play_policies
from pace_drake.people import load_people
from pace_drake.policies import Policy
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario


class HalfPhase(Policy):
    """Assists once the person's action is half done, and whenever they wait."""

    observation = "paper"  # robot task, human action, elapsed time [s], phase

    def __init__(self, joint_actions: list[int]) -> None:
        self.joint_actions = joint_actions

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        action, phase = observations[:, 1], observations[:, 3]
        return (np.isin(action, self.joint_actions) | (phase > 0.5)).astype(int)


def run(episodes: int) -> dict[str, float]:
    scenario, rng = load_scenario("ikea_chair"), np.random.default_rng(0)
    policies = {
        "own": HalfPhase(scenario.task.human_index_of_joint),
        "explicit query": make_policy("explicit_query", scenario),
    }
    pool = make_pool(scenario, load_people(scenario), 64, rng)
    results = play_policies(AssemblyTwin(scenario, pool, episodes), pool.sample(episodes, rng), policies)
    for result in results:
        print(f"{result.policy}: mean cost of {episodes} episodes {result.cost:.1f} s")
    return {result.policy: result.cost for result in results}


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
