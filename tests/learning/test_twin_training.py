"""Training on the compiled twin: the interface of SB3, and a policy that helps."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from pace_drake.envs.kernel import DECISION
from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.envs.vector_env import PaceAssemblyVectorEnv
from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo
from pace_drake.learning.vec_env import TwinVecEnv
from pace_drake.people import load_people


@pytest.fixture(scope="module")
def pool(chair):
    return make_pool(chair, load_people(chair), 60, np.random.default_rng(1))


def test_the_interface_of_sb3(chair, pool):
    envs = TwinVecEnv(PaceAssemblyVectorEnv(chair, 40, pool), seed=2, reward_scale=0.1)
    plain = PaceAssemblyVectorEnv(chair, 40, pool)
    first = envs.reset()
    assert np.array_equal(first, plain.reset(seed=2)[0])
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(40):
        actions = rng.integers(0, 2, 40)
        observation, rewards, dones, infos = envs.step(actions)
        expected, reward, terminated, truncated, info = plain.step(actions)
        assert np.array_equal(observation, expected)
        assert np.allclose(rewards, 0.1 * reward, atol=1e-5)
        assert np.array_equal(dones, terminated | truncated)
        for env in np.flatnonzero(dones):
            assert np.array_equal(infos[env]["terminal_observation"], info["final_obs"][env])
            assert infos[env]["TimeLimit.truncated"] is bool(truncated[env])
            ended += 1
        assert len({id(one) for one in infos}) == 40
    assert ended > 50
    assert np.array_equal(envs.reset(), first)


def cost(scenario, pool, decide):
    twin = AssemblyTwin(scenario, pool, 400)
    twin.start(np.arange(400), pool.sample(400, np.random.default_rng(3)))
    for _ in range(300):
        going = np.flatnonzero(twin.status == DECISION)
        if not len(going):
            return twin.cost.mean()
        observation = twin.observe(envs=going)
        waits = np.isin(observation[:, 1], scenario.task.human_index_of_joint)
        twin.step(np.where(waits, 1, decide(observation)), going)
    raise AssertionError("episodes do not end")


def test_a_short_training_helps(chair, pool):
    settings = replace(TWIN_SETTINGS, steps=60_000, hidden=32, learning_rate=1e-2, seed=1)
    model = train_ppo(chair, settings, backend="twin")
    learned = cost(chair, pool, lambda o: model.predict(o, deterministic=True)[0])
    always = cost(chair, pool, lambda o: np.ones(len(o), dtype=int))
    asked = cost(chair, pool, lambda o: np.zeros(len(o), dtype=int))
    assert learned < 0.75 * always
    assert learned < 0.3 * asked


def test_the_same_seed_gives_the_same_network(chair):
    settings = replace(TWIN_SETTINGS, steps=600, num_envs=40, rollout=8, batch_size=64, epochs=1, seed=5)
    first, again = (train_ppo(chair, settings, backend="twin").policy.state_dict() for _ in range(2))
    for name, value in first.items():
        assert np.array_equal(value.numpy(), again[name].numpy()), name
