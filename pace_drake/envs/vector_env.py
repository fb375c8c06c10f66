"""PaceAssemblyVectorEnv: the compiled twin as a Gymnasium vector environment."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from pace_drake.envs.kernel import FINISHED
from pace_drake.envs.pool import Pool, make_pool
from pace_drake.envs.space import adapted, observation_space
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.people import load_people
from pace_drake.scenario import Scenario


class PaceAssemblyVectorEnv(VectorEnv):
    """``num_envs`` copies of PaceAssembly-v0 (see ``PaceAssemblyEnv``), compiled.

    ``gymnasium.make_vec`` makes it, unless another ``vectorization_mode`` is asked for.

    An environment that ends is reset in the same step: its observation is then that of the new episode, the last
    one of the old is in ``infos["final_obs"]``, with ``infos["cost"]`` of the old episode.

    Args:
        scenario: name, .yaml file or a ``Scenario``.
        num_envs: how many.
        pool: draws of the scenario; None draws ``pool_size`` of them with ``pool_seed``.
        pool_size, pool_seed: see ``make_pool``.
        num_threads: see ``AssemblyTwin``.
        observation, split: see ``PaceAssemblyEnv``.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        scenario: str | Scenario = "ikea_chair",
        num_envs: int = 256,
        pool: Pool | None = None,
        pool_size: int = 256,
        pool_seed: int = 0,
        num_threads: int = 1,
        observation: str | None = None,
        split: str | None = None,
    ) -> None:
        loaded = adapted(scenario, observation, split)
        if pool is None:
            pool = make_pool(loaded, load_people(loaded), pool_size, np.random.default_rng(pool_seed))
        self.scenario, self.num_envs = loaded, num_envs
        self.twin = AssemblyTwin(loaded, pool, num_envs, num_threads)
        self.single_action_space = gym.spaces.Discrete(2)
        self.single_observation_space = observation_space(loaded)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        space = self.single_observation_space
        self._low, self._high = space.low, space.high
        self._cost = np.zeros(num_envs)
        self._steps = np.zeros(num_envs, dtype=int)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Starts an episode in every environment.

        Args:
            seed: of all draws from now on; None goes on with those of before.
            options: ``{"parts": (num_envs, N + 3)}`` plays these rows of ``Pool.sample`` instead of drawing.
        """
        super().reset(seed=seed)
        parts = (options or {}).get("parts")
        self._start(np.arange(self.num_envs), parts)
        return self._observation(), {"time": self.twin.time.copy()}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Carries out one decision in each environment; see the class."""
        twin = self.twin
        before = twin.time.copy()
        twin.step(actions)
        self._steps += 1
        cost = twin.cost
        rewards = self._cost - cost
        terminated = twin.status == FINISHED
        truncated = ~terminated & (self._steps >= self.scenario.max_decisions)
        infos: dict[str, Any] = {"time": twin.time.copy(), "duration": twin.time - before, "cost": cost}
        ended = np.flatnonzero(terminated | truncated)
        if len(ended):
            infos["final_obs"], infos["_final_obs"] = self._observation(), terminated | truncated
            self._cost = cost.copy()
            self._start(ended, None)
        else:
            self._cost = cost
        return self._observation(), rewards, terminated, truncated, infos

    def snapshot(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """(arrays, plain data) that determine all that follows; for ``restore``."""
        arrays = {**self.twin.snapshot(), "_cost": self._cost.copy(), "_steps": self._steps.copy()}
        return arrays, {"np_random": self.np_random.bit_generator.state}

    def restore(self, arrays: Mapping[str, np.ndarray], data: Mapping[str, Any]) -> None:
        """Goes back to a ``snapshot``, of this environment or of one like it.

        Raises:
            KeyError, ValueError: it is of another environment.
        """
        self.twin.restore(arrays)
        self._cost[:], self._steps[:] = arrays["_cost"], arrays["_steps"]
        self.np_random.bit_generator.state = data["np_random"]

    def _start(self, envs: np.ndarray, parts: np.ndarray | None) -> None:
        self.twin.start(envs, self.twin.pool.sample(len(envs), self.np_random) if parts is None else parts)
        self._cost[envs] = 0.0
        self._steps[envs] = 0

    def _observation(self) -> np.ndarray:
        return np.clip(self.twin.observe(), self._low, self._high)
