"""Open-end soft-DTW against Algorithm 1 done naively, its properties, and its errors."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.dtw import DISTANCES, NORMALIZATIONS, STEPS, OpenEndSoftDTW, kernels
from pace_drake.dtw.estimator import LARGEST, MAX_GAP, Estimator
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract
from tests.naive import naive_accumulated_cost, naive_length, naive_phase

GAMMAS = [0.0, 1e-6, 0.05, 1.0, 30.0]
#: [s] of the default sample period; windows below are in samples.
PERIOD = 0.1


def phase(query, reference, *, window=10, **settings):
    """Phases (m,) of a query; the window in samples."""
    return OpenEndSoftDTW(reference, window=window * PERIOD, **settings).phase(query)


def accumulated_costs(estimator, query):
    """R[i, 1..n] (m, n) after each sample."""
    state = estimator.initial_state()
    rows = []
    for sample in query:
        estimator.step(state, sample)
        rows.append(estimator.accumulated_cost(state))
    return np.array(rows)


def random_signal(rng, num_samples, num_axes):
    """A random walk or noise, with flat stretches, repeated stretches, and an offset and a scale per axis."""
    signal = rng.normal(size=(num_samples, num_axes))
    if rng.random() < 0.5:
        signal = np.cumsum(signal, axis=0)
    for _ in range(rng.integers(0, 4)):
        start, length = rng.integers(0, num_samples), rng.integers(1, 8)
        axis = rng.integers(0, num_axes)
        signal[start : start + length, axis] = signal[start, axis]  # one axis at rest
    if rng.random() < 0.5:
        at = rng.integers(0, num_samples)
        signal = np.repeat(signal, np.where(np.arange(num_samples) == at, 3, 1), axis=0)[:num_samples]
    return signal * rng.uniform(0.1, 3.0, num_axes) + rng.uniform(-5.0, 5.0, num_axes)


@st.composite
def problems(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    num_axes = draw(st.integers(1, 4))
    query = random_signal(rng, draw(st.integers(1, 30)), num_axes)
    reference = random_signal(rng, draw(st.integers(2, 30)), num_axes)
    if draw(st.booleans()):  # a stretch of the reference inside the query: costs of zero
        length = min(len(query), len(reference))
        query[:length] = reference[:length]
    if draw(st.booleans()):
        query = query + draw(st.sampled_from([1e3, -1e6]))
    return query, reference, draw(st.sampled_from(GAMMAS)), draw(st.integers(2, 40))


def assert_equals_algorithm_1(
    query, reference, gamma, distance, window, steps="symmetric1", normalization="none", pooled=False
):
    R = naive_accumulated_cost(query, reference, gamma, distance, window, steps, pooled)
    naive = naive_phase(query, reference, gamma, distance, window, steps, normalization, pooled=pooled)
    stream = OpenEndSoftDTW(
        reference, gamma, distance, window * PERIOD, steps=steps, normalization=normalization, pooled=pooled
    )
    batch = stream.phase(query)
    rows = accumulated_costs(stream, query)
    for i, sample in enumerate(query):
        streamed = stream.update(sample)
        assert streamed == stream.estimate.phase == batch[i]
        assert stream.num_samples == i + 1
        np.testing.assert_allclose(rows[i], R[i + 1, 1:], rtol=1e-9, atol=1e-9)
        # Equal phases, or two reference samples whose costs tie but for rounding.
        costs = [R[i + 1, j] / naive_length(i + 1, j, steps, normalization) for j in range(1, len(reference) + 1)]
        chosen = round(streamed * (len(reference) - 1))
        assert streamed == naive[i] or costs[chosen] - min(costs) < 1e-9 * (1.0 + abs(min(costs)))


@pytest.mark.parametrize("distance", DISTANCES)
@given(problem=problems())
@settings(max_examples=40, deadline=None)
def test_equals_algorithm_1(distance, problem):
    query, reference, gamma, window = problem
    assert_equals_algorithm_1(query, reference, gamma, distance, window)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("normalization", NORMALIZATIONS)
@given(problem=problems(), distance=st.sampled_from(DISTANCES), pooled=st.booleans())
@settings(max_examples=15, deadline=None)
def test_options_equal_algorithm_1_with_them(steps, normalization, problem, distance, pooled):
    query, reference, gamma, window = problem
    assert_equals_algorithm_1(query, reference, gamma, distance, window, steps, normalization, pooled)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("gamma", [1e-6, 1e-3, 1.0, 1e3])
def test_costs_of_any_size_keep_their_digits(steps, gamma):
    """Costs from 0 to 1e6 at once: exp(-cost / gamma) alone would be 0 from 745 gamma on."""
    rng = np.random.default_rng(21)
    reference = rng.normal(size=(40, 1)) * np.geomspace(1e-6, 1e4, 40)[:, np.newaxis]
    query = rng.permutation(reference)
    rows = accumulated_costs(OpenEndSoftDTW(reference, gamma, "sqeuclidean", steps=steps), query)
    naive = naive_accumulated_cost(query, reference, gamma, "sqeuclidean", steps=steps)[1:, 1:]
    assert naive[np.isfinite(naive)].max() > 1e6
    np.testing.assert_allclose(rows, naive, rtol=1e-12, atol=1e-12 * gamma)
    np.testing.assert_array_equal(rows.argmin(axis=1), naive.argmin(axis=1))


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("gamma", [0.0, 0.5])
def test_phase_equals_algorithm_1_on_noise(distance, gamma):
    rng = np.random.default_rng(11)
    for _ in range(10):
        query, reference = rng.normal(size=(35, 3)), rng.normal(size=(28, 3))
        np.testing.assert_array_equal(
            phase(query, reference, gamma=gamma, distance=distance, window=6),
            naive_phase(query, reference, gamma, distance, 6),
        )


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("gamma", [0.0, 1e-4])
def test_self_alignment_reaches_one(distance, steps, gamma):
    rng = np.random.default_rng(5)
    for num_samples in (2, 3, 60):
        signal = np.cumsum(rng.normal(size=(num_samples, 3)), axis=0)
        phases = phase(signal, signal, gamma=gamma, distance=distance, window=5, steps=steps)
        assert phases[-1] == 1.0
        if num_samples == 60:  # the first windows are too short to tell samples apart
            np.testing.assert_allclose(phases[10:], np.linspace(0, 1, 60)[10:], atol=1e-12)


def test_equal_costs_go_to_the_lowest_index():
    reference = np.array([[0.0], [1.0], [1.0], [1.0]])
    for gamma in (0.0, 1e-3):
        query = [[0.0], [1.0]]
        np.testing.assert_array_equal(phase(query, reference, gamma=gamma, distance="euclidean"), [0.0, 1 / 3])


@pytest.mark.parametrize("gamma", [0.0, 1e-3, 1.0, 1e3])
def test_normalised_costs_that_rounding_parts_go_to_the_lowest_index(gamma):
    """The first sample of "wp" costs the same everywhere, so that R[1, j] / max(1, j) does, too."""
    reference = np.random.default_rng(0).normal(size=(200, 3))
    assert phase(reference[:1], reference, gamma=gamma, normalization="max")[0] == 0.0


@pytest.mark.parametrize("distance", DISTANCES)
@given(problem=problems(), steps=st.sampled_from(STEPS), normalization=st.sampled_from(NORMALIZATIONS))
@settings(max_examples=40, deadline=None)
def test_phase_is_in_the_unit_interval(distance, problem, steps, normalization):
    query, reference, gamma, window = problem
    estimator = OpenEndSoftDTW(reference, gamma, distance, window * PERIOD, steps=steps, normalization=normalization)
    phases = estimator.phase(query)
    assert phases.shape == (len(query),)
    assert ((phases >= 0.0) & (phases <= 1.0)).all()


@pytest.mark.parametrize("gamma", [0.0, 0.3])
def test_windowed_pearson_ignores_offset_and_scale(gamma):
    rng = np.random.default_rng(8)
    reference = np.cumsum(rng.normal(size=(50, 3)), axis=0)
    query = np.cumsum(rng.normal(size=(70, 3)), axis=0)
    query[20:40, 1] = query[20, 1]  # an axis at rest stays at rest
    moved = query * [0.01, 7.0, 300.0] + [5.0, -80.0, 0.3]
    estimator = OpenEndSoftDTW(reference, gamma)
    np.testing.assert_array_equal(estimator.phase(query), estimator.phase(moved))
    np.testing.assert_allclose(
        accumulated_costs(estimator, query), accumulated_costs(estimator, moved), rtol=0, atol=1e-9
    )


def test_pooled_correlation_ignores_offsets_and_one_common_scale():
    rng = np.random.default_rng(8)
    reference, query = np.cumsum(rng.normal(size=(2, 50, 3)), axis=1)
    estimator = OpenEndSoftDTW(reference, 0.3, pooled=True)
    same, other = (accumulated_costs(estimator, query * scale + [5.0, -80.0, 0.3]) for scale in (7.0, [7.0, 1.0, 1.0]))
    np.testing.assert_allclose(accumulated_costs(estimator, query), same, rtol=0, atol=1e-9)
    assert not np.allclose(same, other)


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("steps", STEPS)
def test_small_gamma_tends_to_the_hard_minimum_from_below(distance, steps):
    rng = np.random.default_rng(9)
    reference, query = rng.normal(size=(30, 2)), rng.normal(size=(40, 2))

    def costs(gamma):
        return accumulated_costs(OpenEndSoftDTW(reference, gamma, distance, 0.5, steps=steps), query)[-1]

    hard = costs(0.0)
    gaps = [np.abs(costs(gamma) - hard).max() for gamma in (1.0, 0.1, 0.01, 1e-4, 1e-100)]
    assert (np.diff(gaps) < 1e-12).all()
    assert gaps[0] > 1.0
    assert gaps[-1] < 1e-9
    assert (costs(0.1) <= hard + 1e-12).all()


def test_symmetric1_is_biased_to_diagonals_and_symmetric2_is_not():
    """On costs that are all 1, every path to (i, j) of symmetric2 costs i + j - 1."""
    flat, moving = np.zeros((6, 1)), np.arange(9.0)[:, np.newaxis] ** 2
    i, j = np.mgrid[1:7, 1:10]
    for steps, costs in (("symmetric1", np.maximum(i, j)), ("symmetric2", i + j - 1)):
        np.testing.assert_array_equal(accumulated_costs(OpenEndSoftDTW(moving, steps=steps), flat), costs)


def test_asymmetric_steps_cannot_reach_beyond_twice_the_speed():
    rng = np.random.default_rng(2)
    rows = accumulated_costs(OpenEndSoftDTW(rng.normal(size=(20, 2)), 0.1, steps="asymmetric"), rng.normal(size=(8, 2)))
    i, j = np.mgrid[1:9, 1:21]
    np.testing.assert_array_equal(np.isfinite(rows), j <= 2 * i - 1)


def test_local_cost_is_that_of_the_last_sample():
    reference, query = np.random.default_rng(2).normal(size=(2, 20, 3))
    estimator = OpenEndSoftDTW(reference, 0.1, "euclidean")
    state = estimator.initial_state()
    np.testing.assert_array_equal(estimator.local_cost(state), np.inf)
    np.testing.assert_array_equal(estimator.accumulated_cost(state), np.inf)
    for sample in query:
        estimator.step(state, sample)
        np.testing.assert_allclose(estimator.local_cost(state), np.linalg.norm(reference - sample, axis=1), rtol=1e-15)


def test_derivatives_come_one_sample_late():
    """A slope is known at the second sample, in part, and at the third; offsets do not matter."""
    reference = np.arange(10.0)[:, np.newaxis] * 2.0
    estimator = OpenEndSoftDTW(reference, distance="derivative")
    state = estimator.initial_state()
    for sample, slope in (([7.0], 0.0), ([10.0], 3.0 / 4.0), ([13.0], 3.0), ([16.0], 3.0)):
        estimator.step(state, sample)
        np.testing.assert_array_equal(
            estimator.local_cost(state), np.abs(slope - np.array([0.0, 0.5, 2, 2, 2, 2, 2, 2, 2, 2]))
        )


def test_reset_forgets_everything():
    rng = np.random.default_rng(2)
    reference, query = rng.normal(size=(20, 3)), rng.normal(size=(30, 3))
    stream = OpenEndSoftDTW(reference, 0.1)
    assert (stream.estimate.phase, stream.num_samples) == (0.0, 0)
    first = [stream.update(sample) for sample in query]
    stream.reset()
    assert (stream.estimate.phase, stream.num_samples) == (0.0, 0)
    assert [stream.update(sample) for sample in query] == first


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("gamma", [0.0, 0.2])
@pytest.mark.parametrize("steps", STEPS)
def test_contract_of_estimators(distance, gamma, steps):
    rng = np.random.default_rng(4)
    reference, query, other = rng.normal(size=(25, 3)), rng.normal(size=(150, 3)), rng.normal(size=(13, 3))
    for normalization in NORMALIZATIONS:
        estimator = OpenEndSoftDTW(reference, gamma, distance, 0.6, steps=steps, normalization=normalization)
        assert_keeps_the_contract(estimator, query, other)


@pytest.mark.parametrize("distance", DISTANCES)
def test_a_copied_state_goes_on_as_the_original(distance):
    rng = np.random.default_rng(4)
    estimator = OpenEndSoftDTW(rng.normal(size=(25, 3)), 0.2, distance, 0.6)
    query = rng.normal(size=(40, 3))
    state = estimator.initial_state()
    assert state.shape == (estimator.num_states,)
    assert estimator.phase_at(state) == 0.0
    for sample in query[:15]:
        estimator.step(state, sample)
    copy = state.copy()  # as a cloned Context would
    other = estimator.initial_state()
    for sample, other_sample in zip(query[15:], query[:25], strict=True):
        estimator.step(state, sample)
        estimator.step(other, other_sample)
    for sample in query[15:]:
        estimator.step(copy, sample)
    np.testing.assert_array_equal(copy, state)
    np.testing.assert_allclose(
        estimator.accumulated_cost(state),
        naive_accumulated_cost(query, estimator.reference, 0.2, distance, 6)[-1, 1:],
        atol=1e-9,
    )


def test_many_queries_on_two_threads_give_the_same():
    rng = np.random.default_rng(12)
    estimator = OpenEndSoftDTW(rng.normal(size=(60, 3)), 0.5)
    queries = [rng.normal(size=(m, 3)) for m in rng.integers(1, 150, 40)]
    for one, other in zip(estimator.phases(queries), estimator.phases(queries, num_threads=2), strict=True):
        np.testing.assert_array_equal(one, other)


def test_settings_are_immutable_and_the_reference_is_its_own():
    reference = np.random.default_rng(0).normal(size=(10, 2))
    estimator = OpenEndSoftDTW(
        reference, 0.5, "wp", 0.7, sample_period=0.05, steps="symmetric2", normalization="max", pooled=True
    )
    before = estimator.reference.copy()
    reference[:] = 0.0
    np.testing.assert_array_equal(estimator.reference, before)
    with pytest.raises(ValueError, match="read-only"):
        estimator.reference[0, 0] = 1.0
    settings = {
        "gamma": 0.5, "distance": "wp", "window": 0.7, "steps": "symmetric2", "normalization": "max", "pooled": True
    }  # fmt: skip
    for name, value in settings.items():
        assert getattr(estimator, name) == value
        with pytest.raises(AttributeError):
            setattr(estimator, name, value)
    assert (estimator.num_axes, estimator.sample_period) == (2, 0.05)


def test_the_window_is_in_seconds():
    reference, query = np.random.default_rng(6).normal(size=(2, 30, 2))
    naive = naive_phase(query, reference, window=4)
    for window, sample_period in ((0.4, 0.1), (0.08, 0.02), (8.0, 2.0), (0.43, 0.1)):
        estimator = OpenEndSoftDTW(reference, window=window, sample_period=sample_period)
        np.testing.assert_array_equal(estimator.phase(query), naive)


def test_a_window_longer_than_the_reference_changes_nothing_and_costs_nothing():
    rng = np.random.default_rng(6)
    reference, query = rng.normal(size=(12, 2)), rng.normal(size=(30, 2))
    assert OpenEndSoftDTW(reference, window=10.0).num_states == OpenEndSoftDTW(reference, window=1.2).num_states
    for longer in (12, 13, 100):
        np.testing.assert_array_equal(
            phase(query, reference, window=longer), naive_phase(query, reference, window=longer)
        )
    assert OpenEndSoftDTW(reference, window=1e308, sample_period=1e-300).num_axes == 2


def test_read_only_lists_and_slices_are_samples_like_others():
    reference, query = np.random.default_rng(6).normal(size=(2, 12, 2))
    expected = phase(query, reference)
    fixed = query.copy()
    fixed.setflags(write=False)
    for same in (fixed, query.tolist(), np.asfortranarray(query), np.repeat(query, 2, axis=1)[:, ::2]):
        estimator = OpenEndSoftDTW(reference)
        assert [estimator.update(sample) for sample in same] == expected.tolist()
        np.testing.assert_array_equal(estimator.phase(same), expected)
    np.testing.assert_array_equal(phase(np.rint(query).astype(int), reference), phase(np.rint(query), reference))
    Estimator.step(estimator, estimator.initial_state(), fixed[0])  # as those that hold an alignment pass samples on
    assert len(kernels.step.signatures) == len(kernels.phases.signatures) == 1  # each would compile for seconds


def test_state_vector_of_another_estimator_is_refused():
    estimator = OpenEndSoftDTW(np.eye(3))
    with pytest.raises(ValueError, match="state must be a float64 vector of length"):
        estimator.step(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="contiguous and writable"):
        estimator.step(np.zeros(2 * estimator.num_states)[::2], np.zeros(3))
    for method in (estimator.phase_at, estimator.accumulated_cost, estimator.local_cost):
        with pytest.raises(ValueError, match="state must be a vector of length"):
            method(np.zeros(3))


# --- lost samples ---


@pytest.fixture
def walk():
    return np.cumsum(np.random.default_rng(13).normal(size=(40, 3)), axis=0)


def test_a_gap_is_bridged_by_interpolated_samples(walk):
    bridged, filled = OpenEndSoftDTW(walk, 0.3), OpenEndSoftDTW(walk, 0.3)
    times = np.arange(40) * PERIOD
    lost = {7, 12, 13, 20, 21, 22, 23}
    for i, sample in enumerate(walk):
        if i in lost:
            continue
        before = max(k for k in range(i + 1) if k not in lost and (k < i or k == 0))
        for k in range(before + 1, i):
            filled.update(sample * (k - before) / (i - before) + walk[before] * (i - k) / (i - before), times[k])
        phases = bridged.update(sample, times[i] + 0.02 * (i % 2)), filled.update(sample, times[i])
        assert phases[0] == phases[1]
        assert bridged.num_samples == filled.num_samples == i + 1


def test_too_long_a_gap_and_time_that_stands_still_change_nothing(walk):
    estimator, untouched = OpenEndSoftDTW(walk, 0.3), OpenEndSoftDTW(walk, 0.3)
    for i, sample in enumerate(walk[:20]):
        estimator.update(sample, i * PERIOD)
        untouched.update(sample, i * PERIOD)
    for time, message in (
        (1.9, "^time must increase"),
        (1.5, "^time must increase"),
        (1.9 + MAX_GAP + 2 * PERIOD, "^time jumps by 0.7 s"),
        (np.nan, "^time must be a finite number"),
    ):
        with pytest.raises(InputError, match=message):
            estimator.update(walk[20], time)
    with pytest.raises(InputError, match=r"^sample has the value nan"):
        estimator.update([0.0, np.nan, 0.0], 2.0)
    assert estimator.num_samples == 20
    for i, sample in enumerate(walk[20:], 20):
        assert estimator.update(sample, i * PERIOD) == untouched.update(sample, i * PERIOD)


def test_a_sample_without_a_time_is_no_end_of_a_gap(walk):
    timed, untimed = OpenEndSoftDTW(walk, 0.3), OpenEndSoftDTW(walk, 0.3)
    for k in range(5):
        timed.update(walk[k], 10.0 + k * PERIOD)
        untimed.update(walk[k])
    timed.update(walk[5])
    untimed.update(walk[5])
    assert timed.update(walk[6], 3.0) == untimed.update(walk[6])
    assert timed.num_samples == 7


# --- errors ---

GOOD = np.arange(12.0).reshape(4, 3) ** 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"reference": GOOD[:1]}, "^reference must have at least 2 samples"),
        ({"reference": GOOD[:, :0]}, "^reference must have at least 2 samples"),
        ({"reference": GOOD[:, 0]}, r"^reference must be an \(n, d\) array"),
        ({"reference": [[1.0, 2.0], [3.0]]}, r"^reference must be .* no array of numbers"),
        ({"reference": "rails"}, "^reference must be .* no array of numbers"),
        (
            {"reference": np.where(GOOD == 1.0, np.nan, GOOD)},
            r"^reference has the value nan at index \[0, 1\]",
        ),
        ({"reference": GOOD * 1e99}, r"^reference has the value .*e\+100"),
        ({"gamma": -0.1}, "^gamma must be a number >= 0"),
        ({"gamma": np.nan}, "^gamma must be a number"),
        ({"gamma": np.inf}, "^gamma must be a number"),
        ({"gamma": "soft"}, "^gamma must be a number"),
        ({"gamma": 1e-101}, "^gamma must be 0 or between"),
        ({"gamma": 1e101}, "^gamma must be 0 or between"),
        ({"window": 1}, "^window must hold at least 2 samples of 0.1 s, got 0.1 s"),
        ({"window": -5}, "^window must hold at least 2 samples"),
        ({"window": np.nan}, "^window must be a number"),
        ({"window": np.inf}, "^window must be a number"),
        ({"sample_period": 0.0}, "^sample_period must be > 0"),
        ({"sample_period": "slow"}, "^sample_period must be > 0"),
        ({"distance": "cosine"}, "^distance must be one of wp, euclidean, sqeuclidean, derivative, got 'cosine'"),
        ({"steps": "symmetricP05"}, "^steps must be one of symmetric1, symmetric2, asymmetric, got 'symmetricP05'"),
        ({"normalization": "mean"}, "^normalization must be one of none, max, steps, got 'mean'"),
        ({"query": GOOD[:0]}, "^query must have at least 1 sample"),
        ({"query": GOOD[:, :2]}, r"^query must be an \(m, 3\) array like the reference, got shape \(4, 2\)"),
        ({"query": np.where(GOOD == 4.0, np.inf, GOOD)}, r"^query has the value inf at index \[0, 2\]"),
    ],
)
def test_bad_input_is_named_in_one_line(arguments, message):
    with pytest.raises(InputError, match=message) as error:
        phase(**({"query": GOOD, "reference": GOOD} | arguments))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("sample", [[1.0, np.nan, 0.0], [1.0, 2.0], [[1.0, 2.0, 3.0]], None, "abc", [1.0, 2e100, 0.0]])
def test_a_bad_sample_changes_nothing(sample):
    stream = OpenEndSoftDTW(GOOD)
    stream.update(GOOD[0])
    state = stream.initial_state()
    stream.step(state, GOOD[0])
    before = state.copy()
    for take in (stream.update, lambda sample: stream.step(state, sample)):
        with pytest.raises(InputError, match=r"^sample "):
            take(sample)
    assert stream.num_samples == 1
    np.testing.assert_array_equal(state, before)
    assert stream.update(GOOD[1]) == phase(GOOD[:2], GOOD)[1]


def test_compiled_code_has_the_same_limit():
    assert kernels.LARGEST == LARGEST  # not imported: a cache of numba would not notice that it has changed


def test_import_does_not_need_drake():
    code = "import sys, pace_drake.dtw; assert not [m for m in sys.modules if m.startswith('pydrake')]"
    subprocess.run([sys.executable, "-c", code], check=True)
