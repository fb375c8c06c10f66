"""MedianPhase: the median of several phases."""

import numpy as np
import pytest

from pace_drake.dtw import MedianPhase, OpenEndSoftDTW, PhaseFilter
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract


def walk(seed, n):
    return np.cumsum(np.random.default_rng(seed).normal(size=(n, 3)), axis=0)


@pytest.fixture
def estimator():
    references = [walk(1, 40), walk(2, 55)]
    return MedianPhase([OpenEndSoftDTW(r, 0.5, d, 0.5) for r in references for d in ("wp", "derivative")])


def test_it_is_the_median(estimator):
    query = walk(3, 60)
    assert_keeps_the_contract(estimator, query, walk(4, 30))
    alone = [one.phase(query) for one in estimator.estimators]
    np.testing.assert_array_equal(estimator.phase(query), np.median(alone, axis=0))


def test_a_filter_stands_on_it(estimator):
    trials = [walk(k, 40 + k) for k in range(5, 10)]
    fused = PhaseFilter.fit(estimator, trials, 4.0)
    assert_keeps_the_contract(fused, walk(3, 60), walk(4, 30))


def test_mistakes():
    with pytest.raises(InputError, match="at least one"):
        MedianPhase([])
    one = OpenEndSoftDTW(walk(1, 40), 0.5, "wp", 0.5)
    for other, what in (
        (OpenEndSoftDTW(walk(1, 40)[:, :2], 0.5, "wp", 0.5), "num_axes"),
        (OpenEndSoftDTW(walk(1, 40), 0.5, "wp", 0.5, sample_period=0.2), "sample_period"),
    ):
        with pytest.raises(InputError, match=rf"estimators\[1\] must have the {what}"):
            MedianPhase([one, other])
