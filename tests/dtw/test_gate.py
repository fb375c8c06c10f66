"""Movement gate: what counts as rest, what passes, and what the inner estimator makes of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from pace_drake.demos import generate_demonstrations
from pace_drake.dtw.baselines import ConstantPhase, TimeOnly
from pace_drake.dtw.gate import MovementGate
from pace_drake.dtw.monotone import Monotone
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract


def counting(num_axes=3, num_samples=100, sample_period=0.1):
    """An estimator whose phase tells how many samples it has seen."""
    return TimeOnly(num_axes, [num_samples * sample_period], sample_period)


def num_passed(gate, query):
    """How many samples (m,) had passed at each sample."""
    return np.round(gate.phase(query) * gate.estimator.mean_duration / gate.sample_period).astype(int) + 1


def resting_hand(num_samples, seed=0, spikes=0.0):
    """A hand at rest (m, 3) [m] at 10 Hz: tremor of 1.5 mm (0.25 s), sensor noise of 1 mm, and perhaps spikes."""
    rng = np.random.default_rng(seed)
    decay = np.exp(-0.1 / 0.25)
    tremor = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], rng.normal(0.0, 0.0015, (num_samples, 3)), axis=0)
    path = tremor + rng.normal(0.0, 0.001, (num_samples, 3))
    path[rng.random(num_samples) < spikes] += 0.3
    return path


def stroke(num_samples, way=0.3):
    """A minimum-jerk reach (m, 3) [m] along x."""
    u = np.linspace(0.0, 1.0, num_samples)
    return np.outer(u**3 * (10.0 - 15.0 * u + 6.0 * u**2), [way, 0.0, 0.0])


@st.composite
def paths(draw):
    """Stretches of motion and rest, spikes, repeated samples; 1 to 9 axes."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    num_axes = draw(st.sampled_from([1, 2, 3, 9]))
    steps = [
        rng.normal(0.0, draw(st.sampled_from([0.0, 0.0005, 0.002, 0.05])), (draw(st.integers(1, 15)), num_axes))
        for _ in range(draw(st.integers(1, 6)))
    ]
    path = np.cumsum(np.concatenate(steps), axis=0)
    path[rng.random(len(path)) < 0.1] += 0.3
    return path


@given(path=paths(), rest_speed=st.sampled_from([0.005, 0.02, 0.1]), rest_time=st.sampled_from([0.1, 0.3, 0.5, 0.9]))
@settings(max_examples=60, deadline=None)
def test_contract(path, rest_speed, rest_time):
    path = np.concatenate([path, path[-1:]])
    gate = MovementGate(counting(path.shape[1], 1000), rest_speed, rest_time)
    assert_keeps_the_contract(gate, path, path[::-1] * 0.5)


@given(path=paths(), rest_time=st.sampled_from([0.1, 0.3, 0.5, 0.9]))
@settings(max_examples=60, deadline=None)
def test_rest_is_three_quarters_of_the_window_within_the_radius(path, rest_time):
    gate = MovementGate(ConstantPhase(path.shape[1]), 0.02, rest_time)
    window = round(rest_time / 0.1) + 1

    def spread(part):
        distances = np.linalg.norm(part - np.median(part, axis=0), axis=1)
        return np.sort(distances)[window - window // 4 - 1]

    radius = spread(0.02 * 0.1 * np.arange(window)[:, np.newaxis])
    for i, rests in enumerate(gate.resting(path)):
        if i < window - 1:
            assert not rests
        elif abs((extent := spread(path[i - window + 1 : i + 1])) - radius) > 1e-12:
            assert rests == (extent <= radius)


@given(path=paths())
@settings(max_examples=60, deadline=None)
def test_what_rests_is_withheld_and_what_moves_passes(path):
    gate = MovementGate(counting(path.shape[1], 1000), 0.02, 0.3)
    resting = gate.resting(path)
    passed = num_passed(gate, path)
    state = gate.initial_state()
    assert not gate.rests_at(state)
    for sample, rests in zip(path, resting, strict=True):
        gate.step(state, sample)
        assert gate.rests_at(state) == rests
    steps = np.diff(passed, prepend=0)
    assert (steps[resting] == 0).all()
    assert (steps[~resting] >= 1).all()
    assert passed[-1] <= len(path)


@pytest.mark.parametrize("period", [0.1, 0.05, 0.01])
@pytest.mark.parametrize("rest_time", [0.1, 0.3, 0.5, 1.0])
def test_a_straight_motion_rests_below_the_rest_speed_only(period, rest_time):
    gate = MovementGate(ConstantPhase(3, sample_period=period), 0.05, rest_time)
    times = np.arange(round(2.0 / period))[:, np.newaxis] * period
    direction = np.array([0.36, 0.48, -0.8])
    full = round(rest_time / period)
    assert gate.resting(0.0499 * times * direction + 7.0)[full:].all()
    assert not gate.resting(0.0501 * times * direction + 7.0).any()


def test_a_hand_that_circles_never_rests():
    times = np.arange(100)[:, np.newaxis] * 0.1
    for rate in (1.5, 2.0, 3.0, 10.0 / 3.0):  # [Hz] as when a screw looks for its hole
        angle = 2.0 * np.pi * rate * times
        circle = 0.012 * np.hstack([np.cos(angle), np.sin(angle), 0.0 * angle])
        assert not MovementGate(ConstantPhase(3)).resting(circle + resting_hand(100)).any()


@pytest.mark.parametrize(("spikes", "most"), [(0.0, 0.01), (0.02, 0.03)])
def test_tremor_noise_and_spikes_do_not_wake_it(spikes, most):
    path = resting_hand(5000, spikes=spikes)
    assert num_passed(MovementGate(counting(3, 10_000)), path)[-1] < most * len(path)


def test_a_spike_is_withheld_and_so_are_the_samples_after_it():
    path = np.zeros((40, 3))
    path[20] = 0.3
    passed = num_passed(MovementGate(counting()), path)
    assert passed[19] == passed[-1]


def test_falling_asleep_costs_a_few_samples():
    path = np.concatenate([stroke(11), np.repeat(stroke(11)[-1:], 50, axis=0)])
    passed = num_passed(MovementGate(counting()), path)
    assert passed[10] == 11
    assert passed[-1] <= 14


def test_waking_hands_on_the_motion_that_was_taken_for_a_spike():
    still = np.zeros((30, 3))
    jump = np.array([0.1, 0.2, 0.3])[:, np.newaxis] * [1.0, 0.0, 0.0]
    gate = MovementGate(Recording(), rest_time=0.5)
    path = np.concatenate([still, jump])
    passed = gate.phase(path) * 1000.0
    # Of the window of 6, one sample may lie anywhere: with the second the gate opens.
    assert (np.diff(passed)[10:29] == 0.0).all()
    np.testing.assert_allclose(np.diff(passed)[29:], [0.0, 0.1 + 0.2, 0.3])


@pytest.mark.parametrize("rest_time", [0.5, 0.9, 1.5])
def test_at_most_the_window_is_handed_on(rest_time):
    # Just below the rest speed, the newest sample of a long window is always outside, and always withheld.
    path = np.concatenate([np.arange(50) * 0.0019, 0.1 + np.arange(20) * 0.05])[:, np.newaxis] * [1.0, 0.0, 0.0]
    gate = MovementGate(counting(), rest_time=rest_time)
    passed = num_passed(gate, path)
    assert np.diff(passed)[40:48].max() == 0
    assert np.diff(passed).max() <= round(rest_time / 0.1) + 1
    assert_keeps_the_contract(gate, path, path)


class Recording(ConstantPhase):
    """Its phase is the sum of what it has seen, on the first axis, in thousandths."""

    def __init__(self):
        super().__init__(3)
        self.num_states = 1

    def initial_state(self):
        return np.zeros(1)

    def _step(self, state, sample):
        state[0] += sample[0]

    def phase_at(self, state):
        return state[0] / 1000.0


def test_estimates_are_the_inner_ones():
    inner = TimeOnly(3, [3.0, 4.0, 6.0])
    gate = MovementGate(inner)
    path = np.concatenate([stroke(20), resting_hand(30) + stroke(2)[-1], stroke(2)[-1] + stroke(20)])
    passed, estimates = num_passed(gate, path), gate.estimates(path)
    seen = inner.estimates(path)
    for values, inner_values in zip(estimates, seen, strict=True):
        np.testing.assert_array_equal(values, np.asarray(inner_values)[passed - 1])


def test_little_of_the_synthetic_actions_is_withheld():
    data = generate_demonstrations(seed=0)
    gate = MovementGate(ConstantPhase(3))
    for action, most in (("place_rails", 0.08), ("place_screws", 0.10), ("tighten_screws", 0.02)):
        withheld = np.concatenate([gate.resting(one.p_WH) for one in data.of(action)]).mean()
        assert 0.0 < withheld < most


@pytest.mark.parametrize("action", ["place_rails", "place_screws", "tighten_screws"])
def test_a_pause_drifts_by_less_than_a_tenth_of_nominal_speed(action):
    data = generate_demonstrations(seed=0)
    reference = data.reference(action).p_WH
    alignment = OpenEndSoftDTW(reference, 1.0, "wp", 0.9)
    gate = MovementGate(alignment)
    pause = 50  # [samples]

    def drifts(estimator):
        """Reference samples passed per sample of the pause, in pauses at three places of each trial."""
        for one in data.of(action)[3::4]:
            for middle in (0.3, 0.5, 0.7):
                # People pause where they are slow: near the middle, where the hand moves least.
                first = int(middle * one.num_samples) - 10
                speeds = np.linalg.norm(one.p_WH[first + 1 : first + 21] - one.p_WH[first - 1 : first + 19], axis=1)
                at = first + int(speeds.argmin())
                still = one.p_WH[at] + resting_hand(pause, seed=at)
                phases = estimator.phase(np.concatenate([one.p_WH[: at + 1], still, one.p_WH[at + 1 :]]))
                yield (phases[at + pause] - phases[at]) * (len(reference) - 1) / pause

    assert np.mean(list(drifts(alignment))) > 0.6
    assert np.mean(np.abs(list(drifts(gate)))) < 0.1


def test_composes_with_the_monotone_phase():
    path = np.concatenate([stroke(20), resting_hand(30) + stroke(2)[-1]])
    for inner in (counting(), OpenEndSoftDTW(stroke(30), 0.1)):
        assert_keeps_the_contract(Monotone(MovementGate(Monotone(inner, 0.5)), 0.05), path, path[::-1])


class TestOfReference:
    reference = np.concatenate([stroke(21), np.repeat(stroke(21)[-1:], 40, axis=0), stroke(21)[-1] + stroke(21)])

    def gate(self, reference=None, **keywords):
        reference = self.reference if reference is None else reference
        return MovementGate.of_reference(reference, lambda moving: counting(3, len(moving) - 1), **keywords)

    def test_contract(self):
        assert_keeps_the_contract(self.gate(), self.reference, self.reference[::-1])

    def test_phase_is_that_of_the_whole_reference_where_it_moves(self):
        gate = self.gate()
        resting = gate.resting(self.reference)
        assert 30 < resting.sum() < 50
        truth = np.arange(82) / 81.0
        phases = gate.phase(self.reference)
        last_moving = np.maximum.accumulate(np.where(resting, 0, np.arange(82)))
        np.testing.assert_allclose(phases, np.where(last_moving == 81, 1.0, truth[last_moving]), atol=1.5 / 81.0)
        assert phases[-1] == 1.0

    def test_a_reference_without_rests_changes_nothing(self):
        straight = np.outer(np.arange(40), [0.01, 0.0, 0.0])
        np.testing.assert_allclose(
            self.gate(straight).phase(straight), counting(3, 39).phase(straight), rtol=0, atol=1e-12
        )

    def test_a_rest_at_the_end_counts_as_done(self):
        reference = self.reference[:61]  # ends at rest
        gate = self.gate(reference)
        assert gate.phase(reference)[-1] == 1.0

    def test_errors(self):
        with pytest.raises(InputError, match=r"^reference must move"):
            self.gate(np.ones((1, 3)))
        with pytest.raises(InputError, match=r"^reference must be an"):
            self.gate(np.ones(3))
        with pytest.raises(InputError, match=r"^reference must be an"):
            self.gate(np.ones((30, 0)))
        with pytest.raises(InputError, match=r"^sample_period must be that of the estimator, 0\.1 s"):
            self.gate(sample_period=0.05)
        with pytest.raises(InputError, match=r"^reference has the value nan"):
            self.gate(self.reference * np.nan)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"rest_speed": 0.0}, "rest_speed"),
        ({"rest_speed": np.nan}, "rest_speed"),
        ({"rest_speed": "slow"}, "rest_speed"),
        ({"rest_time": 0.0}, "rest_time"),
        ({"rest_time": 0.09}, "rest_time"),
        ({"rest_time": np.inf}, "rest_time"),
    ],
)
def test_bad_arguments_are_named(arguments, name):
    with pytest.raises(InputError, match=f"^{name} must be") as error:
        MovementGate(counting(), **arguments)
    assert "\n" not in str(error.value)


def test_a_bad_sample_changes_nothing():
    gate = MovementGate(counting())
    state = gate.initial_state()
    gate.step(state, [0.1, 0.2, 0.3])
    before = state.copy()
    with pytest.raises(InputError, match=r"^sample "):
        gate.step(state, [np.nan, 0.0, 0.0])
    np.testing.assert_array_equal(state, before)
