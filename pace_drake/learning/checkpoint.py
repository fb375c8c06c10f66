"""The whole state of a training on the twin in one file, from which it goes on bit by bit; no pickle.

All that a training goes on from is here: the network, Adam's moments, the number of decisions, what the agent saw
last, the generators (torch draws the actions, numpy's global one shuffles the batches, the twin has its own), the twin,
and the evaluations with the best parameters so far. Python's own generator is not: nothing draws from it.
"""

import glob
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from pace_drake.errors import InputError, require
from pace_drake.files import write_whole
from pace_drake.learning.evaluator import Evaluator
from pace_drake.learning.vec_env import TwinVecEnv

#: Version of what the arrays and the data of a checkpoint mean.
FORMAT = "pace_drake-checkpoint-1"

_DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, EOFError, zipfile.BadZipFile)


def checkpoint_path(policy: Path) -> Path:
    """Where the checkpoint of a policy file is: beside it."""
    return policy.with_suffix(".checkpoint.npz")


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint as it was read.

    Attributes:
        path: its file.
        arrays: by group and name, such as ``policy/action_net.bias``.
        data: what is not an array.
    """

    path: Path
    arrays: Mapping[str, np.ndarray]
    data: Mapping[str, Any]

    def restore(self, model: PPO, evaluator: Evaluator | None) -> None:
        """Brings a new agent to where the old one was; then ``model.learn(..., reset_num_timesteps=False)``.

        Args:
            model: on a ``TwinVecEnv``, made with the settings of the checkpoint.
            evaluator: takes up the evaluations.

        Raises:
            InputError: the file does not hold what such an agent needs.
        """
        try:
            self._restore(model, evaluator)
        except _DAMAGE as error:
            raise _damaged(self.path, error) from error

    def _restore(self, model: PPO, evaluator: Evaluator | None) -> None:
        data = self.data
        model.policy.load_state_dict(_tensors(self._group("policy")))
        optimizer = model.policy.optimizer
        moments: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in _tensors(self._group("adam")).items():
            parameter, name = key.split("/")
            moments.setdefault(int(parameter), {})[name] = value
        optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
        _envs(model).envs.restore(self._group("twin"), data["twin"])
        model._last_obs, model._last_episode_starts = self.arrays["last_obs"], self.arrays["episode_starts"]
        model.num_timesteps, model._n_updates = int(data["decisions"]), int(data["updates"])
        model._current_progress_remaining = float(data["progress_remaining"])
        if evaluator is not None and data["evaluations"] is not None:
            evaluator.restore(self._group("best"), data["evaluations"])
        torch.set_rng_state(torch.as_tensor(self.arrays["torch_random"]))
        np.random.set_state({**data["numpy_random"], "state": {  # noqa: NPY002 - SB3 shuffles with it
            "key": self.arrays["numpy_random"], "pos": data["numpy_random"]["pos"]}})  # fmt: skip

    def _group(self, name: str) -> dict[str, np.ndarray]:
        return {k.removeprefix(f"{name}/"): v for k, v in self.arrays.items() if k.startswith(f"{name}/")}


class CheckpointWriter(BaseCallback):
    """Writes checkpoints, between two updates.

    Args:
        path: of the file; each replaces the one before.
        identity: by name, what must be equal where the training goes on.
        every: updates from one checkpoint to the next.
        evaluator: its evaluations are kept too. It must come before this object in the list of callbacks.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], every: int, evaluator: Evaluator | None = None) -> None:
        super().__init__()
        self.path, self._identity, self._every, self._evaluator = path, identity, every, evaluator
        self._rollouts = 0

    def _on_rollout_start(self) -> None:
        if self._rollouts > 0 and self._rollouts % self._every == 0:
            self.write()
        self._rollouts += 1

    def _on_step(self) -> bool:
        return True

    def write(self) -> None:
        """Writes the state as it is; only between two updates does it hold all."""
        model = self.model
        assert isinstance(model, PPO)
        assert model._last_obs is not None
        twin, of_twin = _envs(model).envs.snapshot()
        best, evaluations = ({}, None) if self._evaluator is None else self._evaluator.snapshot()
        moments = model.policy.optimizer.state_dict()["state"]
        numpy_random: dict[str, Any] = np.random.get_state(legacy=False)  # noqa: NPY002
        inner = numpy_random.pop("state")
        arrays = {
            **{f"policy/{name}": value.numpy() for name, value in model.policy.state_dict().items()},
            **{f"adam/{k}/{name}": value.numpy() for k, one in moments.items() for name, value in one.items()},
            **{f"twin/{name}": value for name, value in twin.items()},
            **{f"best/{name}": value for name, value in best.items()},
            "last_obs": model._last_obs,
            "episode_starts": model._last_episode_starts,
            "torch_random": torch.get_rng_state().numpy(),
            "numpy_random": inner["key"],
        }
        data = {
            "format": FORMAT,
            "identity": self._identity,
            "decisions": model.num_timesteps,
            "updates": model._n_updates,
            "progress_remaining": model._current_progress_remaining,
            "twin": of_twin,
            "evaluations": evaluations,
            "numpy_random": {**numpy_random, "pos": inner["pos"]},
        }
        text = np.array(json.dumps(data))
        write_whole(self.path, lambda part: np.savez(part, allow_pickle=False, data=text, **arrays))


def read_checkpoint(path: Path, identity: Mapping[str, Any]) -> Checkpoint:
    """Reads the checkpoint of a training.

    Args:
        path: of the file.
        identity: as it was given to ``CheckpointWriter``.

    Raises:
        InputError: no such file, a damaged one, or one of another training; says what differs.
    """
    if not path.exists():
        raise InputError(f"{path}: no such checkpoint to go on from; train without --resume")
    try:
        with np.load(path, allow_pickle=False) as file:  # checks the sum of every array
            arrays = {name: file[name] for name in file.files}
        data = json.loads(str(arrays.pop("data")))
        require(data["format"] == FORMAT, f"{path}", f"is not of the format {FORMAT}; remove it and train anew")
        theirs = data["identity"]
    except InputError:
        raise
    except _DAMAGE as error:
        raise _damaged(path, error) from error
    for name, ours in json.loads(json.dumps(identity)).items():
        if theirs.get(name) != ours:
            raise InputError(
                f"{path}: is of another training: its {name} is {theirs.get(name)}, not {ours}; give what it was"
                " begun with, or train without --resume"
            )
    return Checkpoint(path, arrays, data)


def remove_checkpoint(path: Path) -> None:
    """Removes a checkpoint, and what a killed training had not finished writing."""
    path.unlink(missing_ok=True)
    for part in path.parent.glob(f".{glob.escape(path.stem)}.*.part{path.suffix}"):
        part.unlink(missing_ok=True)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: damaged ({' '.join(str(error).split())}); remove it and train without --resume")


def _tensors(arrays: Mapping[str, np.ndarray]) -> dict[str, torch.Tensor]:
    return {name: torch.tensor(value) for name, value in arrays.items()}


def _envs(model: PPO) -> TwinVecEnv:
    envs = model.get_env()
    if not isinstance(envs, TwinVecEnv):
        raise TypeError("only a training on the twin has checkpoints")
    return envs
