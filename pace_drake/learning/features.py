"""From the observation to what the network sees; part of the exported policy, so that normalisation travels with it."""

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from pace_drake.task import Task

#: [s] remaining times are taken relative to the next preparation, and in units of this; what is far off is cut.
_TIME_SCALE = 10.0


class AssemblyFeatures(BaseFeaturesExtractor):
    """One-hot indices, elapsed time relative to the action's mean duration, and what else the observation set has.

    Times that remain are given as what is left of them after the next preparation: about 0 is when to assist. With the
    phase they are extrapolated (elapsed (1 - phase) / phase), with the filter its own mean comes beside.

    Args:
        observation_space: of an observation set (``pace_drake.observation``).
        task: gives the number of actions, their mean durations and those of the preparations.
    """

    def __init__(self, observation_space: gym.Space, task: Task) -> None:
        self.num_robot_tasks, self.num_human_actions = task.num_robot_tasks, task.num_human_actions
        assert observation_space.shape is not None
        self.size = observation_space.shape[0]
        # elapsed; phase and extrapolated time; deviation and remaining time; pace.
        more = 1 + 2 * (self.size > 3) + 2 * (self.size > 4) + (self.size > 6)
        super().__init__(observation_space, self.num_robot_tasks + self.num_human_actions + more)
        self.mean_duration: torch.Tensor
        self.preparation: torch.Tensor
        self.register_buffer("mean_duration", torch.tensor([action.duration.mean for action in task.human_actions]))
        following = np.searchsorted(task.human_index_of_joint, np.arange(1, task.num_human_actions + 1))
        self.register_buffer("preparation", torch.tensor([task.assistances[k].preparation.mean for k in following]))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """(batch, D) -> (batch, features)."""
        # Comparison instead of one_hot: it exports to ONNX without index types.
        robot = torch.round(observation[:, 0:1]) == torch.arange(1, self.num_robot_tasks + 1)
        action = torch.round(observation[:, 1:2]) == torch.arange(1, self.num_human_actions + 1)
        mean = (action.float() * self.mean_duration).sum(dim=1, keepdim=True)
        preparation = (action.float() * self.preparation).sum(dim=1, keepdim=True)
        elapsed = observation[:, 2:3]
        # Clamped: an action that takes three times its mean tells no more than that.
        seen = [robot.float(), action.float(), torch.clamp(elapsed / mean, 0.0, 3.0)]
        if self.size > 3:
            phase = observation[:, 3:4]
            extrapolated = elapsed * (1.0 - phase) / torch.clamp(phase, min=0.02)
            seen += [phase, _margin(extrapolated, preparation)]
        if self.size > 4:
            seen += [5.0 * observation[:, 4:5], _margin(observation[:, 5:6], preparation)]
        if self.size > 6:
            seen.append(3.0 * (torch.clamp(observation[:, 6:7], 0.0, 3.0) - 1.0))
        return torch.cat(seen, dim=1)


def _margin(remaining: torch.Tensor, preparation: torch.Tensor) -> torch.Tensor:
    return torch.clamp((remaining - preparation) / _TIME_SCALE, -2.0, 3.0)
