"""Open-end soft-DTW against Algorithm 1 done naively, its properties, and its errors."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.dtw import DISTANCES, OpenEndKernel, OpenEndSoftDTW, phase
from pace_drake.errors import InputError
from tests.naive import naive_accumulated_cost, naive_phase

GAMMAS = [0.0, 1e-6, 0.05, 1.0, 30.0]


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
    return query, reference, draw(st.sampled_from(GAMMAS)), draw(st.integers(2, 40))


@pytest.mark.parametrize("distance", DISTANCES)
@given(problem=problems())
@settings(max_examples=60, deadline=None)
def test_equals_algorithm_1(distance, problem):
    query, reference, gamma, window = problem
    R = naive_accumulated_cost(query, reference, gamma, distance, window)
    naive = naive_phase(query, reference, gamma, distance, window)
    batch = phase(query, reference, gamma=gamma, distance=distance, window=window)
    stream = OpenEndSoftDTW(reference, gamma=gamma, distance=distance, window=window)
    for i, sample in enumerate(query):
        streamed = stream.update(sample)
        assert streamed == stream.phase == batch[i]
        assert stream.num_samples == i + 1
        np.testing.assert_allclose(stream.accumulated_cost, R[i + 1, 1:], rtol=1e-9, atol=1e-9)
        # Equal phases, or two reference samples whose costs tie but for rounding.
        chosen = round(streamed * (len(reference) - 1))
        assert streamed == naive[i] or abs(R[i + 1, chosen + 1] - R[i + 1, 1:].min()) < 1e-9


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
@pytest.mark.parametrize("gamma", [0.0, 1e-4])
def test_self_alignment_reaches_one(distance, gamma):
    rng = np.random.default_rng(5)
    for num_samples in (2, 3, 60):
        signal = np.cumsum(rng.normal(size=(num_samples, 3)), axis=0)
        phases = phase(signal, signal, gamma=gamma, distance=distance, window=5)
        assert phases[-1] == 1.0
        if num_samples == 60:  # the first windows are too short to tell samples apart
            np.testing.assert_allclose(phases[10:], np.linspace(0, 1, 60)[10:], atol=1e-12)


def test_equal_costs_go_to_the_lowest_index():
    reference = np.array([[0.0], [1.0], [1.0], [1.0]])
    np.testing.assert_array_equal(phase([[0.0], [1.0]], reference, distance="euclidean"), [0.0, 1 / 3])


@pytest.mark.parametrize("distance", DISTANCES)
@given(problem=problems())
@settings(max_examples=40, deadline=None)
def test_phase_is_in_the_unit_interval(distance, problem):
    query, reference, gamma, window = problem
    phases = phase(query, reference, gamma=gamma, distance=distance, window=window)
    assert phases.shape == (len(query),)
    assert ((phases >= 0.0) & (phases <= 1.0)).all()


@pytest.mark.parametrize("gamma", [0.0, 0.3])
def test_windowed_pearson_ignores_offset_and_scale(gamma):
    rng = np.random.default_rng(8)
    reference = np.cumsum(rng.normal(size=(50, 3)), axis=0)
    query = np.cumsum(rng.normal(size=(70, 3)), axis=0)
    query[20:40, 1] = query[20, 1]  # an axis at rest stays at rest
    moved = query * [0.01, 7.0, 300.0] + [5.0, -80.0, 0.3]
    original, other = OpenEndSoftDTW(reference, gamma), OpenEndSoftDTW(reference, gamma)
    for sample, moved_sample in zip(query, moved, strict=True):
        assert original.update(sample) == other.update(moved_sample)
        np.testing.assert_allclose(original.accumulated_cost, other.accumulated_cost, rtol=0, atol=1e-9)


@pytest.mark.parametrize("distance", DISTANCES)
def test_small_gamma_tends_to_the_hard_minimum_from_below(distance):
    rng = np.random.default_rng(9)
    reference, query = rng.normal(size=(30, 2)), rng.normal(size=(40, 2))

    def costs(gamma):
        stream = OpenEndSoftDTW(reference, gamma, distance, 5)
        for sample in query:
            stream.update(sample)
        return stream.accumulated_cost

    hard = costs(0.0)
    gaps = [np.abs(costs(gamma) - hard).max() for gamma in (1.0, 0.1, 0.01, 1e-4, 1e-300)]
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[0] > 1.0
    assert gaps[-1] < 1e-9
    assert (costs(0.1) <= hard + 1e-12).all()


def test_reset_forgets_everything():
    rng = np.random.default_rng(2)
    reference, query = rng.normal(size=(20, 3)), rng.normal(size=(30, 3))
    stream = OpenEndSoftDTW(reference, 0.1)
    assert (stream.phase, stream.num_samples) == (0.0, 0)
    first = [stream.update(sample) for sample in query]
    stream.reset()
    assert (stream.phase, stream.num_samples) == (0.0, 0)
    assert [stream.update(sample) for sample in query] == first


@pytest.mark.parametrize("distance", DISTANCES)
def test_kernel_keeps_all_that_changes_in_the_vector(distance):
    rng = np.random.default_rng(4)
    kernel = OpenEndKernel(rng.normal(size=(25, 3)), 0.2, distance, 6)
    query = rng.normal(size=(40, 3))
    state = kernel.initial_state()
    assert state.shape == (kernel.num_states,)
    assert kernel.phase(state) == 0.0
    for sample in query[:15]:
        kernel.update(state, sample)
    copy = state.copy()  # as a cloned Context would
    other = kernel.initial_state()
    for sample, other_sample in zip(query[15:], query[:25], strict=True):
        kernel.update(state, sample)
        kernel.update(other, other_sample)
    for sample in query[15:]:
        kernel.update(copy, sample)
    np.testing.assert_array_equal(copy, state)
    assert kernel.num_samples(state) == 40
    assert np.shares_memory(kernel.accumulated_cost(state), state)
    np.testing.assert_allclose(
        kernel.accumulated_cost(state),
        naive_accumulated_cost(query, kernel.reference, 0.2, distance, 6)[-1, 1:],
        atol=1e-9,
    )


def test_kernel_is_immutable_and_keeps_its_own_reference():
    reference = np.random.default_rng(0).normal(size=(10, 2))
    kernel = OpenEndKernel(reference)
    before = kernel.reference.copy()
    reference[:] = 0.0
    np.testing.assert_array_equal(kernel.reference, before)
    with pytest.raises(ValueError, match="read-only"):
        kernel.reference[0, 0] = 1.0
    with pytest.raises(AttributeError):
        kernel.gamma = 1.0  # type: ignore[misc]


def test_a_window_longer_than_the_reference_changes_nothing_and_costs_nothing():
    rng = np.random.default_rng(6)
    reference, query = rng.normal(size=(12, 2)), rng.normal(size=(30, 2))
    assert OpenEndKernel(reference, window=100).num_states == OpenEndKernel(reference, window=12).num_states
    for longer in (12, 13, 100):
        np.testing.assert_array_equal(
            phase(query, reference, window=longer), naive_phase(query, reference, window=longer)
        )


def test_state_vector_of_another_kernel_is_refused():
    kernel = OpenEndKernel(np.eye(3))
    with pytest.raises(ValueError, match="state must be a float64 vector of length"):
        kernel.update(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="contiguous and writable"):
        kernel.update(np.zeros(2 * kernel.num_states)[::2], np.zeros(3))


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
        ({"reference": GOOD * 1e99}, "^reference has the value .*e\\+100"),
        ({"gamma": -0.1}, "^gamma must be finite and >= 0"),
        ({"gamma": np.nan}, "^gamma must be finite"),
        ({"gamma": np.inf}, "^gamma must be finite"),
        ({"gamma": "soft"}, "^gamma must be a number"),
        ({"window": 1}, "^window must be at least 2"),
        ({"window": 2.5}, "^window must be a whole number"),
        ({"distance": "cosine"}, "^distance must be one of euclidean, sqeuclidean, wp, got 'cosine'"),
        ({"query": GOOD[:0]}, "^query must have at least 1 sample"),
        ({"query": GOOD[:, :2]}, r"^query must be an \(m, 3\) array like the reference, got shape \(4, 2\)"),
        ({"query": np.where(GOOD == 4.0, np.inf, GOOD)}, r"^query has the value inf at index \[0, 2\]"),
    ],
)
def test_bad_input_is_named_in_one_line(arguments, message):
    with pytest.raises(InputError, match=message) as error:
        phase(**({"query": GOOD, "reference": GOOD} | arguments))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("sample", [[1.0, np.nan, 0.0], [1.0, 2.0], [[1.0, 2.0, 3.0]], None, "abc"])
def test_a_bad_sample_changes_nothing(sample):
    stream = OpenEndSoftDTW(GOOD)
    stream.update(GOOD[0])
    before = stream.accumulated_cost
    with pytest.raises(InputError, match=r"^sample "):
        stream.update(sample)
    assert stream.num_samples == 1
    np.testing.assert_array_equal(stream.accumulated_cost, before)


def test_import_does_not_need_drake():
    code = "import sys, pace_drake.dtw; assert not [m for m in sys.modules if m.startswith('pydrake')]"
    subprocess.run([sys.executable, "-c", code], check=True)
