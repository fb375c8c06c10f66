"""Training end to end: short, repeatable, exported whole."""

import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from pace_drake.learning.export import export_policy
from pace_drake.learning.ppo import PPOSettings, train_ppo
from pace_drake.policies.learned import LearnedPolicy

SETTINGS = PPOSettings(steps=64, num_envs=2, rollout=32, epochs=2, batch_size=32, seed=3)


@pytest.fixture(scope="module")
def model(chair):
    return train_ppo(chair, SETTINGS)


def observations(chair, count=200):
    rng = np.random.default_rng(0)
    task = chair.task
    return np.column_stack(
        [
            rng.integers(1, task.num_robot_tasks + 1, count),
            rng.choice([1, 3, 5], count),
            rng.uniform(0, 60, count),
            rng.uniform(0, 1, count),
        ]
    ).astype(np.float32)


def test_the_exported_policy_decides_as_the_trained_one(model, chair, chair_people, tmp_path):
    path = tmp_path / "policy.onnx"
    export_policy(model, chair, chair_people, path, {"decisions": 64})
    policy = LearnedPolicy(path, chair.task)
    for observation in observations(chair):
        expected, _ = model.predict(observation, deterministic=True)
        assert policy.decide(observation.astype(float)) == int(expected)
    card = json.loads((tmp_path / "policy.json").read_text())
    assert card["scenario"] == "ikea_chair"
    assert card["decisions"] == 64
    assert sorted(p.name for p in tmp_path.iterdir()) == ["policy.json", "policy.onnx"]  # nothing half-written
    assert b"/pace_drake/" not in path.read_bytes()  # no trace of the machine it was made on


def test_same_seed_same_network(model, chair):
    again = train_ppo(chair, SETTINGS)
    for name, value in model.policy.state_dict().items():
        assert np.array_equal(value.numpy(), again.policy.state_dict()[name].numpy()), name
