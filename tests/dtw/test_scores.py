"""Scores equal their definitions, written out sample by sample."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pace_drake.dtw.estimator import Estimate
from pace_drake.dtw.scores import (
    Score,
    extrapolated_remaining_time,
    linear_phase,
    mean_score,
    mean_squared_error,
    score,
)

phases = arrays(float, st.integers(2, 30), elements=st.floats(0.0, 1.0))


def test_the_true_phase_is_linear_from_0_to_1():
    assert linear_phase(5).tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]


@settings(max_examples=30, deadline=None)
@given(phases)
def test_a_score_equals_its_definition(z):
    m = len(z)
    errors = [z[i] - i / (m - 1) for i in range(m)]
    one = score(Estimate(z), 0.1)
    assert one.mse == pytest.approx(sum(e * e for e in errors) / m)
    assert one.mse == mean_squared_error(z)
    assert one.mae == pytest.approx(sum(abs(e) for e in errors) / m)
    assert one.bias == pytest.approx(sum(errors) / m, abs=1e-12)
    assert one.back_jumps == pytest.approx(sum(z[i] < z[i - 1] - 1e-12 for i in range(1, m)) / (m - 1))
    assert one.bias**2 <= one.mse + 1e-12
    assert math.isnan(one.coverage)


def test_a_perfect_estimate():
    truth = linear_phase(41)
    left = 4.0 * (1.0 - truth)
    perfect = score(Estimate(truth, remaining_time=left), 0.1, np.column_stack([left, left]))
    assert perfect == Score(0.0, 0.0, 0.0, 0.0, (0.0,) * 4, 1.0)


def test_the_remaining_time_is_read_at_the_fractions():
    left = 4.6 * (1.0 - linear_phase(47))  # 47 samples of 0.1 s
    predicted = left.copy()
    predicted[[12, 23, 34, 41]] += [1.0, -2.0, 3.0, -4.0]  # nearest to 11.5 (ties to even), 23, 34.5 and 41.4
    errors = score(Estimate(linear_phase(47), remaining_time=predicted), 0.1).remaining_time_error
    assert errors == pytest.approx((1.0, 2.0, 3.0, 4.0))


def test_who_predicts_no_remaining_time_is_given_the_obvious_prediction():
    slow = 0.5 * linear_phase(41)  # at half of the true rate: twice the time
    elapsed = 0.1 * np.arange(41)
    for none in (math.nan, np.full(41, math.nan)):
        errors = score(Estimate(slow, remaining_time=none), 0.1).remaining_time_error
        # Total 8 s instead of 4 s at every moment.
        assert errors == pytest.approx((4.0,) * 4)
    assert extrapolated_remaining_time(slow, elapsed)[20] == pytest.approx(8.0 - 2.0)
    assert np.isfinite(extrapolated_remaining_time(np.zeros(41), elapsed)).all()
    assert extrapolated_remaining_time(np.ones(1), np.array([3.0])) == 0.0


def test_coverage_allows_half_a_sample_period():
    truth = linear_phase(5)
    left = 0.4 * (1.0 - truth)
    intervals = np.column_stack([left, left]) + np.array([[0.0], [0.04], [-0.04], [0.06], [-0.06]])
    assert score(Estimate(truth), 0.1, intervals).coverage == pytest.approx(3 / 5)


def test_the_mean_of_scores():
    one = Score(0.1, 0.2, 0.3, 0.4, (1.0, 2.0, 3.0, 4.0), 0.5)
    other = Score(0.3, 0.4, -0.3, 0.0, (3.0, 2.0, 1.0, 0.0), 1.0)
    mean = mean_score([one, other])
    assert (mean.mse, mean.mae, mean.bias, mean.back_jumps) == pytest.approx((0.2, 0.3, 0.0, 0.2))
    assert mean.remaining_time_error == pytest.approx((2.0,) * 4)
    assert mean.coverage == pytest.approx(0.75)
    assert mean_score([one]) == one
