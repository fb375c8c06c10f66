"""Evaluation during training: the best parameters are kept, patience ends, and no random number is used up."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from pace_drake.envs.pool import cached_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import Played, play
from pace_drake.learning import evaluator as module
from pace_drake.learning import ppo
from pace_drake.learning.evaluator import EVALUATION_SEED, Evaluator
from pace_drake.learning.export import export_policy
from pace_drake.learning.greedy import GreedyPolicy
from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo
from pace_drake.policies.learned import LearnedPolicy

SETTINGS = replace(TWIN_SETTINGS, steps=6_400, num_envs=40, rollout=16, batch_size=320, epochs=1, hidden=16, seed=2)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(ppo, "POOL_SIZE", 40)
    monkeypatch.setattr(module, "POOL_SIZE", 40)


def given(monkeypatch, costs):
    """Evaluations that come out as told."""
    left = iter(costs)

    def played(twin, parts, policy):
        assert isinstance(policy, GreedyPolicy)
        cost = np.full(len(parts), next(left))
        return Played(cost, cost, cost, cost, cost, cost)

    monkeypatch.setattr(module, "play", played)


def test_the_score_is_that_of_the_exported_file(chair, chair_people, tmp_path):
    """On the scenario's own split, on the same episodes in every training."""
    seen = []
    judge = Evaluator(chair, chair_people, 3_200, report=lambda *one: seen.append(one), episodes=60)
    model = train_ppo(chair, SETTINGS, backend="twin", evaluator=judge)
    assert seen == judge.history
    assert [decisions for decisions, _ in seen] == [3_200, 6_400]
    assert judge.best == min(seen, key=lambda one: one[1])
    path = tmp_path / "policy.onnx"
    export_policy(model, chair, chair_people, path, {})
    pool = cached_pool(chair, chair_people, 40, EVALUATION_SEED)
    parts = pool.sample(60, np.random.default_rng(EVALUATION_SEED))
    played = play(AssemblyTwin(chair, pool, 60), parts, LearnedPolicy(path, chair.task))
    assert played.cost.mean() == pytest.approx(judge.best[1], abs=1e-9)


def test_evaluations_do_not_change_the_training(chair, chair_people, monkeypatch):
    given(monkeypatch, [9.0, 8.0, 7.0, 6.0])  # so that the last parameters are the best
    judge = Evaluator(chair, chair_people, 1_600, episodes=4)
    with_it = train_ppo(chair, SETTINGS, backend="twin", evaluator=judge).policy.state_dict()
    assert [cost for _, cost in judge.history] == [9.0, 8.0, 7.0, 6.0]
    without = train_ppo(chair, SETTINGS, backend="twin").policy.state_dict()
    for name, value in without.items():
        assert np.array_equal(value.numpy(), with_it[name].numpy()), name


def test_the_best_parameters_are_returned(chair, chair_people, monkeypatch):
    """After 3,840 decisions the score was best: those of a training that ended there, by patience."""
    given(monkeypatch, [9.0, 8.0, 6.0, 7.0, 7.0])
    judge = Evaluator(chair, chair_people, 1_280, episodes=4)
    best = train_ppo(chair, SETTINGS, backend="twin", evaluator=judge)
    assert judge.best == (3_840, 6.0)
    assert best.num_timesteps == 6_400
    # The same training as it was then: it stops, because nothing improved at the third evaluation.
    given(monkeypatch, [9.0, 8.99, 8.98])
    patient = Evaluator(chair, chair_people, 1_280, patience=2, episodes=4)
    then = train_ppo(chair, SETTINGS, backend="twin", evaluator=patient)
    for name, value in best.policy.state_dict().items():
        assert np.array_equal(value.numpy(), then.policy.state_dict()[name].numpy()), name


@pytest.mark.parametrize(
    ("costs", "patience", "ends"),
    [
        ([9.0, 8.96, 8.96], 2, 3_840),  # 0.4 % better is no improvement
        ([9.0, 8.96, 8.92, 8.9, 8.8], 2, 6_400),  # 0.9 % better than the last improvement is one
        ([9.0, 9.5, 8.0, 9.0, 7.0], 2, 6_400),
        ([9.0, 9.0, 9.0, 9.0, 9.0], None, 6_400),
        ([9.0, 9.0], 1, 2_560),
    ],
)
def test_patience(chair, chair_people, monkeypatch, costs, patience, ends):
    given(monkeypatch, costs)
    judge = Evaluator(chair, chair_people, 1_280, patience, episodes=4)
    model = train_ppo(chair, SETTINGS, backend="twin", evaluator=judge)
    assert judge.history[-1][0] == ends
    # A training that ends early takes one more step of every environment, and is not evaluated twice.
    assert model.num_timesteps in (ends, ends + SETTINGS.num_envs)
