"""The resolutions of Eq. 3 and of the soft minimum, case by case."""

import numpy as np
import pytest

from pace_drake.dtw.kernels import normalized_windows, soft_min, windowed_pearson_row
from tests.naive import naive_distance, naive_soft_min


def wp_row(query, reference, window):
    """Windowed-Pearson distances (n,) of the last sample of `query` to every sample of `reference`."""
    query, reference = np.atleast_2d(query.T).T, np.atleast_2d(reference.T).T
    axes = np.ascontiguousarray(reference.T, dtype=float)
    recent = np.full((query.shape[1], window), np.nan)  # what is not there must not be read
    last = query[-window:].T
    recent[:, window - last.shape[1] :] = last
    out = np.empty(axes.shape[1])
    windowed_pearson_row(recent, len(query), axes, normalized_windows(axes, window), out)
    return out


@pytest.fixture
def signals():
    rng = np.random.default_rng(3)
    return rng.normal(size=(25, 3)), rng.normal(size=(18, 3))


@pytest.mark.parametrize("window", [2, 3, 7, 18])
def test_every_cell_equals_the_naive_distance(signals, window):
    query, reference = signals
    for i in range(len(query)):
        naive = [naive_distance(query, reference, i, j, "wp", window) for j in range(len(reference))]
        np.testing.assert_allclose(wp_row(query[: i + 1], reference, window), naive, rtol=0, atol=1e-11)


def test_one_sample_has_correlation_zero(signals):
    query, reference = signals
    np.testing.assert_array_equal(wp_row(query[:1], reference, 5), 3.0)
    assert wp_row(query, reference, 5)[0] == 3.0


def test_two_samples_correlate_by_exactly_plus_or_minus_one(signals):
    query, reference = signals
    assert set(wp_row(query[:2, 0], reference[:, 0], 5)[1:]) == {0.0, 2.0}


@pytest.mark.parametrize("value", [0.0, 0.1, 1e6 + 0.1])
def test_flat_window_has_distance_one_whatever_the_other_side_is(value):
    flat, moving = np.full(12, value), np.sin(np.arange(12.0))
    np.testing.assert_array_equal(wp_row(flat, moving, 4), 1.0)
    np.testing.assert_array_equal(wp_row(moving, flat, 4), 1.0)
    np.testing.assert_array_equal(wp_row(flat, flat, 4), 1.0)  # not 0: that would make a whole row free


def test_flatness_is_exact_and_not_a_threshold():
    tiny = np.sin(np.arange(12.0)) * 1e-300
    row = wp_row(tiny, np.sin(np.arange(12.0)), 6)
    assert row[-1] == 0.0
    nearly_flat = np.full(12, 1.0)
    nearly_flat[-1] = np.nextafter(1.0, 2.0)
    assert wp_row(nearly_flat, nearly_flat, 6)[-1] == 0.0


def test_offset_far_above_the_motion_keeps_precision():
    motion = np.random.default_rng(0).normal(size=30)
    # 1e6 + x has an ulp of 1e-10; a difference of raw sums of squares would lose all but 4 digits.
    np.testing.assert_allclose(wp_row(motion + 1e6, motion, 10), wp_row(motion, motion, 10), atol=1e-9)


def test_distances_stay_within_their_bounds():
    rng = np.random.default_rng(1)
    for _ in range(50):
        reference = rng.normal(size=(20, 2))
        row = wp_row(-3.0 * reference[:13], reference, 5)
        assert (row >= 0.0).all()
        assert (row <= 4.0).all()


@pytest.mark.parametrize("gamma", [0.0, 1e-300, 0.01, 1.0, 50.0])
def test_soft_min_of_infinite_far_and_equal_costs(gamma):
    assert soft_min(np.inf, np.inf, np.inf, gamma) == np.inf
    for costs in [(3.0, 1.0, 2.0), (np.inf, 7.0, np.inf), (1e9, 0.0, -1e9), (4.0, 4.0, 4.0), (0.1, 0.2, 0.1)]:
        for k in range(3):
            rolled = (*costs[k:], *costs[:k])
            assert soft_min(*rolled, gamma) == pytest.approx(naive_soft_min(rolled, gamma), rel=1e-14)
