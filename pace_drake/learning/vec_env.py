"""TwinVecEnv: the compiled twin as a vector environment of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from pace_drake.envs.vector_env import PaceAssemblyVectorEnv


class TwinVecEnv(VecEnv):
    """Wraps a ``PaceAssemblyVectorEnv``.

    Args:
        envs: the twin.
        seed: of all draws.
        reward_scale: rewards are multiplied by it.

    Attributes:
        envs: the twin; its ``snapshot`` is this object's, too.
    """

    def __init__(self, envs: PaceAssemblyVectorEnv, seed: int = 0, reward_scale: float = 1.0) -> None:
        # The base class asks for attributes at once.
        self.envs, self._seed, self._scale = envs, seed, reward_scale
        self.num_envs = envs.num_envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._actions = np.zeros(envs.num_envs)

    def reset(self) -> np.ndarray:
        """Starts an episode everywhere; every call draws the same ones."""
        return self.envs.reset(seed=self._seed)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Carries out one decision in each environment; those that end begin anew."""
        observation, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        done = terminated | truncated
        for env in np.flatnonzero(done):
            each[env] = {
                "terminal_observation": infos["final_obs"][env],
                "TimeLimit.truncated": bool(truncated[env]),
                "cost": float(infos["cost"][env]),
            }
        return observation, (rewards * self._scale).astype(np.float32), done, each

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same for all; None where the twin has no such attribute, as it has no single environments."""
        return [getattr(self.envs, attr_name, None)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not possible: the environments are one."""
        raise NotImplementedError("the twin's environments cannot differ")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Not possible: there are no single environments."""
        raise NotImplementedError("the twin has no single environments")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """Never."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: Any) -> Sequence[int]:
        return range(self.num_envs) if indices is None else [indices] if isinstance(indices, int) else list(indices)
