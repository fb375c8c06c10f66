"""PPO (Schulman et al. 2017) on the compiled twin, or through the Drake adapter with few decisions."""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from pace_drake.envs.pool import POOL_SIZE, cached_pool, pool_key
from pace_drake.envs.vector_env import PaceAssemblyVectorEnv
from pace_drake.learning.checkpoint import CheckpointWriter, checkpoint_path, read_checkpoint
from pace_drake.learning.evaluator import Evaluator
from pace_drake.learning.features import AssemblyFeatures
from pace_drake.learning.greedy import GreedyPolicy
from pace_drake.learning.vec_env import TwinVecEnv
from pace_drake.people import load_people
from pace_drake.policies import Policy
from pace_drake.scenario import Scenario, scenario_hash


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
    steps=300_000,
    num_envs=256,
    rollout=16,
    batch_size=1024,
    epochs=5,
    learning_rate=1e-2,
    hidden=32,
    entropy=0.01,
)
#: How many checkpoints a training on the twin writes, about.
NUM_CHECKPOINTS = 10

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
    *,
    evaluator: Evaluator | None = None,
    policy_file: Path | None = None,
    checkpoint_every: int | None = None,
    resume: bool = False,
    tensorboard: Path | None = None,
    callbacks: Sequence[BaseCallback] = (),
) -> PPO:
    """Trains a policy.

    Durations of steps vary, so rewards are not discounted (gamma = 1): the return is minus the cost.

    Args:
        scenario: the train split of its people is used.
        settings: all random numbers follow from ``settings.seed``.
        progress: called with the number of decisions so far.
        backend: the compiled twin (settings such as ``TWIN_SETTINGS``), or the diagram.
        evaluator: evaluates in the course of training, and may end it; the best parameters are returned.
        policy_file: where the policy will be. On the twin, checkpoints are written beside it, which stay
            (``remove_checkpoint``). None: no checkpoints.
        checkpoint_every: updates from one to the next; None: about a tenth of all.
        resume: go on from the checkpoint; the outcome is, bit by bit, that of a training that was not interrupted.
        tensorboard: folder for TensorBoard's logs; None: none.
        callbacks: more of SB3's.

    Raises:
        InputError: the checkpoint cannot be gone on from, or the scenario cannot be trained on the twin.
    """
    torch.set_num_threads(1)  # networks this small lose time to a second thread
    identity: dict[str, Any] = {}
    if backend == "twin":
        envs, identity = _twin(scenario, settings)
    else:
        envs = _diagram(scenario, settings)
    path = None if policy_file is None or backend == "diagram" else checkpoint_path(policy_file)
    # Before anything is trained: it may be refused.
    checkpoint = read_checkpoint(path, identity) if resume and path is not None else None
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
        tensorboard_log=None if tensorboard is None else str(tensorboard),
        seed=settings.seed,
        device="cpu",
    )
    every: list[BaseCallback] = [_Progress(progress)]
    if evaluator is not None:
        every.append(evaluator)
    if path is not None:
        updates = -(-settings.steps // (settings.num_envs * settings.rollout))
        each = checkpoint_every or -(-updates // NUM_CHECKPOINTS)
        every.append(CheckpointWriter(path, identity, each, evaluator))
    every += callbacks
    if checkpoint is not None:
        checkpoint.restore(model, evaluator)
    model.learn(
        settings.steps - model.num_timesteps,
        callback=CallbackList(every),
        tb_log_name=f"seed-{settings.seed}" if policy_file is None else policy_file.stem,
        reset_num_timesteps=checkpoint is None,
    )
    if evaluator is not None:
        evaluator.restore_best()
    return model


def _twin(scenario: Scenario, settings: PPOSettings) -> tuple[VecEnv, dict[str, Any]]:
    """The environments, and what makes this training what it is, by name."""
    trained = deepcopy(scenario)
    trained.human.split = "train"
    people, seed = load_people(trained), [settings.seed, 1]
    pool = cached_pool(trained, people, POOL_SIZE, seed)
    envs = PaceAssemblyVectorEnv(trained, settings.num_envs, pool)
    packages = ("pace_drake", "stable-baselines3", "torch", "numpy")
    identity = {
        "version": ", ".join(f"{name} {version(name)}" for name in packages),
        "observation set": scenario.observation,
        "scenario": f"{scenario.name} {scenario_hash(scenario)[:12]}",
        **asdict(settings),
        "chart": sha256(scenario.chart_path().read_bytes()).hexdigest()[:12],
        "pool": pool_key(trained, people, POOL_SIZE, seed)[:12],
    }
    return TwinVecEnv(envs, settings.seed, settings.reward_scale), identity


def _diagram(scenario: Scenario, settings: PPOSettings) -> VecEnv:
    from pace_drake.envs.assembly_env import PaceAssemblyEnv  # Drake's diagram, which the twin does without

    def make() -> gym.Env:
        env = PaceAssemblyEnv(scenario, split="train")
        return gym.wrappers.TransformReward(env, lambda reward: settings.reward_scale * float(reward))

    return DummyVecEnv([make] * settings.num_envs)


@dataclass(frozen=True)
class Trainer:
    """Trains greedy policies on the twin, as ``evaluate.worlds`` asks for them; it can be sent to another process."""

    settings: PPOSettings = TWIN_SETTINGS

    def __call__(self, scenario: Scenario, seed: int) -> Policy:
        """The policy that PPO finds in a scenario with a seed."""
        return GreedyPolicy(train_ppo(scenario, replace(self.settings, seed=seed), backend="twin"), scenario)
