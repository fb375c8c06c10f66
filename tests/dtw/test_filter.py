import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.demos import synthetic_signals
from pace_drake.dtw.estimator import Estimator
from pace_drake.dtw.filter import Calibration, PhaseFilter
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.dtw.scores import FRACTIONS, extrapolated_remaining_time, linear_phase, mean_squared_error, score
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract
from tests.naive import naive_duration_posterior

CHAIR = Calibration(math.log(22.0), 0.25, (0.2, 0.05, -0.02), (-0.3, -0.1, 0.0), (0.5, 0.1, 0.05))


class Given(Estimator):
    """Its phase is the first value of the sample, so that tests can choose what the alignment says."""

    def __init__(self, num_axes=1):
        super().__init__(num_axes, num_states=1, sample_period=0.1)

    def initial_state(self):
        return np.zeros(1)

    def _step(self, state, sample):
        state[0] = sample[0]

    def phase_at(self, state):
        return float(state[0])


def curves_at(calibration, z):
    return [
        np.interp(z, np.linspace(0, 1, len(c)), c) for c in (calibration.offset, calibration.slope, calibration.std)
    ]


@settings(max_examples=30, deadline=None)
@given(num=st.integers(1, 400), z=st.floats(0.01, 1.0))
def test_posterior_equals_bayes_rule(num, z):
    dut = PhaseFilter(Given(), CHAIR)
    t = (num - 1) * 0.1
    T, p = naive_duration_posterior(z, t, CHAIR)

    def moments(values):
        mean = p @ values
        return mean, math.sqrt(max(p @ values**2 - mean**2, 0.0))

    phase, phase_std = moments(t / T)
    left, left_std = moments(T - t)
    estimate = [values[-1] for values in dut.estimates(np.full((num, 1), z))]
    np.testing.assert_allclose(estimate, [phase, phase_std, p @ (1 / T), left, left_std], rtol=2e-3, atol=1e-4)
    low, high = dut.remaining_time_intervals(np.full((num, 1), z), 0.8)[-1]
    for bound, tail in ((low, 0.1), (high, 0.9)):
        assert bound == pytest.approx(np.interp(tail, np.cumsum(p), T) - t, rel=2e-3, abs=2e-3)


def test_keeps_the_contract_of_estimators():
    rng = np.random.default_rng(0)
    reference = np.cumsum(rng.normal(size=(60, 2)), axis=0)
    dut = PhaseFilter(OpenEndSoftDTW(reference, 0.5, "wp", 0.5), CHAIR)
    assert_keeps_the_contract(dut, reference[::2], reference + rng.normal(size=(60, 2)))


def test_streaming_gives_the_batch_estimates_and_intervals():
    z = np.linspace(0.0, 1.0, 50)[:, np.newaxis]
    dut = PhaseFilter(Given(), CHAIR)
    batch, intervals = dut.estimates(z), dut.remaining_time_intervals(z)
    state = dut.initial_state()
    for i, sample in enumerate(z):
        dut.step(state, sample)
        assert tuple(dut.estimate_at(state)) == tuple(values[i] for values in batch)
        assert dut.remaining_time_interval(state) == tuple(intervals[i])


def test_rate_adapts_to_a_faster_person():
    """An alignment that lags the more the faster the person is (slope > 0): the lag is undone."""
    calibration = Calibration(math.log(20.0), 0.25, (0.0,), (-0.5,), (0.03,))
    T = 16.0
    t = np.arange(0.0, T, 0.1)
    z = (T / 20.0) ** 0.5 * t / T
    estimate = PhaseFilter(Given(), calibration).estimates(z[:, np.newaxis])
    k = int(0.75 * len(t))
    assert z[k] - 0.75 < -0.075
    assert abs(estimate.phase[k] - 0.75) < 0.02
    assert abs(estimate.rate[k] - 1 / T) < 0.05 / T
    assert abs(estimate.remaining_time[k] - (T - t[k])) < 0.5


def test_trusts_the_alignment_or_time_as_calibrated():
    z = np.linspace(0.0, 0.8, 120)[:, np.newaxis]
    blind = PhaseFilter(Given(), Calibration(math.log(22.0), 0.1, (0.0,), (0.0,), (50.0,))).estimates(z)
    sure = PhaseFilter(Given(), Calibration(math.log(22.0), 0.5, (0.0,), (0.0,), (0.001,))).phase(z)
    np.testing.assert_allclose(sure[20:], z[20:, 0], rtol=0.01)
    expected = 11.9 / 22.0 * math.exp(0.5 * 0.1**2)
    assert blind.phase[-1] == pytest.approx(expected, rel=1e-2)


def test_begins_with_the_distribution_of_durations_alone():
    dut = PhaseFilter(Given(), CHAIR)
    first = dut.estimate_at(dut.initial_state())
    mean = math.exp(CHAIR.duration_log_mean + 0.5 * CHAIR.duration_log_std**2)
    assert first.phase == 0.0
    assert first.phase_std == 0.0
    assert first.remaining_time == pytest.approx(mean)
    assert first.remaining_time_std == pytest.approx(mean * math.sqrt(math.expm1(CHAIR.duration_log_std**2)))


@settings(max_examples=30, deadline=None)
@given(z=st.floats(0.0, 1.0), num=st.integers(1, 30_000))
def test_estimates_stay_in_range_whatever_the_alignment_says(z, num):
    dut = PhaseFilter(Given(), CHAIR)
    state = np.array([z, float(num), z, max(num / 2, 1.0)])
    estimate = dut.estimate_at(state)
    assert np.isfinite(estimate).all()
    assert 0.0 <= estimate.phase <= 1.0
    assert min(estimate[1:]) >= 0.0
    low, high = dut.remaining_time_interval(state, 0.9)
    narrow_low, narrow_high = dut.remaining_time_interval(state, 0.5)
    assert 0.0 <= low <= narrow_low <= narrow_high <= high
    phase_low, phase_high = dut.phase_interval(state)
    assert 0.0 <= phase_low <= phase_high <= 1.0
    assert 0.0 <= dut.end_probability(state) <= 1.0


def test_end_probability_rises_past_the_end():
    dut = PhaseFilter(Given(), CHAIR)
    state = dut.initial_state()
    probabilities = []
    for z in np.minimum(np.arange(400) / 220.0, 1.0):
        dut.step(state, [z])
        probabilities.append(dut.end_probability(state))
    assert probabilities[110] < 1e-3
    assert 0.1 < probabilities[221] < 0.9
    assert probabilities[260] > 0.99
    assert (np.diff(probabilities[220:]) >= 0.0).all()


def people_of(calibration, rng, num):
    """z of people of the filter's own model with an error that is constant along the action, and their durations."""
    phases = []
    for _ in range(num):
        from_mean = rng.normal(0.0, calibration.duration_log_std)
        T = math.exp(calibration.duration_log_mean + from_mean)
        t = np.arange(0.0, T, 0.1)
        offset, slope, std = (curve[0] for curve in (calibration.offset, calibration.slope, calibration.std))
        lead = offset + slope * from_mean + rng.normal(0.0, std)
        phases.append(np.minimum(t / T * math.exp(-lead), 1.0))
    return phases


def test_calibration_recovers_what_the_people_are_like():
    truth = Calibration(math.log(30.0), 0.2, (0.1,), (0.3,), (0.05,))
    found = Calibration.fit(people_of(truth, np.random.default_rng(3), 400), 30.0, 0.1)
    assert found.duration_log_mean == pytest.approx(truth.duration_log_mean, abs=0.03)
    assert found.duration_log_std == pytest.approx(truth.duration_log_std, rel=0.1)
    middle = slice(4, 16)  # at the ends there is less than a kernel, and z is cut at 1
    np.testing.assert_allclose(found.offset[middle], 0.1, atol=0.02)
    np.testing.assert_allclose(found.slope[middle], 0.3, atol=0.06)
    np.testing.assert_allclose(found.std[middle], math.hypot(0.05, 0.02), rtol=0.15)


def test_intervals_cover_people_of_the_model():
    truth = Calibration(math.log(30.0), 0.25, (0.05,), (0.1,), (0.12,))
    dut = PhaseFilter(Given(), truth)
    covered = []
    for z in people_of(truth, np.random.default_rng(0), 400):
        intervals = dut.remaining_time_intervals(z[:, np.newaxis])
        k = len(z) // 2
        left = (len(z) - 1 - k) * 0.1
        covered.append(intervals[k, 0] <= left <= intervals[k, 1])
    assert 0.86 <= np.mean(covered) <= 0.94


def test_few_people_are_taken_to_show_less_than_the_whole_spread():
    phases = people_of(CHAIR, np.random.default_rng(0), 12)
    few, many = Calibration.fit(phases, 22.0, 0.1, num_people=3), Calibration.fit(phases, 22.0, 0.1, num_people=100)
    assert few.duration_log_std == pytest.approx(many.duration_log_std * math.sqrt((4 / 3) / 1.01))
    assert (np.array(few.std) > many.std).all()


def test_better_than_alignment_and_time_on_people_it_never_saw():
    """SYNTHETIC people, with the scenario's settings: what docs/estimator.md reports is not chance of one action."""
    settings_of = {"place_rails": (1.65, 0.9), "place_screws": (0.68, 0.8), "tighten_screws": (1.65, 0.9)}
    table, covered = [], []
    for action in (*synthetic_signals(2).actions, *synthetic_signals(3).actions):
        reference, others = action.train[-1], action.train[:-1]
        gamma, window = settings_of[action.action]
        alignment = OpenEndSoftDTW(reference.values, gamma, "wp", window)
        dut = PhaseFilter.fit(alignment, [s.values for s in others], (len(reference.values) - 1) * 0.1, 5)
        mean = np.mean([len(s.values) - 1 for s in action.train])
        for signal in action.heldout_people:
            m = len(signal.values)
            z, elapsed = alignment.phase(signal.values), np.arange(m) * 0.1
            at = [round(fraction * (m - 1)) for fraction in FRACTIONS]
            left = (elapsed[-1] - elapsed)[at]
            fused = score(dut.estimates(signal.values), 0.1, dut.remaining_time_intervals(signal.values))
            covered.append(fused.coverage)
            table.append(
                (
                    fused.mse,
                    mean_squared_error(z),
                    np.mean((np.minimum(np.arange(m) / mean, 1.0) - linear_phase(m)) ** 2),
                    np.mean(fused.remaining_time_error),
                    np.mean(np.abs(extrapolated_remaining_time(z, elapsed)[at] - left)),
                )
            )
    fused, alignment_alone, time_only, fused_left, alignment_left = np.mean(table, axis=0)
    assert fused < alignment_alone
    assert fused < time_only
    assert fused_left < alignment_left
    assert 0.8 < np.mean(covered) < 0.99


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Calibration(math.nan, 0.2, (0.0,), (0.0,), (0.1,)), "duration_log_mean"),
        (lambda: Calibration(3.0, 0.0, (0.0,), (0.0,), (0.1,)), "duration_log_std"),
        (lambda: Calibration(3.0, 0.2, (), (0.0,), (0.1,)), "offset"),
        (lambda: Calibration(3.0, 0.2, (0.0,), (math.inf,), (0.1,)), "slope"),
        (lambda: Calibration(3.0, 0.2, (0.0,), (0.0,), (0.1, 0.0)), "std"),
        (lambda: Calibration.fit([np.linspace(0, 1, 9)], 3.0, 0.1), "phases"),
        (
            lambda: Calibration.fit([np.linspace(0, 1, 9)] * 2, -22.0, 0.1),
            "reference_duration must be > 0 .s., got -22",
        ),
        (lambda: PhaseFilter.fit(Given(), [np.zeros((9, 1))] * 2, reference_duration=-22.0), "reference_duration"),
        (lambda: PhaseFilter.fit(Given(), [np.zeros((9, 1))], 3.0), "demonstrations must be at least 2 .*, got 1"),
        (lambda: PhaseFilter.fit(Given(), [], 3.0), "demonstrations must be at least 2 .*, got 0"),
        (lambda: PhaseFilter(Given(), CHAIR).remaining_time_interval(np.zeros(4), 1.0), "probability"),
        (lambda: PhaseFilter(Given(), CHAIR).update([math.nan]), "sample"),
    ],
)
def test_bad_input_is_named(make, name):
    with pytest.raises(InputError, match=name):
        make()
