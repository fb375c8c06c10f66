"""From the observation to what the network sees; part of the exported policy, so that normalisation travels with it."""

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from pace_drake.task import Task


class AssemblyFeatures(BaseFeaturesExtractor):
    """One-hot indices, elapsed time relative to the action's mean duration, and phase.

    Args:
        observation_space: of ``PaceAssemblyEnv``: robot_task, human_action, human_elapsed [s], phase.
        task: gives the number of actions and their mean durations.
    """

    def __init__(self, observation_space: gym.Space, task: Task) -> None:
        self.num_robot_tasks, self.num_human_actions = task.num_robot_tasks, task.num_human_actions
        super().__init__(observation_space, self.num_robot_tasks + self.num_human_actions + 2)
        self.mean_duration: torch.Tensor
        self.register_buffer("mean_duration", torch.tensor([action.duration.mean for action in task.human_actions]))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """(batch, 4) -> (batch, M + N + 2)."""
        # Comparison instead of one_hot: it exports to ONNX without index types.
        robot = torch.round(observation[:, 0:1]) == torch.arange(1, self.num_robot_tasks + 1)
        action = torch.round(observation[:, 1:2]) == torch.arange(1, self.num_human_actions + 1)
        mean = (action.float() * self.mean_duration).sum(dim=1, keepdim=True)
        # Clamped: an action that takes three times its mean tells no more than that.
        elapsed = torch.clamp(observation[:, 2:3] / mean, 0.0, 3.0)
        return torch.cat([robot.float(), action.float(), elapsed, observation[:, 3:4]], dim=1)
