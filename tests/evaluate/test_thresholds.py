"""The search for thresholds."""

import numpy as np
import pytest

from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import play
from pace_drake.evaluate.thresholds import RULES, num_candidates, search_thresholds
from pace_drake.people import load_people
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario


@pytest.fixture(scope="module")
def world():
    scenario = load_scenario("ikea_chair", ("human.split=train",))
    rng = np.random.default_rng(0)
    pool = make_pool(scenario, load_people(scenario), 256, rng)
    return AssemblyTwin(scenario, pool, 1000), pool.sample(1000, rng)


@pytest.mark.parametrize("rule", RULES)
def test_it_finds_the_best_of_its_candidates(world, rule):
    twin, parts = world
    done = []
    found = search_thresholds(twin, parts, rule, done.append)
    assert done == list(range(1, num_candidates(rule) + 1))
    assert found.costs.shape == (num_candidates(rule), 3)
    assert found.cost == pytest.approx(found.costs.min(axis=0).sum())
    # The segments are searched at once, each by itself: together they cost what they cost alone.
    assert play(twin, parts, found.policy).cost.mean() == pytest.approx(found.cost, rel=0.01)
    given = make_policy(rule, twin.scenario)
    assert found.cost < 1.01 * play(twin, parts, given).cost.mean()
    assert set(found.thresholds) == {"place_rails", "place_screws", "tighten_screws"}
