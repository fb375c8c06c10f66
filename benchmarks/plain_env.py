"""The paper's task as a plain Gymnasium environment: the resolved event order in a few lines, without phase.

For comparison only; tests hold its idle times equal to those of the diagram's twin.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from pace_drake.task import NUM_ROBOT_DRAWS, Episode, Task


class PlainEnv(gym.Env):
    """Observation (i, j, elapsed, 0); without timeouts, and decided at the start.

    Args:
        task: a validated task.
    """

    def __init__(self, task: Task) -> None:
        self.task, self.alpha = task, task.human_index_of_joint
        self.action_space = gym.spaces.Discrete(2)
        self.observation_space = gym.spaces.Box(0.0, np.inf, (4,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Plays ``options["episode"]``."""
        super().reset(seed=seed)
        self.episode: Episode = (options or {})["episode"]
        self.time, self.number, self.robot_task, self.joint = 0.0, 0, self.task.num_robot_tasks, 0
        self.robot_idle, self.human_idle = np.zeros(len(self.alpha)), np.zeros(len(self.alpha))
        self._next_segment(0.0, 1)
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One robot task, or one assistance."""
        joint, before = self.joint, (self.robot_idle.sum(), self.human_idle.sum())
        self.number += 1
        if action == 0:
            self.robot_task = self.robot_task % self.task.num_robot_tasks + 1
            self.time += self.episode.robot[(self.number - 1) % NUM_ROBOT_DRAWS, self.robot_task - 1]
            self._human_waits_until(self.time)
        else:
            prepared = self.time + self.episode.preparation[joint]
            begun = max(prepared, self.ready)
            self.robot_idle[joint] += begun - prepared
            self._human_waits_until(begun)
            ended = begun + self.episode.human[self.alpha[joint] - 1]
            self.time = ended + self.episode.homing[joint]
            self.number += 2
            self.joint += 1
            if self.joint < len(self.alpha):
                self._next_segment(ended, self.alpha[joint] + 1)
                self._human_waits_until(self.time)
        reward = before[0] - self.robot_idle.sum() + self.task.human_idle_weight * (before[1] - self.human_idle.sum())
        return self._observe(), float(reward), self.joint == len(self.alpha), False, {}

    def _next_segment(self, start: float, first: int) -> None:
        """The person begins action ``first`` at ``start`` and is ready for the next joint action after its last."""
        durations = self.episode.human[first - 1 : self.alpha[self.joint] - 1]
        self.first, self.starts = first, start + np.concatenate([[0.0], np.cumsum(durations)])
        self.ready = self.counted = float(self.starts[-1])

    def _human_waits_until(self, time: float) -> None:
        if time > self.counted:
            self.human_idle[self.joint] += time - self.counted
            self.counted = time

    def _observe(self) -> np.ndarray:
        at = int(np.searchsorted(self.starts, self.time, side="right")) - 1
        return np.array([self.robot_task, self.first + at, self.time - self.starts[at], 0.0], dtype=np.float32)
