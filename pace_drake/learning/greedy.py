"""What the network of an agent in training would decide if it were exported now."""

import numpy as np
import torch
from stable_baselines3 import PPO

from pace_drake.policies import Policy
from pace_drake.policies.learned import guarded
from pace_drake.policies.rules import joint_actions
from pace_drake.scenario import Scenario


class Scores(torch.nn.Module):
    """The deterministic part of an SB3 actor-critic policy: observation -> one score per action."""

    def __init__(self, model: PPO) -> None:
        super().__init__()
        policy = model.policy
        self.features, self.hidden, self.action = (
            policy.features_extractor,
            policy.mlp_extractor.policy_net,
            policy.action_net,
        )

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """(batch, D) -> (batch, 2)."""
        return self.action(self.hidden(self.features(observation)))


class GreedyPolicy(Policy):
    """Chooses the action with the larger score, with the rules of ``LearnedPolicy`` around it.

    Args:
        model: its network as it is at each decision.
        scenario: what the model is trained in.
    """

    def __init__(self, model: PPO, scenario: Scenario) -> None:
        self.observation = scenario.observation
        self._scores, self._joint = Scores(model), joint_actions(scenario.task)

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        with torch.no_grad():
            scores = self._scores(torch.as_tensor(observations, dtype=torch.float32)).numpy()
        return guarded(scores, observations, self._joint)
