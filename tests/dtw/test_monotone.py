"""Monotone phase: no step back, none too fast, and nothing else changed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.dtw.baselines import ConstantPhase, TimeOnly
from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.dtw.monotone import Monotone
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract


class Told(Estimator):
    """Its phase is the last sample."""

    def __init__(self, sample_period=0.1):
        super().__init__(1, 2, sample_period)

    def initial_state(self):
        return np.zeros(2)

    def _step(self, state, sample):
        state[:] = state[0] + 1.0, sample[0]

    def phase_at(self, state):
        return float(state[1])

    def estimate_at(self, state):
        return Estimate(self.phase_at(state), 0.25, 0.5, state[0], 3.0)


def told(phases):
    return np.asarray(phases)[:, np.newaxis]


PHASES = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=40)


@given(phases=PHASES, max_rate=st.sampled_from([None, 0.01, 0.3, 5.0, 1e9]), period=st.sampled_from([0.1, 0.01]))
@settings(max_examples=60, deadline=None)
def test_never_back_and_never_too_fast(phases, max_rate, period):
    estimator = Monotone(Told(period), max_rate)
    assert_keeps_the_contract(estimator, told(phases), told(phases[::-1]))
    limited = estimator.phase(told(phases))
    steps = np.diff(limited, prepend=0.0)
    assert (steps >= 0.0).all()
    assert (steps <= (np.inf if max_rate is None else max_rate * period) + 1e-15).all()
    # As near to the inner phase as these two allow.
    highest = np.maximum.accumulate(phases)
    assert (limited <= highest).all()
    if max_rate is None:
        np.testing.assert_array_equal(limited, highest)


def test_a_phase_within_the_limits_is_not_touched():
    phases = np.linspace(0.0, 1.0, 41) ** 2
    np.testing.assert_array_equal(Monotone(Told(), 0.5).phase(told(phases)), phases)


def test_a_jump_is_caught_up_with_at_the_highest_rate():
    phases = [0.0, 0.5, 0.5, 0.5, 0.2, 0.2, 0.5, 0.5]
    np.testing.assert_allclose(
        Monotone(Told(), 2.0).phase(told(phases)), [0.0, 0.2, 0.4, 0.5, 0.5, 0.5, 0.5, 0.5], atol=1e-15
    )


def test_the_first_sample_is_limited_from_the_phase_before_it():
    assert Monotone(Told(), 2.0).phase([[1.0]])[0] == 0.2
    assert Monotone(ConstantPhase(1), 2.0).phase([[1.0]])[0] == 0.5


def test_only_the_phase_of_an_estimate_changes():
    phases = [0.0, 0.9, 0.1]
    estimates = Monotone(Told(), 1.0).estimates(told(phases))
    np.testing.assert_allclose(estimates.phase, [0.0, 0.1, 0.1])
    np.testing.assert_array_equal(estimates[1:], Told().estimates(told(phases))[1:])


def test_limits_may_be_nested():
    inner = Monotone(TimeOnly(1, [1.0, 2.0]), 0.5)
    assert_keeps_the_contract(Monotone(inner, 0.3), np.zeros((40, 1)), np.ones((5, 1)))


@pytest.mark.parametrize("max_rate", [0.0, -1.0, np.nan, np.inf, "fast"])
def test_bad_arguments_are_named(max_rate):
    with pytest.raises(InputError, match=r"^max_rate must be > 0"):
        Monotone(Told(), max_rate)


def test_a_bad_sample_changes_nothing():
    estimator = Monotone(Told(), 2.0)
    state = estimator.initial_state()
    estimator.step(state, [0.7])
    before = state.copy()
    with pytest.raises(InputError, match=r"^sample "):
        estimator.step(state, [np.nan])
    np.testing.assert_array_equal(state, before)
