"""The compiled twin and the diagram make the same episodes of the same draws."""

import importlib.util
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from pace_drake.envs.assembly_env import PaceAssemblyEnv
from pace_drake.envs.kernel import DECISION, FINISHED
from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.envs.vector_env import PaceAssemblyVectorEnv
from pace_drake.errors import InputError
from pace_drake.people import load_people
from pace_drake.scenario import load_scenario

NUM_EPISODES = 1000


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("ikea_chair")


@pytest.fixture(scope="module")
def pool(scenario):
    return make_pool(scenario, load_people(scenario), 60, np.random.default_rng(1))


def twin_episodes(scenario, pool, parts, actions):
    """Per decision: observations, times and idles, of all episodes at once; the last row is the end."""
    twin = AssemblyTwin(scenario, pool, len(parts))
    twin.start(np.arange(len(parts)), parts)
    rows = []
    for step in range(actions.shape[1]):
        rows.append(
            [a.copy() for a in (twin.status, twin.observe(), twin.time, twin.robot_idle, twin.human_idle, twin.cost)]
        )
        going = np.flatnonzero(twin.status == DECISION)
        if not len(going):
            return [np.array(column) for column in zip(*rows, strict=True)]
        twin.step(actions[going, step], going)
    raise AssertionError("not enough actions")


def assert_same(scenario, pool, num_episodes, seed, assist=0.3):
    rng = np.random.default_rng(seed)
    parts = pool.sample(num_episodes, rng)
    actions = (rng.random((num_episodes, 150)) < assist).astype(int)
    actions[:, 60:] = 1  # so that all end
    status, observation, time, robot_idle, human_idle, cost = twin_episodes(scenario, pool, parts, actions)
    env = PaceAssemblyEnv(scenario)
    decisions = 0
    for e in range(num_episodes):
        seen, info = env.reset(options={"episode": pool.episode(parts[e])})
        for step in range(actions.shape[1]):
            decisions += 1
            finished = status[step, e] == FINISHED
            assert info["time"] == pytest.approx(time[step, e], abs=1e-9)
            assert np.abs(info["robot_idle"] - robot_idle[step, e]).max() <= 1e-9
            assert np.abs(info["human_idle"] - human_idle[step, e]).max() <= 1e-9
            assert info["cost"] == pytest.approx(cost[step, e], abs=1e-8)
            expected = observation[step, e]
            # Phases identical; the elapsed time is a difference of times, equal to rounding.
            assert (seen[[0, 1]] == expected[[0, 1]]).all() or finished
            assert (seen[3:4] == expected[3:4]).all() or finished
            assert seen == pytest.approx(expected, rel=2e-6, abs=1e-5) or finished
            if finished:
                break
            seen, _, terminated, _, info = env.step(actions[e, step])
            assert terminated == (status[step + 1, e] == FINISHED)
    return decisions


@pytest.mark.slow
def test_a_thousand_episodes_are_those_of_the_diagram(scenario, pool):
    assert assert_same(scenario, pool, NUM_EPISODES, 2) > 5 * NUM_EPISODES


@pytest.mark.parametrize(
    "changes",
    [
        {"wait_timeout": 3.0},
        {"decide_at_start": False},
        {"max_decisions": 200, "wait_timeout": 0.5},
        {"observation": "none"},
        {"observation": "fused"},
        {"observation": "history"},
    ],
)
def test_other_scenarios_too(scenario, changes):
    changed = deepcopy(scenario)
    for name, value in changes.items():
        setattr(changed, name, value)
    other = make_pool(changed, load_people(changed), 20, np.random.default_rng(3))
    assert_same(changed, other, 25, 4, assist=0.5)


def plain_env(task):
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "plain_env.py"
    spec = importlib.util.spec_from_file_location("plain_env", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PlainEnv(task)


def test_idle_times_are_those_of_the_resolved_event_order(scenario, pool):
    """The paper's step written out, on 300 episodes; homing may outlast the person's next actions."""
    rng = np.random.default_rng(6)
    slow = replace(pool, homing=pool.homing * rng.choice([1.0, 6.0], pool.homing.shape))
    parts, actions = slow.sample(300, rng), (rng.random((300, 150)) < 0.3).astype(int)
    actions[:, 60:] = 1
    status, observation, time, robot_idle, human_idle, _ = twin_episodes(scenario, slow, parts, actions)
    plain = plain_env(scenario.task)
    for e in range(300):
        seen, _ = plain.reset(options={"episode": slow.episode(parts[e])})
        for step in range(actions.shape[1]):
            assert plain.time == pytest.approx(time[step, e], abs=1e-9)
            assert np.abs(plain.robot_idle - robot_idle[step, e]).max() <= 1e-9
            assert np.abs(plain.human_idle - human_idle[step, e]).max() <= 1e-9
            if status[step, e] == FINISHED:
                break
            assert np.abs(seen[:3] - observation[step, e, :3]).max() < 1e-4
            seen, *_ = plain.step(actions[e, step])


def test_one_and_many_are_the_same(scenario, pool):
    rng = np.random.default_rng(5)
    parts, actions = pool.sample(40, rng), rng.integers(0, 2, (40, 100))
    many = twin_episodes(scenario, pool, parts, actions)
    for e in range(0, 40, 13):
        one = twin_episodes(scenario, pool, parts[e : e + 1], actions[e : e + 1])
        for alone, together in zip(one, many, strict=True):
            assert np.array_equal(alone[:, 0], together[: len(alone), e])


def test_vector_env(scenario, pool):
    envs = PaceAssemblyVectorEnv(scenario, num_envs=48, pool=pool)
    observation, _ = envs.reset(seed=7)
    assert envs.observation_space.contains(observation)
    total, ended = np.zeros(48), 0
    rng = np.random.default_rng(0)
    for _ in range(60):
        observation, reward, terminated, truncated, infos = envs.step(rng.integers(0, 2, 48))
        assert envs.observation_space.contains(observation)
        assert (reward <= 1e-9).all()
        total += reward
        for e in np.flatnonzero(terminated):
            assert -total[e] == pytest.approx(infos["cost"][e], abs=1e-6)
            assert infos["_final_obs"][e]
            assert envs.single_observation_space.contains(infos["final_obs"][e])
            assert observation[e, 2] == 0.0  # a new episode
            total[e] = 0.0
            ended += 1
        assert not truncated.any()
    assert ended > 100


def test_gymnasium_makes_it(scenario, pool):
    """By default, too; the environments that it replaces have the same spaces."""
    made = {
        name: gym.make_vec(name, num_envs=3, vectorization_mode=mode, pool=pool, scenario=scenario)
        for name, mode in (("PaceAssembly-v0", "vector_entry_point"), ("PaceAssemblyNoPhase-v0", None))
    }
    for name, envs in made.items():
        assert isinstance(envs.unwrapped, PaceAssemblyVectorEnv)
        assert envs.single_observation_space == gym.make(name, scenario=scenario).observation_space
        assert envs.reset(seed=0)[0].shape == (3, 4 if name == "PaceAssembly-v0" else 3)
    assert scenario.observation == "paper"  # ours is as it was
    with pytest.raises(InputError, match=r"human\.split: must be one of"):
        gym.make_vec("PaceAssembly-v0", split="both")


def test_the_same_seed_gives_the_same_episodes(scenario, pool):
    def run(seed):
        envs = PaceAssemblyVectorEnv(scenario, num_envs=8, pool=pool)
        rows = [envs.reset(seed=seed)[0]]
        rows += [envs.step(np.arange(8) % 2)[0] for _ in range(50)]
        return np.array(rows)

    assert np.array_equal(run(1), run(1))
    assert not np.array_equal(run(1), run(2))


def test_it_truncates_as_the_scenario_says(scenario, pool):
    changed = deepcopy(scenario)
    changed.max_decisions = 5
    envs = PaceAssemblyVectorEnv(changed, num_envs=4, pool=pool)
    envs.reset(seed=0)
    ends = [envs.step(np.zeros(4, dtype=int))[3] for _ in range(10)]
    assert [bool(e.all()) for e in ends] == [False] * 4 + [True] + [False] * 4 + [True]


def test_mistakes(scenario, pool):
    twin = AssemblyTwin(scenario, pool, 2)
    with pytest.raises(RuntimeError, match="environment 0 is not at a decision"):
        twin.step(np.zeros(2))
    twin.start(np.arange(2), pool.sample(2, np.random.default_rng(0)))
    with pytest.raises(ValueError, match="must be 0 or 1"):
        twin.step(np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="need as many actions"):
        twin.step(np.zeros(3))
    changed = deepcopy(scenario)
    changed.human.monitor = "detector"
    with pytest.raises(InputError, match="the twin knows the person as told"):
        AssemblyTwin(changed, pool, 1)


def test_a_pool_of_people_gives_each_episode_to_one(scenario):
    people = load_people(scenario)
    group = make_pool(scenario, people, 40, np.random.default_rng(0), num_people=5)
    parts = group.sample(200, np.random.default_rng(1))
    who = group.person(parts)
    assert set(who) == set(range(5))
    for j in (0, 2, 4):
        assert (parts[:, j] // 8 == who).all()
        subjects = [people.demonstrations[j][k].subject for k in group.demonstration[j]]
        assert subjects == [f"S{1 + k // 8}" for k in range(40)]
    chosen = group.sample(30, np.random.default_rng(1), person=np.full(30, 3))
    assert (group.person(chosen) == 3).all()


def test_what_is_seen_by_set(scenario):
    seen = deepcopy(scenario)
    seen.observation = "history"
    twin = AssemblyTwin(seen, make_pool(seen, load_people(seen), 8, np.random.default_rng(0)), 3)
    twin.start(np.arange(3), twin.pool.sample(3, np.random.default_rng(0)))
    twin.step(np.zeros(3))
    assert [twin.observe(name).shape for name in ("none", "paper", "fused", "history")] == [
        (3, n) for n in (3, 4, 6, 7)
    ]
    assert (twin.observe() == twin.observe("history")).all()
    assert (twin.observe("paper")[:, 3] == twin.seen[:, 3].astype(np.float32)).all()
    assert (twin.observe("fused")[:, 3] == twin.seen[:, 4].astype(np.float32)).all()
    assert (twin.observe("paper", np.array([2])) == twin.observe("paper")[2:]).all()
