"""Baselines: the constant, and elapsed time with its log-normal durations."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import lognorm

from pace_drake.dtw.baselines import ConstantPhase, TimeOnly
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract

QUERY = np.random.default_rng(0).normal(size=(30, 3))


@pytest.mark.parametrize(
    "estimator",
    [ConstantPhase(3), ConstantPhase(3, 0.2), TimeOnly(3, [1.0, 1.5, 2.5]), TimeOnly(3, [2.0]), TimeOnly(3, [2.0] * 3)],
)
def test_contract(estimator):
    assert_keeps_the_contract(estimator, QUERY, QUERY[::-2])


def test_constant_is_constant_even_before_the_first_sample():
    estimator = ConstantPhase(3, 0.3)
    assert (estimator.phase(QUERY) == 0.3).all()
    assert estimator.phase_at(estimator.initial_state()) == 0.3


def test_phase_is_elapsed_over_mean_duration():
    phases = TimeOnly(3, [1.0, 3.0], sample_period=0.25).phase(QUERY)
    np.testing.assert_allclose(phases, np.minimum(np.arange(30) * 0.25 / 2.0, 1.0), rtol=1e-15)


def given_exceeded(durations, elapsed, function):
    """E[function(T) | T > elapsed] by quadrature, T log-normal as fitted to the durations."""
    logs = np.log(durations)
    density = lognorm(s=logs.std(ddof=1), scale=np.exp(logs.mean()))
    end = max(elapsed, density.median()) * np.exp(12 * logs.std(ddof=1))
    breaks = np.geomspace(max(elapsed, density.median() * 1e-4), end, 40)
    total = sum(quad(lambda t: function(t) * density.pdf(t), a, b)[0] for a, b in pairwise(breaks))
    return total / density.sf(elapsed)


@pytest.mark.parametrize("num_samples", [0, 1, 2, 11, 25, 41])
def test_remaining_time_is_that_of_a_truncated_log_normal(num_samples):
    durations = [1.4, 2.0, 2.2, 3.1]
    estimator = TimeOnly(1, durations)
    state = estimator.initial_state()
    for _ in range(num_samples):
        estimator.step(state, [0.0])
    elapsed = max(num_samples - 1, 0) * 0.1
    estimate = estimator.estimate_at(state)
    mean = given_exceeded(durations, elapsed, lambda t: t)
    std = np.sqrt(given_exceeded(durations, elapsed, lambda t: (t - mean) ** 2))
    inverse = given_exceeded(durations, elapsed, lambda t: elapsed / t)
    phase_std = np.sqrt(given_exceeded(durations, elapsed, lambda t: (elapsed / t - inverse) ** 2))
    assert estimate.remaining_time == pytest.approx(mean - elapsed, rel=1e-6)
    assert estimate.remaining_time_std == pytest.approx(std, rel=1e-6)
    assert estimate.phase_std == pytest.approx(phase_std, rel=1e-6, abs=1e-12)
    assert estimate.rate == (1 / np.mean(durations) if estimate.phase < 1.0 else 0.0)


@given(
    durations=st.lists(st.floats(0.1, 1e3), min_size=2, max_size=6),
    elapsed=st.floats(0.0, 1e6),
)
@settings(max_examples=60, deadline=None)
def test_estimates_are_finite_however_late(durations, elapsed):
    estimator = TimeOnly(1, durations)
    state = np.array([elapsed / 0.1 + 1.0])
    estimate = estimator.estimate_at(state)
    assert np.isfinite(estimate).all()
    assert min(estimate) >= 0.0
    # More has passed, so the whole duration is expected to be longer.
    later = estimator.estimate_at(state * 1.1)
    assert later.remaining_time + 0.1 * (1.1 * state[0] - 1.0) >= (estimate.remaining_time + elapsed) * (1 - 1e-9)


def test_later_than_any_tail_can_tell_it_never_ends():
    estimate = TimeOnly(1, [1.0, 1.1]).estimate_at(np.array([1e6]))
    # Far beyond, T / t - 1 is exponential with mean sigma^2 / ln(t / median), to first order.
    sigma = np.log([1.0, 1.1]).std(ddof=1)
    expected = 1e5 * sigma**2 / np.log(1e5 / np.sqrt(1.1))
    assert estimate.remaining_time == pytest.approx(expected, rel=1e-2)
    assert estimate.remaining_time_std == pytest.approx(expected, rel=1e-2)


def test_equal_durations_leave_no_doubt():
    estimates = TimeOnly(3, [2.0, 2.0, 2.0]).estimates(QUERY)
    np.testing.assert_allclose(estimates.remaining_time, np.maximum(2.0 - np.arange(30) * 0.1, 0.0), atol=1e-7)
    np.testing.assert_allclose(estimates.remaining_time_std, 0.0, atol=1e-6)


def test_one_duration_gives_the_phase_only():
    estimates = TimeOnly(3, [2.0]).estimates(QUERY)
    assert np.isnan([estimates.phase_std, estimates.remaining_time, estimates.remaining_time_std]).all()
    assert (estimates.rate[:20] == 0.5).all()


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ConstantPhase(3, -0.1), "value"),
        (lambda: ConstantPhase(3, 1.1), "value"),
        (lambda: ConstantPhase(3, np.nan), "value"),
        (lambda: ConstantPhase(3, sample_period=0.0), "sample_period"),
        (lambda: TimeOnly(3, []), "durations"),
        (lambda: TimeOnly(3, [1.0, 0.0]), "durations"),
        (lambda: TimeOnly(3, [[1.0]]), "durations"),
        (lambda: TimeOnly(3, [np.inf]), "durations"),
        (lambda: TimeOnly(3, ["long"]), "durations"),
        (lambda: TimeOnly(3, [1.0], -0.1), "sample_period"),
        (lambda: TimeOnly(3, [1.0]).update([1.0]), "sample"),
    ],
)
def test_bad_arguments_are_named(make, name):
    with pytest.raises(InputError, match=f"^{name} ") as error:
        make()
    assert "\n" not in str(error.value)


def test_the_durations_are_its_own():
    durations = np.array([1.0, 2.0])
    estimator = TimeOnly(1, durations)
    durations[:] = 100.0
    assert estimator.durations.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        estimator.durations[0] = 3.0
