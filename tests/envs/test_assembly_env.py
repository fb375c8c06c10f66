"""PaceAssemblyEnv: what Gymnasium and SB3 expect, and the same traces as the diagram."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pace_drake
import pace_drake.envs.assembly_env
import pace_drake.errors
from pace_drake.diagram import Assembly
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation


@pytest.fixture(scope="module")
def env():
    assert pace_drake.__version__
    return gym.make("PaceAssembly-v0").unwrapped


def test_gymnasium_check_without_a_warning(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)


def test_stable_baselines_check_without_a_warning(env):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="extra 'train' is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env)


def rollout(env, seed, policy, limit=200):
    observation, info = env.reset(seed=seed)
    rows = [(*observation.tolist(), info["time"])]
    total = 0.0
    for _ in range(limit):
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        total += reward
        rows.append((*observation.tolist(), reward, info["time"], info["duration"]))
        if terminated or truncated:
            break
    return rows, total, info, terminated


def test_two_resets_with_a_seed_give_the_same_episode_and_the_return_is_minus_the_cost(env):
    policies = [np.random.default_rng(3) for _ in range(2)]
    runs = [rollout(env, 42, lambda _o, r=rng: int(r.random() < 0.4)) for rng in policies]
    assert runs[0][0] == runs[1][0]
    rows, total, info, terminated = runs[0]
    assert terminated
    assert total == pytest.approx(-info["cost"], abs=1e-9)
    weight = env.scenario.task.human_idle_weight
    assert info["cost"] == pytest.approx(info["robot_idle"].sum() + weight * info["human_idle"].sum())
    assert sum(row[-1] for row in rows[1:]) == pytest.approx(info["time"])
    assert rows != rollout(env, 43, lambda _o: 0)[0]


def test_the_adapter_gives_the_trace_of_the_policy_inside_the_diagram(env, chair):
    """Bit for bit: decision times, observations and idle times."""
    policy = make_policy("phase_threshold", chair)
    inside = Simulation(Assembly(chair, policy, people=env.simulation.assembly.people))
    seen = []

    def listen(simulation, before):
        if before and simulation.decision_pending:
            seen.append((*simulation.output("observation").tolist(), simulation.time))

    inside.listeners = (listen,)
    for seed in range(5):
        seen.clear()
        env.reset(seed=seed)
        episode = inside.sample_episode(np.random.default_rng(np.random.PCG64(np.random.SeedSequence(seed))))
        env.reset(options={"episode": episode})
        inside.reset(episode)
        assert inside.run()
        observation, info = env.reset(options={"episode": episode})
        rows = [(*observation.tolist(), info["time"])]
        terminated = False
        while not terminated:
            observation, _, terminated, _, info = env.step(policy.decide(observation.astype(float)))
            if not terminated:
                rows.append((*observation.tolist(), info["time"]))
        assert rows == seen
        assert np.array_equal(info["robot_idle"], inside.output("robot_idle"))
        assert np.array_equal(info["human_idle"], inside.output("human_idle"))


def test_never_assisting_is_truncated(env):
    rows, _, _, terminated = rollout(env, 0, lambda _o: 0, limit=1000)
    assert not terminated
    assert len(rows) - 1 == env.scenario.max_decisions


def test_the_split_is_the_env_s_own(chair):
    train = gym.make("PaceAssembly-v0", scenario=chair, split="train").unwrapped
    assert train.scenario.human.split == "train"
    assert chair.human.split == "validation"  # the caller's scenario is not touched
    people = train.simulation.assembly.people
    # 5 subjects x 3 trials; one that is the reference is not played.
    expected = [0 if d is None else 15 - (d.trial != "reference") for d in people.references]
    assert [len(d) for d in people.demonstrations] == expected
    assert expected[1] == 0 < expected[0]


@pytest.mark.parametrize(("name", "size"), [("none", 3), ("paper", 4), ("fused", 6), ("history", 7)])
def test_observation_sets(chair, name, size):
    env = gym.make("PaceAssembly-v0", scenario=chair, observation=name).unwrapped
    episode = env.simulation.sample_episode(np.random.default_rng(1))
    observation, _ = env.reset(options={"episode": episode})
    assert observation.shape == (size,) == env.observation_space.shape
    means = [action.duration.mean for action in env.scenario.task.human_actions]
    terminated, seen = False, []
    while not terminated:
        observation, _, terminated, _, _ = env.step(int(observation[1]) in (2, 4, 6))
        assert env.observation_space.contains(observation)
        seen.append(observation)
    if name == "history":
        ratios = [episode.human[k] / means[k] for k in (0, 2, 4)]
        expected = {1: 1.0, 2: ratios[0], 3: ratios[0], 5: np.mean(ratios[:2])}
        for action, pace in expected.items():
            paces = [row[6] for row in seen if row[1] == action]
            assert paces
            assert paces == pytest.approx([pace] * len(paces), rel=1e-6)
    if name in ("fused", "history"):
        waits = [row for row in seen[:-1] if row[1] in (2, 4, 6)]
        assert waits
        assert all(row[3] == 1 and row[4] == row[5] == 0 for row in waits)
        # What remains is overestimated and underestimated, but not by much on average.
        starts = [row for row in seen if row[1] == 3]
        assert any(5 < row[5] < 30 for row in starts)


def test_without_phase():
    env = gym.make("PaceAssemblyNoPhase-v0").unwrapped
    assert env.observation_space.shape == (3,)
    assert env.reset(seed=0)[0].shape == (3,)


def test_rendering_as_text_and_as_a_picture(chair, capsys):
    env = gym.make("PaceAssembly-v0", scenario=chair, render_mode="human").unwrapped
    rollout(env, 0, lambda o: int(o[3] > 0.5))
    printed = capsys.readouterr().out
    assert "place_rails for 0.0 s, phase 0.00; assist?" in printed
    assert "assist:" in printed
    assert "finished: cost" in printed
    env = gym.make("PaceAssembly-v0", scenario=chair, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    begun = env.render()
    env.step(0)
    env.step(1)
    later = env.render()
    assert begun.shape == later.shape == (550, 1320, 3)
    assert begun.dtype == np.uint8
    assert (begun != later).mean() > 0.01
    assert len(np.unique(later.reshape(-1, 3), axis=0)) > 50
    # The phase is drawn, twice a second; a decision begins anew.
    times = [float(row["time"]) for row in env._events if row["kind"] == "phase"]
    assert len(times) > 20
    assert np.diff(times).max() < 1.0


def test_the_plant_level_gives_the_same_episode(chair):
    """One assistance with the Panda in its workcell: same observations, rewards and times as without."""
    runs = []
    for level in ("task", "plant"):
        env = gym.make("PaceAssembly-v0", scenario=chair, level=level).unwrapped
        rows = [env.reset(seed=5)[0].tolist()]
        for action in (0, 1):
            observation, reward, *_, info = env.step(action)
            rows.append([*observation.tolist(), reward, info["time"], info["duration"]])
        runs.append(rows)
    assert runs[0] == runs[1]


def test_mistakes(chair):
    for changes, message in (
        ({"level": "moon"}, "level must be one of task, plant"),
        ({"observation": "everything"}, "observation: must be one of none, paper, fused, history"),
        ({"render_mode": "ansi"}, "render_mode must be one of"),
        ({"split": "half"}, "human.split: must be one of"),
    ):
        with pytest.raises(pace_drake.errors.InputError, match=message):
            pace_drake.envs.assembly_env.PaceAssemblyEnv(chair, **changes)
    env = gym.make("PaceAssembly-v0", scenario=chair).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="an action is 0 or 1"):
        env.step(2)
