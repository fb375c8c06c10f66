"""pace export: a pickle is read only where it is trusted; what comes out decides as the agent did."""

import json
import pickle
import zipfile

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from gymnasium.wrappers import TimeLimit
from stable_baselines3 import A2C, DQN, PPO

from pace_drake.envs.assembly_env import PaceAssemblyEnv
from pace_drake.policies.learned import LearnedPolicy
from tests.cli.test_run import pace, refused
from tests.learning.test_train import SETTINGS, observations


@pytest.fixture(scope="module")
def env(chair):
    return TimeLimit(PaceAssemblyEnv(chair), 50)


@pytest.fixture(scope="module")
def saved(env, tmp_path_factory):
    """An agent of the user's own, with the default network, which has no features of ours."""
    path = tmp_path_factory.mktemp("saved") / "agent.zip"
    agent = PPO("MlpPolicy", env, seed=5, device="cpu")
    agent.save(path)
    return path, agent


@pytest.mark.parametrize("algorithm", [PPO, A2C])
def test_the_policy_decides_as_the_agent(chair, env, saved, tmp_path, algorithm):
    path, agent = saved
    if algorithm is A2C:  # its network is that of PPO
        path, agent = tmp_path / "agent.zip", A2C("MlpPolicy", env, seed=5, device="cpu")
        agent.save(path)
    out = tmp_path / "policy.onnx"
    assert pace("export", path, "--trust-pickle", "-o", out) == 0
    policy = LearnedPolicy(out, chair.task, "paper")
    for observation in observations(chair):
        assert policy.decide(observation.astype(float)) == int(agent.predict(observation, deterministic=True)[0])
    card = json.loads((tmp_path / "policy.json").read_text())
    assert card["source"]["file"] == "agent.zip"
    assert card["seeds"] == {"training": 5}
    assert card["observation"] == "paper"
    assert {p.name for p in tmp_path.iterdir()} - {"agent.zip"} == {"policy.json", "policy.onnx"}


def test_an_agent_of_ours(chair, tmp_path):
    from pace_drake.learning.ppo import train_ppo

    agent = train_ppo(chair, SETTINGS)
    agent.save(tmp_path / "ours.zip")
    assert pace("export", tmp_path / "ours.zip", "--trust-pickle", "-o", tmp_path / "policy.onnx") == 0
    policy = LearnedPolicy(tmp_path / "policy.onnx", chair.task)
    for observation in observations(chair, 50):
        assert policy.decide(observation.astype(float)) == int(agent.predict(observation, deterministic=True)[0])


class Bomb:
    def __reduce__(self):
        return (exec, ("raise SystemExit('a pickle was read')",))


def test_a_pickle_that_is_not_trusted_is_not_read(tmp_path, capsys):
    path = tmp_path / "agent.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("data", pickle.dumps(Bomb()))
    message = refused(capsys, "export", path, "-o", tmp_path / "policy.onnx")
    assert "pickles, which can run anything" in message
    assert "--trust-pickle" in message
    assert not (tmp_path / "policy.onnx").exists()


def test_what_does_not_fit_is_refused(env, saved, tmp_path, capsys):
    path, _ = saved
    out = tmp_path / "policy.onnx"
    trusted = ("--trust-pickle", "-o", out)
    message = refused(capsys, "export", path, *trusted, "--set", "observation=fused")
    assert "its observations are Box" in message
    assert "observation: fused" in message
    DQN("MlpPolicy", env, device="cpu", buffer_size=10).save(tmp_path / "dqn.zip")
    assert "cannot be read as a PPO or A2C agent" in refused(capsys, "export", tmp_path / "dqn.zip", *trusted)
    (tmp_path / "text.zip").write_text("no zip")
    assert "no .zip" in refused(capsys, "export", tmp_path / "text.zip", *trusted)
    with zipfile.ZipFile(tmp_path / "empty.zip", "w"):
        pass
    assert "cannot be read as a PPO or A2C agent" in refused(capsys, "export", tmp_path / "empty.zip", *trusted)
    assert "must end in .onnx" in refused(capsys, "export", path, "--trust-pickle", "-o", tmp_path / "policy.zip")
    assert "agent.zip" in refused(capsys, "export", tmp_path / "agent.zip", *trusted)


def test_a_zip_as_a_policy_is_refused_with_a_hint(saved, capsys):
    path, _ = saved
    message = refused(capsys, "run", "--level", "task", "--policy", path)
    assert f"pace export {path} --trust-pickle" in message


def test_actions_must_be_two(chair, saved, tmp_path, capsys):
    import gymnasium as gym

    class Three(gym.Env):
        observation_space = saved[1].observation_space
        action_space = gym.spaces.Discrete(3)

        def reset(self, seed=None, options=None):
            return np.ones(4, dtype=np.float32), {}

    PPO("MlpPolicy", Three(), device="cpu").save(tmp_path / "three.zip")
    arguments = ("--trust-pickle", "-o", tmp_path / "policy.onnx")
    assert "its actions are Discrete(3)" in refused(capsys, "export", tmp_path / "three.zip", *arguments)
