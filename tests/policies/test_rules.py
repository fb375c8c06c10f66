"""Rule policies and policies by name."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.policies.factory import POLICIES, make_policy
from pace_drake.policies.rules import RemainingTimeThreshold, Threshold
from pace_drake.scenario import load_scenario


def observe(action, elapsed=0.0, phase=0.0):
    return np.array([1.0, action, elapsed, phase])


def test_explicit_query_assists_when_the_person_waits(chair):
    policy = make_policy("explicit_query", chair)
    assert [policy.decide(observe(j, 100, 1)) for j in range(1, 7)] == [0, 1, 0, 1, 0, 1]


def test_thresholds_per_action():
    policy = Threshold(2, (10.0, inf, inf, inf), frozenset({2, 4}))
    assert policy.decide(observe(1, 9.9)) == 0
    assert policy.decide(observe(1, 10.0)) == 1
    assert policy.decide(observe(3, 1e9)) == 0
    assert policy.decide(observe(4, 0.0)) == 1  # the person waits
    assert policy.decide(observe(1, nan)) == -1


def test_elapsed_and_phase_thresholds_read_their_element(chair):
    elapsed, phase = (make_policy(name, chair) for name in ("elapsed_threshold", "phase_threshold"))
    assert elapsed.decide(observe(1, elapsed=1e3, phase=0)) == 1
    assert elapsed.decide(observe(1, elapsed=0, phase=1)) == 0
    assert phase.decide(observe(1, elapsed=1e3, phase=0)) == 0
    assert phase.decide(observe(1, elapsed=0, phase=1)) == 1


@pytest.mark.parametrize("name", ["explicit", "Explicit-Query", "always", "elapsed", "phase", "never assist"])
def test_names_may_be_short(chair, name):
    make_policy(name, chair)


@pytest.mark.parametrize("name", ["", "nope", "e"])
def test_unknown_or_ambiguous_names(chair, name):
    with pytest.raises(InputError, match=r"unknown policy.*explicit_query, always_assist"):
        make_policy(name, chair)


def test_a_scenario_without_thresholds_says_so(chair):
    for name in ("elapsed_threshold", "phase_threshold"):
        with pytest.raises(InputError, match=name):
            make_policy(name, replace(chair, **{name: {}}))
    with pytest.raises(InputError, match="learned_policy"):
        make_policy("learned", replace(chair, learned_policy=""))


def test_every_policy_of_the_chair_can_be_made():
    scenario = load_scenario("ikea_chair")
    for name in POLICIES:
        assert make_policy(name, scenario).decide(observe(2, 1.0, 1.0)) in (0, 1)


def test_a_threshold_of_the_time_that_the_phase_says_remains():
    policy = RemainingTimeThreshold((10.0, 0.0, -inf), frozenset({2}))
    assert policy.decide(observe(1, 20.0, 0.5)) == 0  # 20 s remain
    assert policy.decide(observe(1, 20.0, 0.8)) == 1  # 5 s
    assert policy.decide(observe(1, 20.0, 2 / 3 + 1e-9)) == 1
    assert policy.decide(observe(1, 3.0, 0.0)) == 0  # nothing is known yet
    assert policy.decide(observe(3, 20.0, 1.0)) == 0  # never in that action
    assert policy.decide(observe(2, 0.0, 1.0)) == 1  # the person waits
    assert policy.decide(observe(1, 3.0, nan)) == -1
    assert policy.decide(observe(1, nan, 0.5)) == -1
