"""The resolutions of Eq. 3 case by case, rolling covariances against windows, and the arithmetic of soft minima."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from pace_drake.dtw import OpenEndSoftDTW, kernels
from tests.naive import naive_distance, naive_soft_min


def wp_rows(query, reference, window, pooled=False):
    """Windowed-Pearson distances (m, n); the window in samples."""
    query, reference = np.atleast_2d(query.T).T, np.atleast_2d(reference.T).T
    estimator = OpenEndSoftDTW(reference, window=window / 10, pooled=pooled)
    state = estimator.initial_state()
    rows = []
    for sample in query:
        estimator.step(state, sample)
        rows.append(estimator.local_cost(state))
    return np.array(rows)


def wp_row(query, reference, window):
    """Windowed-Pearson distances (n,) of the last sample of `query` to every sample of `reference`."""
    return wp_rows(query, reference, window)[-1]


@pytest.fixture
def signals():
    rng = np.random.default_rng(3)
    return rng.normal(size=(25, 3)), rng.normal(size=(18, 3))


@pytest.mark.parametrize("pooled", [False, True])
@pytest.mark.parametrize("window", [2, 3, 7, 18])
def test_every_cell_equals_the_naive_distance(signals, window, pooled):
    query, reference = signals
    rows = wp_rows(query, reference, window, pooled)
    for i in range(len(query)):
        naive = [naive_distance(query, reference, i, j, "wp", window, pooled) for j in range(len(reference))]
        np.testing.assert_allclose(rows[i], naive, rtol=0, atol=1e-11)


def test_one_sample_has_correlation_zero(signals):
    query, reference = signals
    np.testing.assert_array_equal(wp_row(query[:1], reference, 5), 3.0)
    assert wp_row(query, reference, 5)[0] == 3.0


def test_two_samples_correlate_by_exactly_plus_or_minus_one(signals):
    query, reference = signals
    assert set(wp_row(query[:2, 0], reference[:, 0], 5)[1:]) == {0.0, 2.0}
    assert set(wp_row(query[:, 0], reference[:, 0], 2)[1:]) == {0.0, 2.0}


@pytest.mark.parametrize("value", [0.0, 0.1, 1e6 + 0.1])
def test_flat_window_has_distance_one_whatever_the_other_side_is(value):
    flat, moving = np.full(12, value), np.sin(np.arange(12.0))
    np.testing.assert_array_equal(wp_row(flat, moving, 4), 1.0)
    np.testing.assert_array_equal(wp_row(moving, flat, 4), 1.0)
    np.testing.assert_array_equal(wp_row(flat, flat, 4), 1.0)  # not 0: that would make a whole row free


def test_a_hand_that_comes_to_rest_is_flat_exactly():
    rng = np.random.default_rng(4)
    reference = np.cumsum(rng.normal(size=40))
    query = np.cumsum(rng.normal(size=40)) + 1e5
    query[20:30] = query[20]
    rows = wp_rows(query, reference, 5)
    np.testing.assert_array_equal(rows[24:30, 4:], 1.0)
    assert (rows[23, 4:] != 1.0).all()
    assert (rows[30, 4:] != 1.0).all()


def test_flatness_is_exact_and_not_a_threshold():
    tiny = np.sin(np.arange(12.0)) * 1e-300
    row = wp_row(tiny, np.sin(np.arange(12.0)), 6)
    assert row[-1] == 0.0
    nearly_flat = np.full(12, 1.0)
    nearly_flat[-1] = np.nextafter(1.0, 2.0)
    assert wp_row(nearly_flat, nearly_flat, 6)[-1] == 0.0
    assert wp_row(tiny, tiny, 6)[-1] == 0.0


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
        pooled = wp_rows(-3.0 * reference[:13], reference, 5, pooled=True)
        assert (pooled >= 0.0).all()
        assert (pooled <= 2.0).all()


def rough_signal(kind, rng, num_samples):
    """What covariances that roll on have reason to fear."""
    walk = np.cumsum(rng.normal(size=(num_samples, 2)), axis=0)
    time = np.arange(num_samples)[:, np.newaxis]
    if kind == "quiet after loud":
        return walk * np.where(time % 60 > 30, 1e-8, 1.0)
    if kind == "rests with noise":
        for begin in range(20, num_samples, 70):
            rest = walk[begin : begin + 35]
            rest[:] = rest[0] + rng.normal(size=rest.shape) * 1e-3
        return walk
    if kind == "far away":
        return walk + np.array([1e3, 1e6])
    if kind == "a jump":
        return walk + 1e6 * (time > num_samples // 2)
    if kind == "a spike":
        return walk + 1e9 * (time == num_samples // 3)
    if kind == "dying out":
        return walk * np.exp(-time / 8.0)
    if kind == "small":  # squares still are numbers, but of few digits
        return walk * 1e-158
    if kind == "tiny":
        return walk * 1e-170
    if kind == "huge":
        return walk * 1e95
    return walk


KINDS = [
    "plain",
    "quiet after loud",
    "rests with noise",
    "far away",
    "a jump",
    "a spike",
    "dying out",
    "small",
    "tiny",
    "huge",
]


@pytest.mark.parametrize("kind", KINDS)
def test_distances_stay_within_their_bounds_though_covariances_have_errors(kind):
    signal = rough_signal(kind, np.random.default_rng(17), 200)
    for sign, same in ((1.0, 0.0), (-1.0, 4.0)):
        rows = wp_rows(sign * signal, signal, 3)
        assert (rows >= 0.0).all()
        assert (rows <= 4.0).all()
        # Never more than the rounding of distances away, though samples of rest may be flat, with distance 1.
        assert np.isin(np.round(np.diag(rows)[1:], 11), [same, 2.0, (same + 2.0) / 2.0]).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("window", [3, 10, 60])
def test_long_and_rough_signals_equal_their_windows(kind, window):
    rng = np.random.default_rng(17)
    for other in (kind, "plain"):
        query, reference = rough_signal(kind, rng, 200), rough_signal(other, rng, 120)
        for pooled in (False, True):
            rows = wp_rows(query, reference, window, pooled)
            for i in rng.integers(100, 200, 3):
                js = rng.integers(1, 120, 15)
                naive = [naive_distance(query, reference, i, j, "wp", window, pooled) for j in js]
                np.testing.assert_allclose(rows[i, js], naive, rtol=0, atol=1e-9)


def test_windows_of_two_tie_exactly_however_long_they_roll():
    query, reference = np.random.default_rng(5).normal(size=(2, 300, 1)) * np.geomspace(1.0, 1e-6, 300)[:, np.newaxis]
    assert set(np.unique(wp_rows(query, reference, 2)[1:, 1:])) == {0.0, 2.0}


# --- exp, log and the soft minimum in exponents of 2^512 ---


@njit
def costs_there_and_back(costs, gamma):
    """(weights, blocks, -gamma ln(weight * 2^(512 block))) of costs (n,)."""
    n = costs.size
    state = np.zeros(kernels.COST + 5 * n)
    state[kernels.COST : kernels.COST + n] = costs
    kernels._weigh(state, n, gamma)
    weights, blocks = state[kernels.COST + 3 * n : kernels.COST + 4 * n], state[kernels.COST + 4 * n :]
    state[kernels.COST + n : kernels.COST + 2 * n] = weights
    state[kernels.COST + 2 * n : kernels.COST + 3 * n] = blocks
    out = np.empty(n)
    kernels._write_costs(state, n, gamma, out)
    return weights, blocks, out


@njit
def soft_min(costs, gamma):
    """The soft minimum of three costs, as a cell of the recursion has it."""
    m, k, _ = costs_there_and_back(np.where(np.isfinite(costs), costs, 0.0), gamma)
    for a in range(3):
        if costs[a] == np.inf:
            m[a], k[a] = 0.0, -np.inf
    state = np.zeros(kernels.COST + 3)
    total, unit = kernels._cell(m[0], k[0], m[1], k[1], m[2], k[2], 1.0, 0.0)
    state[kernels.COST + 1], state[kernels.COST + 2] = total, unit
    out = np.empty(1)
    kernels._write_costs(state, 1, gamma, out)
    return out[0]


def test_exp_is_right_to_two_units_in_the_last_place():
    costs = np.concatenate([np.linspace(0.0, 700.0, 100_001), np.geomspace(1e-20, 1.0, 1001)])
    weights, blocks, _ = costs_there_and_back(costs, 1.0)
    right = np.array([math.exp(-cost) for cost in costs])
    got = np.ldexp(weights, (512 * blocks).astype(int))
    assert (np.abs(got - right) <= 2 * np.spacing(right)).all()


@pytest.mark.parametrize("gamma", [1e-100, 1e-6, 0.3, 1e3])
def test_log_inverts_exp_for_all_costs(gamma):
    costs = np.concatenate([[0.0], np.geomspace(1e-6, 1e200, 3001)])
    weights, _, back = costs_there_and_back(costs, gamma)
    assert ((weights >= 2.0**-257) & (weights <= 2.0**257)).all()
    np.testing.assert_allclose(back, costs, rtol=1e-15, atol=2e-16 * gamma)


@pytest.mark.parametrize("gamma", [1e-100, 0.01, 1.0, 50.0])
def test_soft_min_of_infinite_far_and_equal_costs(gamma):
    assert soft_min(np.full(3, np.inf), gamma) == np.inf
    for costs in [(3.0, 1.0, 2.0), (np.inf, 7.0, np.inf), (1e9, 0.0, -1e9), (4.0, 4.0, 4.0), (0.1, 0.2, 0.1)]:
        for k in range(3):
            rolled = (*costs[k:], *costs[:k])
            naive = naive_soft_min(rolled, gamma)
            assert soft_min(np.array(rolled), gamma) == pytest.approx(naive, rel=1e-14, abs=1e-15 * gamma)


@given(
    costs=st.lists(st.floats(0.0, 1e6), min_size=3, max_size=3),
    near=st.floats(0.0, 1e3),
    gamma=st.sampled_from([1e-6, 1e-3, 0.1, 1.0, 1e3]),
)
@settings(max_examples=300, deadline=None)
def test_soft_min_equals_the_naive_one(costs, near, gamma):
    for values in (costs, [costs[0], costs[0] + near * gamma, costs[2]]):
        naive = naive_soft_min(values, gamma)
        assert soft_min(np.array(values), gamma) == pytest.approx(naive, rel=1e-14, abs=1e-13 * gamma)
