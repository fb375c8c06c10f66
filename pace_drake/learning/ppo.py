"""PPO (Schulman et al. 2017) on the compiled twin, or through the Drake adapter with few decisions."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Literal

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from pace_drake.envs.assembly_env import PaceAssemblyEnv
from pace_drake.envs.pool import make_pool
from pace_drake.envs.vector_env import PaceAssemblyVectorEnv
from pace_drake.learning.features import AssemblyFeatures
from pace_drake.learning.vec_env import TwinVecEnv
from pace_drake.people import load_people
from pace_drake.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class PPOSettings:
    """Settings for few decisions, as each goes through the diagram (docs/learning.md)."""

    steps: int = 20_000
    """Decisions to train on."""
    seed: int = 0
    num_envs: int = 8
    rollout: int = 128
    """Decisions per environment between updates."""
    batch_size: int = 256
    epochs: int = 20
    learning_rate: float = 3e-3
    """At the start; falls linearly to 0."""
    hidden: int = 32
    """Units in each of the two hidden layers."""
    gae_lambda: float = 0.8
    entropy: float = 0.005
    reward_scale: float = 0.1
    """Idle seconds are tens; value targets near 1 train faster."""


#: For the twin, where decisions cost next to nothing and the network's updates are what takes time.
TWIN_SETTINGS = PPOSettings(
    steps=1_000_000,
    num_envs=256,
    rollout=16,
    batch_size=1024,
    epochs=5,
    learning_rate=5e-3,
    hidden=64,
    entropy=0.02,
)
#: (demonstration, duration) pairs of each human action in the twin's pool.
POOL_SIZE = 512

Backend = Literal["twin", "diagram"]


class _Progress(BaseCallback):
    def __init__(self, report: Callable[[int], None]) -> None:
        super().__init__()
        self._report = report

    def _on_step(self) -> bool:
        self._report(self.num_timesteps)
        return True


def train_ppo(
    scenario: Scenario,
    settings: PPOSettings,
    progress: Callable[[int], None] = lambda _steps: None,
    backend: Backend = "diagram",
) -> PPO:
    """Trains a policy.

    Durations of steps vary, so rewards are not discounted (gamma = 1): the return is minus the cost.

    Args:
        scenario: the train split of its people is used.
        settings: all random numbers follow from ``settings.seed``.
        progress: called with the number of decisions so far.
        backend: the compiled twin (settings such as ``TWIN_SETTINGS``), or the diagram.
    """
    torch.set_num_threads(1)  # networks this small lose time to a second thread

    envs = _twin(scenario, settings) if backend == "twin" else _diagram(scenario, settings)
    model = PPO(
        "MlpPolicy",
        envs,
        learning_rate=lambda remaining: settings.learning_rate * remaining,
        n_steps=settings.rollout,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        gamma=1.0,
        gae_lambda=settings.gae_lambda,
        ent_coef=settings.entropy,
        policy_kwargs={
            "features_extractor_class": AssemblyFeatures,
            "features_extractor_kwargs": {"task": scenario.task},
            "net_arch": [settings.hidden, settings.hidden],
        },
        seed=settings.seed,
        device="cpu",
    )
    return model.learn(settings.steps, callback=_Progress(progress))


def _twin(scenario: Scenario, settings: PPOSettings) -> VecEnv:
    trained = deepcopy(scenario)
    trained.human.split = "train"
    pool = make_pool(trained, load_people(trained), POOL_SIZE, np.random.default_rng([settings.seed, 1]))
    envs = PaceAssemblyVectorEnv(trained, settings.num_envs, pool)
    return TwinVecEnv(envs, settings.seed, settings.reward_scale)


def _diagram(scenario: Scenario, settings: PPOSettings) -> VecEnv:
    def make() -> gym.Env:
        env = PaceAssemblyEnv(scenario, split="train")
        return gym.wrappers.TransformReward(env, lambda reward: settings.reward_scale * float(reward))

    return DummyVecEnv([make] * settings.num_envs)
