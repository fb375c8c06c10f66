"""Checkpoints: a training that was broken off ends in the same bits, and what is not its own is refused by name."""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from stable_baselines3.common.callbacks import BaseCallback

from pace_drake.errors import InputError
from pace_drake.learning import ppo
from pace_drake.learning.checkpoint import checkpoint_path, remove_checkpoint
from pace_drake.learning.evaluator import Evaluator
from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo

#: 20 updates of 640 decisions: a checkpoint after every second.
SETTINGS = replace(TWIN_SETTINGS, steps=12_800, num_envs=40, rollout=16, batch_size=160, epochs=2, hidden=16, seed=7)


class Kill(Exception):
    pass


class Break(BaseCallback):
    """Raises in the middle of a rollout."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def _on_step(self):
        if self.num_timesteps >= self.at:
            raise Kill
        return True


@pytest.fixture(autouse=True, scope="module")
def small():
    """A pool and episodes that are made in no time."""
    patch = pytest.MonkeyPatch()
    patch.setattr(ppo, "POOL_SIZE", 40)
    patch.setattr("pace_drake.learning.evaluator.POOL_SIZE", 40)
    yield
    patch.undo()


@pytest.fixture
def evaluator(chair, chair_people):
    return lambda: Evaluator(chair, chair_people, every=1280, episodes=50)


def parameters(model):
    return {name: value.numpy().copy() for name, value in model.policy.state_dict().items()}


def assert_same(one, other):
    assert list(one) == list(other)
    for name, value in one.items():
        assert np.array_equal(value, other[name]), name


@pytest.fixture(scope="module")
def broken(chair, chair_people, tmp_path_factory):
    """A training that was broken off in its twelfth update, and where its policy would be."""
    path = tmp_path_factory.mktemp("broken") / "policy.onnx"
    judge = Evaluator(chair, chair_people, every=1280, episodes=50)
    with pytest.raises(Kill):
        train_ppo(chair, SETTINGS, backend="twin", policy_file=path, evaluator=judge, callbacks=[Break(7_500)])
    return path


def test_it_ends_in_the_same_bits(chair, broken, evaluator):
    """With the evaluations; the network and Adam's moments at the end, and the best network."""
    whole, judge = evaluator(), evaluator()
    seen = []
    reference = train_ppo(chair, SETTINGS, backend="twin", evaluator=whole, callbacks=[Last(seen)])
    np.random.seed(99)  # noqa: NPY002 - what another process would have left behind
    first = []
    resumed = train_ppo(
        chair,
        SETTINGS,
        first.append,
        backend="twin",
        policy_file=broken,
        resume=True,
        evaluator=judge,
        callbacks=[Last(seen)],
    )
    assert first[0] == 6_400 + 40  # it did not begin anew
    assert_same(parameters(reference), parameters(resumed))
    assert_same(*seen)
    assert whole.history == judge.history
    assert whole.best == judge.best
    assert len(whole.history) == 10
    moments, others = (model.policy.optimizer.state_dict()["state"] for model in (reference, resumed))
    for k, one in moments.items():
        for name, value in one.items():
            assert np.array_equal(value.numpy(), others[k][name].numpy()), (k, name)


class Last(BaseCallback):
    """Keeps the parameters at the end, before the best are put back."""

    def __init__(self, seen):
        super().__init__()
        self.seen = seen

    def _on_step(self):
        return True

    def _on_training_end(self):
        self.seen.append(parameters(self.model))


def test_no_pickle_is_in_it(broken):
    with np.load(checkpoint_path(broken), allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)
        data = json.loads(str(file["data"]))
    assert data["identity"]["seed"] == 7
    assert 0 < data["decisions"] < SETTINGS.steps
    assert [p.name for p in broken.parent.iterdir()] == ["policy.checkpoint.npz"]


def other_scenario(chair, name, value):
    changed = deepcopy(chair)
    setattr(changed, name, value)
    return changed


def refusal(*arguments):
    with pytest.raises(InputError) as error:
        train_ppo(*arguments[:2], backend="twin", policy_file=arguments[2], resume=True)
    assert "\n" not in str(error.value)
    assert "policy.checkpoint.npz" in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(("name", "value"), [("seed", 8), ("steps", 20_000), ("learning_rate", 1e-3), ("epochs", 3)])
def test_other_settings_are_refused(chair, broken, name, value):
    message = refusal(chair, replace(SETTINGS, **{name: value}), broken)
    assert f"its {name} is {getattr(SETTINGS, name)}, not {value}" in message


def test_another_scenario_observation_or_version_is_refused(chair, broken, monkeypatch):
    assert "its scenario is ikea_chair" in refusal(other_scenario(chair, "max_decisions", 150), SETTINGS, broken)
    message = refusal(other_scenario(chair, "observation", "none"), SETTINGS, broken)
    assert "its observation set is paper, not none" in message
    monkeypatch.setattr(ppo, "version", lambda name: "9.9")
    assert "its version is pace_drake" in refusal(chair, SETTINGS, broken)


@pytest.mark.parametrize("damage", ["cut", "bit", "text", "policy", "twin", "missing"])
def test_a_damaged_one_is_refused(chair, broken, tmp_path, damage):
    path = tmp_path / "policy.onnx"
    file, content = checkpoint_path(path), bytearray(checkpoint_path(broken).read_bytes())
    with np.load(checkpoint_path(broken), allow_pickle=False) as read:
        arrays = {name: read[name] for name in read.files}
    if damage == "cut":
        file.write_bytes(content[:-2000])
    elif damage == "bit":
        content[len(content) // 2] ^= 4
        file.write_bytes(content)
    elif damage == "text":
        file.write_text("no checkpoint")
    elif damage == "policy":
        arrays["policy/action_net.bias"] = np.zeros(7, dtype=np.float32)
        np.savez(file, **arrays)
    elif damage == "twin":
        arrays["twin/_parts"] = arrays["twin/_parts"] + 1000
        np.savez(file, **arrays)
    else:
        del arrays["last_obs"]
        np.savez(file, **arrays)
    assert "damaged" in refusal(chair, SETTINGS, path)


def test_nothing_to_go_on_from(chair, tmp_path):
    assert "no such checkpoint" in refusal(chair, SETTINGS, tmp_path / "policy.onnx")


def test_removal_takes_unfinished_ones_too(tmp_path):
    path = checkpoint_path(tmp_path / "policy[1].onnx")
    for name in (path.name, ".policy[1].checkpoint.12.part.npz", ".policy1.checkpoint.12.part.npz", "policy[1].onnx"):
        (tmp_path / name).touch()
    remove_checkpoint(path)
    remove_checkpoint(path)  # nothing there is no error
    assert sorted(p.name for p in tmp_path.iterdir()) == [".policy1.checkpoint.12.part.npz", "policy[1].onnx"]
