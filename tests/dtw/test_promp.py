"""ProMP: the posterior against the full Gaussian of all samples, and phases of warped signals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from pace_drake.demos import generate_demonstrations
from pace_drake.dtw.baselines import TimeOnly
from pace_drake.dtw.promp import ProMP
from pace_drake.errors import InputError
from tests.dtw.contract import assert_keeps_the_contract


def signal(duration, period=0.1, offset=(0.0, 0.0), noise=0.0, seed=0):
    """Two smooth axes (m, 2) over a linear phase, the last sample at its end."""
    z = np.linspace(0.0, 1.0, round(duration / period) + 1)
    rng = np.random.default_rng(seed)
    shape = np.stack([np.sin(5.0 * z) + z, np.cos(9.0 * z) * (1.0 - 0.5 * z)], axis=1)
    return shape * rng.normal(1.0, 0.1, 2) + offset + rng.normal(0.0, noise, shape.shape)


def demonstrations(num=6, **keywords):
    return [signal(4.0 + 0.5 * k, seed=k, **keywords) for k in range(num)]


def naive_posterior(promp, query):
    """Probabilities (num_durations,): the likelihood of all samples at once under each duration."""
    m = len(query)
    query = query - query[0] if promp.centred else query
    log_posterior = np.full(promp.durations.size, -np.inf)
    steps = np.linspace(-3.0, 3.0, promp.durations.size)
    for h, duration in enumerate(promp.durations):
        if (m - 1) * promp.sample_period > duration * (1 + 1e-12):
            continue
        basis = promp.basis(np.arange(m) * promp.sample_period / duration)
        log_posterior[h] = -0.5 * steps[h] ** 2
        for axis in range(query.shape[1]):
            covariance = basis @ promp.weight_covariance[axis] @ basis.T + promp.noise_variance[axis] * np.eye(m)
            log_posterior[h] += multivariate_normal.logpdf(query[:, axis], basis @ promp.weight_mean[axis], covariance)
    likelihood = np.exp(log_posterior - log_posterior.max())
    return likelihood / likelihood.sum()


@pytest.mark.parametrize("keywords", [{}, {"centred": False}, {"correlated_noise": False, "num_basis": 7}])
def test_equals_the_full_gaussian_of_all_samples(keywords):
    promp = ProMP(demonstrations(noise=0.05), 0.1, num_durations=9, **keywords)
    query = signal(5.2, noise=0.05, seed=99)
    state = promp.initial_state()
    for i, sample in enumerate(query):
        promp.step(state, sample)
        p = naive_posterior(promp, query[: i + 1])
        phases, remaining = i * 0.1 / promp.durations, promp.durations - i * 0.1
        phase, rest = p @ phases, p @ remaining
        naive = [
            phase,
            np.sqrt(p @ (phases - phase) ** 2),
            p @ (1.0 / promp.durations),
            rest,
            np.sqrt(p @ (remaining - rest) ** 2),
        ]
        # Standard deviations are roots of what is nearly 0 once one duration is left.
        np.testing.assert_allclose(promp.estimate_at(state), naive, rtol=0, atol=1e-8)


def test_demonstrations_are_fitted():
    paths = demonstrations(num=8)
    promp = ProMP(paths, 0.1)
    z = np.linspace(0.0, 1.0, 50)
    mean = promp.basis(z) @ promp.weight_mean.T
    naive = np.mean([[np.interp(z, np.linspace(0, 1, len(p)), axis - axis[0]) for axis in p.T] for p in paths], axis=0)
    np.testing.assert_allclose(mean.T, naive, atol=0.02)
    weights = np.array(
        [np.linalg.lstsq(promp.basis(np.linspace(0, 1, len(p))), p - p[0], rcond=None)[0].T for p in paths]
    )
    np.testing.assert_allclose(promp.weight_mean, weights.mean(axis=0), atol=1e-3)
    for axis, covariance in enumerate(promp.weight_covariance):
        # Shrunk, 8 demonstrations against 20 basis functions; variances remain.
        of_weights = np.cov(weights[:, axis].T)
        shrunk = (8 * of_weights + 20 * np.diag(np.diag(of_weights))) / 28
        np.testing.assert_allclose(covariance, shrunk, atol=2e-2 * of_weights.max())
        np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
        assert np.linalg.eigvalsh(covariance).min() > 0.0
    np.testing.assert_allclose(promp.basis(z).sum(axis=1), 1.0)


def test_durations_reach_three_standard_deviations():
    logs = np.log([4.0 + 0.5 * k for k in range(6)])
    durations = ProMP(demonstrations(), 0.1, num_durations=13).durations
    np.testing.assert_allclose(np.log(durations), logs.mean() + np.linspace(-3, 3, 13) * logs.std(ddof=1))
    alike = ProMP([signal(4.0, seed=k) for k in range(3)], 0.1, num_durations=3).durations
    np.testing.assert_allclose(alike, 4.0 * np.exp([-0.15, 0.0, 0.15]))
    broken = ProMP([signal(0.1), signal(10.0)], 0.1, num_durations=3).durations
    np.testing.assert_allclose(broken, np.exp([-2.1, 0.0, 2.1]))


def test_a_duration_ends_with_its_last_sample():
    for tenths in range(21, 60):
        path = signal(0.1 * tenths)
        promp = ProMP([path, path * 1.01, path * 0.99], 0.1)
        assert promp.phase(path)[-1] == pytest.approx(1.0, abs=1e-3)
        assert promp.estimates(path).remaining_time[-1] == pytest.approx(0.0, abs=0.01)


def test_noise_is_found():
    promp = ProMP([signal(60.0 + k, noise=0.1, seed=k) for k in range(5)], 0.1)
    np.testing.assert_allclose(np.sqrt(promp.noise_variance), 0.1, rtol=0.15)
    # White noise has uncorrelated residuals: no more than chance to allow for.
    white = ProMP([signal(60.0 + k, noise=0.1, seed=k) for k in range(5)], 0.1, correlated_noise=False)
    np.testing.assert_allclose(promp.noise_variance, white.noise_variance, rtol=0.15)


def test_correlated_noise_is_allowed_for():
    paths = [signal(60.0 + k) for k in range(5)]
    rng = np.random.default_rng(3)
    for path in paths:
        noise = rng.normal(size=path.shape)
        for i in range(1, len(noise)):
            noise[i] = 0.5 * noise[i - 1] + np.sqrt(0.75) * noise[i]
        path += 0.1 * noise
    ratio = ProMP(paths, 0.1).noise_variance / ProMP(paths, 0.1, correlated_noise=False).noise_variance
    np.testing.assert_allclose(ratio, 3.0, rtol=0.25)  # (1 + 0.5) / (1 - 0.5), less what the basis takes up


@pytest.mark.parametrize("duration", [3.8, 5.0, 6.9])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (7.0, -3.0)])
def test_phase_of_a_warped_copy(duration, offset):
    paths = demonstrations(noise=0.01)
    promp, time_only = ProMP(paths, 0.1), TimeOnly(2, [(len(p) - 1) * 0.1 for p in paths])
    query = signal(duration, offset=offset, noise=0.01, seed=123)
    truth = np.linspace(0.0, 1.0, len(query))
    later = slice(len(query) // 4, None)
    error = np.abs(promp.phase(query) - truth)[later].max()
    assert error < 0.06
    assert error < 0.6 * np.abs(time_only.phase(query) - truth)[later].max()
    remaining = promp.estimates(query).remaining_time[later]
    np.testing.assert_allclose(remaining, (duration * (1.0 - truth))[later], atol=0.06 * duration)


def test_beats_time_alone_on_synthetic_people():
    data = generate_demonstrations(seed=7)
    train = [d.p_WH for d in data.split("train").of("place_screws")]
    queries = [d.p_WH for d in data.split("validation").of("place_screws")]

    def error(estimator):
        return np.mean([np.mean((estimator.phase(q) - np.linspace(0, 1, len(q))) ** 2) for q in queries])

    assert error(ProMP(train, 0.1)) < 0.3 * error(TimeOnly(3, [(len(path) - 1) * 0.1 for path in train]))
    assert error(ProMP(train, 0.1)) < 0.3 * error(ProMP(train, 0.1, correlated_noise=False))


@given(seed=st.integers(0, 2**32), num_samples=st.integers(2, 120), scale=st.sampled_from([1e-6, 1.0, 1e6]))
@settings(max_examples=25, deadline=None)
def test_contract_on_any_signal(seed, num_samples, scale):
    rng = np.random.default_rng(seed)
    promp = ProMP(demonstrations(num=3), 0.1, num_basis=6, num_durations=7)
    query = np.cumsum(rng.normal(size=(num_samples, 2)), axis=0) * scale
    assert_keeps_the_contract(promp, query, rng.normal(size=(5, 2)))


def test_estimates_before_the_first_sample_are_the_prior():
    promp = ProMP(demonstrations(), 0.1)
    estimate = promp.estimate
    assert (estimate.phase, estimate.phase_std) == (0.0, 0.0)
    logs = np.log([4.0 + 0.5 * k for k in range(6)])
    assert estimate.remaining_time == pytest.approx(np.exp(logs.mean() + logs.var(ddof=1) / 2), rel=0.01)


def test_later_than_all_durations_it_is_done():
    promp = ProMP(demonstrations(), 0.1)
    estimates = promp.estimates(np.zeros((300, 2)))
    late = np.arange(300) * 0.1 > promp.durations[-1]
    assert late.any()
    np.testing.assert_array_equal(np.array(estimates)[:, late].T, [[1.0, 0.0, 0.0, 0.0, 0.0]] * late.sum())


def test_a_constant_axis_is_no_trouble():
    still = [np.column_stack([path, np.full(len(path), 0.3)]) for path in demonstrations()]
    assert_keeps_the_contract(ProMP(still, 0.1), still[0], still[1])


GOOD = demonstrations(num=3)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"demonstrations": GOOD[:1]}, "demonstrations"),
        ({"demonstrations": []}, "demonstrations"),
        ({"demonstrations": [GOOD[0], GOOD[1][:1]]}, r"demonstrations\[1\]"),
        ({"demonstrations": [GOOD[0], GOOD[1][:, :1]]}, r"demonstrations\[1\]"),
        ({"demonstrations": [GOOD[0][:, :0], GOOD[1][:, :0]]}, r"demonstrations\[0\]"),
        ({"demonstrations": [GOOD[0], GOOD[1] * np.nan]}, r"demonstrations\[1\]"),
        ({"demonstrations": [GOOD[0] * 0.0, GOOD[1] * 0.0]}, "demonstrations"),
        ({"sample_period": 0.0}, "sample_period"),
        ({"num_basis": 1}, "num_basis"),
        ({"num_basis": 2.5}, "num_basis"),
        ({"num_durations": 1}, "num_durations"),
        ({"num_durations": "many"}, "num_durations"),
    ],
)
def test_bad_arguments_are_named(arguments, name):
    with pytest.raises(InputError, match=f"^{name} ") as error:
        ProMP(**({"demonstrations": GOOD, "sample_period": 0.1} | arguments))
    assert "\n" not in str(error.value)
