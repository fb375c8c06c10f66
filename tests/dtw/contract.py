"""What every `Estimator` promises; the tests of each one call it."""

import numpy as np


def assert_keeps_the_contract(estimator, query, other):
    """Streaming equals batch bit for bit, phases are in [0, 1], and a state is the only memory.

    Args:
        estimator: any.
        query, other: two signals (m, d), (k, d), k >= 2.
    """
    phases, estimates = estimator.phase(query), estimator.estimates(query)
    assert phases.shape == (len(query),)
    assert ((phases >= 0.0) & (phases <= 1.0)).all()
    np.testing.assert_array_equal(estimates.phase, phases)
    np.testing.assert_array_equal(estimator.phases([other, query], num_threads=2)[1], phases)

    state, others_state = estimator.initial_state(), estimator.initial_state()
    assert state.shape == (estimator.num_states,)
    assert state.dtype == np.float64
    assert np.isfinite(estimator.phase_at(state))
    estimator.reset()
    for i, sample in enumerate(query):
        # A second action between two samples of the first, and a third one streamed.
        estimator.step(others_state, other[i % len(other)])
        estimator.step(state, sample)
        assert estimator.phase_at(state) == phases[i]
        np.testing.assert_array_equal(estimator.estimate_at(state), [values[i] for values in estimates])
        assert estimator.update(sample) == phases[i]
        before = state.copy()
        estimator.estimate_at(state)
        np.testing.assert_array_equal(state, before)  # to look is not to change
        if i == len(query) // 2:
            copy = before
    for sample in query[len(query) // 2 + 1 :]:
        estimator.step(copy, sample)
    np.testing.assert_array_equal(copy, state)
    np.testing.assert_array_equal(estimator.estimate, [values[-1] for values in estimates])
    estimator.reset()
    assert estimator.num_samples == 0
    assert estimator.estimate.phase == estimator.phase_at(estimator.initial_state())
