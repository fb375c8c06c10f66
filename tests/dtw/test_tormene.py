"""Against the libraries of others: dtw-python (Giorgino; Tormene et al. 2009) and stumpy's z-normalised distance."""

import dtw
import numpy as np
import pytest
import stumpy

from pace_drake.dtw import OpenEndSoftDTW


def walks(seed, *lengths, num_axes=3):
    rng = np.random.default_rng(seed)
    return [np.cumsum(rng.normal(size=(length, num_axes)), axis=0) for length in lengths]


def state_after(estimator, query):
    state = estimator.initial_state()
    for sample in query:
        estimator.step(state, sample)
    return state


@pytest.mark.parametrize("steps", ["symmetric2", "asymmetric"])
@pytest.mark.parametrize("lengths", [(40, 35), (10, 60), (60, 12), (1, 9), (2, 9)])
def test_the_open_end_is_that_of_dtw_python(steps, lengths):
    """dtw-python divides by i + j for symmetric2 and by i for asymmetric steps, as Tormene et al. do."""
    for seed in range(10):
        query, reference = walks(seed, *lengths)
        estimator = OpenEndSoftDTW(reference, 0.0, "euclidean", steps=steps, normalization="steps")
        for m in sorted({1, len(query) // 3 + 1, len(query)}):
            theirs = dtw.dtw(query[:m], reference, step_pattern=steps, open_end=True)
            state = state_after(estimator, query[:m])
            best = round(estimator.phase_at(state) * (len(reference) - 1))
            cost = estimator.accumulated_cost(state)[best]
            assert best == theirs.jmin
            assert cost == pytest.approx(theirs.distance, rel=1e-13)
            length = m if steps == "asymmetric" else m + best + 1
            assert cost / length == pytest.approx(theirs.normalizedDistance, rel=1e-13)


@pytest.mark.parametrize("steps", ["symmetric1", "symmetric2", "asymmetric"])
def test_all_costs_are_those_of_dtw_python(steps):
    """symmetric1 cannot be normalised, so that dtw-python offers no open end for it, but it shows its costs."""
    query, reference = walks(3, 40, 50)
    theirs = dtw.dtw(query, reference, step_pattern=steps, keep_internals=True, open_end=steps != "symmetric1")
    estimator = OpenEndSoftDTW(reference, 0.0, "euclidean", steps=steps)
    state = estimator.initial_state()
    for i, sample in enumerate(query):
        estimator.step(state, sample)
        row = np.nan_to_num(theirs.costMatrix[i], nan=np.inf)  # NaN: cells that cannot be reached
        np.testing.assert_allclose(estimator.accumulated_cost(state), row, rtol=1e-13)
        if steps != "asymmetric":
            assert estimator.phase_at(state) == row.argmin() / 49


@pytest.mark.slow  # stumpy compiles for some seconds
@pytest.mark.parametrize("window", [3, 10, 25])
def test_windowed_pearson_is_the_z_normalised_distance_squared(window):
    """delta_WP = sum over axes of d^2 / (2 w), d the z-normalised Euclidean distance of the two windows."""
    query, reference = walks(7, 60, 90)
    estimator = OpenEndSoftDTW(reference, window=window / 10)
    state = estimator.initial_state()
    for i, sample in enumerate(query):
        estimator.step(state, sample)
        if i < window - 1:
            continue
        d = [stumpy.mass(query[i + 1 - window : i + 1, axis], reference[:, axis]) for axis in range(3)]
        expected = np.sum(np.square(d), axis=0) / (2 * window)
        np.testing.assert_allclose(estimator.local_cost(state)[window - 1 :], expected, atol=1e-7)
