"""Several references: the one with the lowest cost gives the phase."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.dtw.several import SeveralReferences
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract


class Level(Estimator):
    """Stands for an alignment: the cost is the distance from a level so far, the phase a share of `length` samples."""

    distance, gamma, steps, normalization, pooled = "euclidean", 0.1, "symmetric1", "none", False

    def __init__(self, level, length=50, sample_period=0.1, num_axes=1, **settings):
        super().__init__(num_axes, 3, sample_period)
        self.level, self.length = level, length
        vars(self).update(settings)

    def initial_state(self):
        return np.array([0.0, np.inf, np.inf])

    def _step(self, state, sample):
        cost = abs(sample[0] - self.level) + (state[2] if state[0] else 0.0)
        state[:] = state[0] + 1.0, cost + self.length, cost

    def phase_at(self, state):
        return min(1.0, state[0] / self.length)

    def estimate_at(self, state):
        return Estimate(self.phase_at(state), 0.1, 1.0 / self.length, self.length - state[0], 2.0)

    def accumulated_cost(self, state):
        return state[1:]


@given(
    levels=st.lists(st.sampled_from([-1.0, 0.0, 0.5, 2.0]), min_size=1, max_size=4),
    seed=st.integers(0, 2**32),
    num_samples=st.integers(2, 60),
)
@settings(max_examples=50, deadline=None)
def test_follows_the_lowest_cost(levels, seed, num_samples):
    query = np.random.default_rng(seed).normal(size=(num_samples, 1))
    alignments = [Level(level, 30 + 5 * k) for k, level in enumerate(levels)]
    estimator = SeveralReferences(alignments)
    assert_keeps_the_contract(estimator, query, query[::-1])
    costs = np.array([np.cumsum(np.abs(query[:, 0] - level)) for level in levels])
    best = costs.argmin(axis=0)
    alone = np.array([one.phase(query) for one in alignments])
    np.testing.assert_array_equal(estimator.phase(query), alone[best, np.arange(num_samples)])
    state = estimator.initial_state()
    for i, sample in enumerate(query):
        estimator.step(state, sample)
        assert estimator.best(state) == best[i]
    last = [values[-1] for values in alignments[best[-1]].estimates(query)]
    np.testing.assert_array_equal(estimator.estimate_at(state), last)


def test_ties_and_the_state_before_any_sample_go_to_the_first():
    estimator = SeveralReferences([Level(1.0, 10), Level(1.0, 20), Level(1.0, 40)])
    state = estimator.initial_state()
    assert estimator.best(state) == 0
    estimator.step(state, [3.0])
    assert estimator.best(state) == 0
    assert estimator.phase_at(state) == 0.1


def test_the_lead_may_change():
    estimator = SeveralReferences([Level(0.0, 10), Level(1.0, 100)])
    np.testing.assert_array_equal(estimator.phase([[0.1], [0.1], [1.0], [1.0], [1.0]]), [0.1, 0.2, 0.3, 0.04, 0.05])


@pytest.mark.parametrize("distance", ["wp", "euclidean"])
def test_each_reference_is_found_again(distance):
    rng = np.random.default_rng(1)
    references = [np.cumsum(rng.normal(size=(num, 3)), axis=0) for num in (40, 60, 50)]
    alignments = [OpenEndSoftDTW(reference, 0.1, distance) for reference in references]
    estimator = SeveralReferences(alignments)
    for k, reference in enumerate(references):
        query = reference + 0.01 * rng.normal(size=reference.shape)
        assert_keeps_the_contract(estimator, query, references[0])
        state = estimator.initial_state()
        assert estimator.best(state) == 0
        for i, sample in enumerate(query):
            estimator.step(state, sample)
            assert i < 15 or estimator.best(state) == k
        np.testing.assert_array_equal(estimator.phase(query)[15:], alignments[k].phase(query)[15:])


@pytest.mark.parametrize(
    ("alignments", "message"),
    [
        ([], "^alignments must be at least one"),
        ([Level(0.0), Level(0.0, num_axes=2)], r"^alignments\[1\] must have the num_axes of alignments\[0\], 1, got 2"),
        ([Level(0.0), Level(0.0), Level(0.0, sample_period=0.2)], r"^alignments\[2\] must have the sample_period"),
        ([Level(0.0), Level(0.0, gamma=0.2)], r"^alignments\[1\] must have the gamma"),
        ([Level(0.0), Level(0.0, distance="wp")], r"^alignments\[1\] must have the distance"),
        ([Level(0.0), Level(0.0, steps="symmetric2")], r"^alignments\[1\] must have the steps"),
        ([Level(0.0), Level(0.0, normalization="max")], r"^alignments\[1\] must have the normalization"),
        ([Level(0.0), Level(0.0, pooled=True)], r"^alignments\[1\] must have the pooled"),
    ],
)
def test_bad_arguments_are_named(alignments, message):
    with pytest.raises(InputError, match=message) as error:
        SeveralReferences(alignments)
    assert "\n" not in str(error.value)
