"""Phase from a probabilistic movement primitive (ProMP), after Maeda et al. 2017.

G. Maeda, M. Ewerton, G. Neumann, R. Lioutikov, J. Peters: Phase estimation for fast action recognition and trajectory
generation in human-robot collaboration. International Journal of Robotics Research 36 (13-14), 2017.

Differs from the paper:

- the phase is the mean over all durations, weighted by their posterior, instead of that of the likeliest one; so it
  comes with a standard deviation;
- durations are log-normal instead of normal, on a regular grid instead of drawn at random;
- a duration that has passed is out: samples only come while the action goes on;
- the weights' covariance is drawn towards its diagonal (after Gomez-Gonzalez et al. 2020, IEEE Transactions on
  Robotics 36 (2), "Adaptation and robust learning of probabilistic movement primitives"), as there are often fewer
  demonstrations than basis functions;
- axes are independent: their covariances of weights stand apart, which costs little where people differ in pace
  rather than in shape, and saves a factor d in time and in demonstrations needed;
- what the basis cannot follow counts as noise, but it is not white: its variance is multiplied by
  (1 + r) / (1 - r), r the correlation of successive residuals (the variance of a mean of a first-order autoregressive
  process). Otherwise samples that say the same count as so many witnesses, and the posterior settles on a wrong
  duration within seconds. On the synthetic people this is what makes the method work at all.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw.estimator import Estimate, Estimator, number, samples
from pace_drake.errors import InputError

#: Width of a basis function / distance of two. Wider ones are nearly dependent, and weights then mean little.
_WIDTH = 0.7

#: Ridge of the fit of one demonstration, per sample; basis functions are at most 1.
_RIDGE = 1e-6

#: Least standard deviation of the noise / root mean square of the demonstrations.
_LEAST_NOISE = 1e-3

#: Durations on the grid reach so many standard deviations of their logarithm to either side,
_NUM_STDS = 3.0
#: which is at least this: a handful of demonstrations of one person may agree by chance;
_LEAST_LOG_STD = 0.05
#: and at most this, a factor of 8 at 3 of them: one broken demonstration must not make the tables endless.
_MOST_LOG_STD = 0.7

#: A duration counts as passed only beyond rounding.
_ROUNDING = 1e-9


class _Gains(NamedTuple):
    """The part of one Kalman update that does not depend on what is observed, for the `num` longest durations."""

    basis: NDArray  # (num, K, 1) basis functions at the phase t / T
    gains: NDArray  # (num, d, K)
    variances: NDArray  # (num, d) of the innovations
    log_variances: NDArray  # (num,) summed over the axes


class ProMP(Estimator):
    """Posterior over the duration T of the action, given the samples so far; the phase is the mean of t / T.

    The model: a trajectory is a sum of K normalised Gaussian basis functions of the phase, its weights are normal with
    mean and covariance of the demonstrations (each fitted by ridge regression over its own linear phase), and samples
    carry normal noise. Under each duration on a grid the samples so far are then jointly normal. Their likelihood is
    kept up by one Kalman update of the weights a sample, which is exact. As gains and variances do not depend on the
    samples, they are computed once; a step costs O(num_durations d K).

    It knows absolute shape and size, unlike Windowed-Pearson: people who do the action elsewhere need `centred`.
    It assumes one constant speed per trial: a pause shifts all that follows, which only the spread of the weights
    takes up. So its standard deviations are too small: on the synthetic people 38 % of the errors of phase and
    remaining time lie within one, 66 % within two. Many cycles in one action need many basis functions: for 20
    repetitions of an exercise 20 are worse than elapsed time, 160 about equal to it. Memory: about
    8 num_durations d K (mean duration / sample_period) bytes.

    The state is [number of samples, first sample (d), log-posterior of the durations, mean weights].

    Args:
        demonstrations: each (m, d), m >= 2; at least 2.
        sample_period: [s] time between samples, of demonstrations and queries, > 0.
        num_basis: K >= 2, basis functions.
        num_durations: durations on the grid, >= 2; each of equal steps of ln T.
        centred: whether positions count from the first sample of each demonstration and query.
        correlated_noise: whether to allow for the correlation of residuals; False is as published.

    Attributes:
        durations: (num_durations,) [s] increasing.
        weight_mean: (d, K).
        weight_covariance: (d, K, K).
        noise_variance: (d,).

    Raises:
        InputError: an argument is out of range.
    """

    def __init__(
        self,
        demonstrations: Sequence[ArrayLike],
        sample_period: float,
        num_basis: int = 20,
        num_durations: int = 41,
        centred: bool = True,
        correlated_noise: bool = True,
    ) -> None:
        period = number(sample_period, "sample_period", "> 0 [s]", above=0.0)
        self.num_basis = _at_least_two(num_basis, "num_basis")
        num_durations = _at_least_two(num_durations, "num_durations")
        self.centred = centred
        paths = _checked_demonstrations(demonstrations)
        d = paths[0].shape[1]
        super().__init__(d, 1 + d + num_durations * (1 + d * self.num_basis), period)

        logs = np.log([(len(path) - 1) * period for path in paths])
        steps = np.linspace(-_NUM_STDS, _NUM_STDS, num_durations)
        self.durations = np.exp(logs.mean() + steps * logs.std(ddof=1).clip(_LEAST_LOG_STD, _MOST_LOG_STD))
        self._log_prior = -0.5 * steps**2
        if centred:
            paths = [path - path[0] for path in paths]
        self.weight_mean, self.weight_covariance, self.noise_variance = self._fit(paths, correlated_noise)
        self._steps = self._kalman_gains()

    def _fit(self, paths: list[NDArray], correlated_noise: bool) -> tuple[NDArray, NDArray, NDArray]:
        """Returns mean (d, K) and covariance (d, K, K) of the weights, and variance (d,) of the noise."""
        num, K, d = len(paths), self.num_basis, paths[0].shape[1]
        weights = np.empty((num, d, K))
        square, product, total = np.zeros(d), np.zeros(d), np.zeros(d)
        for path, of_path in zip(paths, weights, strict=True):
            basis = self.basis(np.linspace(0.0, 1.0, len(path)))
            ridge = _RIDGE * len(path) * np.eye(K)
            of_path[:] = np.linalg.solve(basis.T @ basis + ridge, basis.T @ path).T
            residual = path - basis @ of_path.T
            square += (residual**2).sum(axis=0)
            product += (residual[1:] * residual[:-1]).sum(axis=0)
            total += (path**2).sum(axis=0)
        mean = weights.mean(axis=0)
        deviation = weights - mean
        sample_covariance = np.einsum("ndk,ndl->dkl", deviation, deviation) / (num - 1)
        # As if K more demonstrations had shown weights that vary as much, but each by itself.
        diagonal = np.einsum("dkk->dk", sample_covariance)[:, :, np.newaxis] * np.eye(K)
        covariance = (num * sample_covariance + K * diagonal) / (num + K)

        num_samples = sum(len(path) for path in paths)
        variance = square / num_samples
        if correlated_noise:
            correlation = np.divide(product, square, out=np.zeros(d), where=square > 0.0).clip(min=0.0)
            variance *= (1.0 + correlation) / (1.0 - correlation)
        variance = np.maximum(variance, _LEAST_NOISE**2 * total.max() / num_samples)
        if not (variance > 0.0).all():
            raise InputError("demonstrations must move: all samples are equal, which tells nothing about the phase")
        return mean, covariance, variance

    def basis(self, phase: ArrayLike) -> NDArray:
        """Returns the basis functions (..., K) at phases (...): Gaussians over [0, 1] that sum to 1."""
        centres = np.linspace(0.0, 1.0, self.num_basis)
        width = _WIDTH / (self.num_basis - 1)
        gaussians = np.exp(-0.5 * ((np.asarray(phase)[..., np.newaxis] - centres) / width) ** 2)
        return gaussians / gaussians.sum(axis=-1, keepdims=True)

    def _kalman_gains(self) -> list[_Gains]:
        """What the update with sample 0, 1, ... needs, until the longest duration has passed."""
        covariance = np.repeat(self.weight_covariance[np.newaxis], self.durations.size, axis=0)
        steps: list[_Gains] = []
        while (first := self._num_passed(elapsed := len(steps) * self.sample_period)) < self.durations.size:
            basis = self.basis(np.minimum(elapsed / self.durations[first:], 1.0))
            now = covariance[first:]
            projected = np.einsum("hdkl,hl->hdk", now, basis)
            variances = np.einsum("hdk,hk->hd", projected, basis) + self.noise_variance
            gains = projected / variances[..., np.newaxis]
            now -= gains[..., np.newaxis] * projected[..., np.newaxis, :]
            steps.append(_Gains(basis[..., np.newaxis], gains, variances, np.log(variances).sum(axis=1)))
        return steps

    def initial_state(self) -> NDArray:
        """Returns a new state that has seen no sample: the prior."""
        state = np.zeros(self.num_states)
        _, log_posterior, weights = self._parts(state)
        log_posterior[:] = self._log_prior
        weights[:] = self.weight_mean
        return state

    def _step(self, state: NDArray, sample: NDArray) -> None:
        first_sample, log_posterior, weights = self._parts(state)
        step = int(state[0])
        if step == 0 and self.centred:
            first_sample[:] = sample
        state[0] += 1.0
        if step >= len(self._steps):  # later than all durations
            return
        basis, gains, variances, log_variances = self._steps[step]
        going_on = slice(self.durations.size - len(basis), None)
        innovations = sample - first_sample - (weights[going_on] @ basis)[..., 0]
        weights[going_on] += gains * innovations[..., np.newaxis]
        log_posterior[going_on] -= 0.5 * ((innovations**2 / variances).sum(axis=1) + log_variances)

    def phase_at(self, state: NDArray) -> float:
        """Returns the posterior mean of t / T; 1 when it is later than all durations."""
        elapsed, durations, posterior = self._posterior(state)
        return min(1.0, float(posterior @ (elapsed / durations))) if durations.size else 1.0

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns means and standard deviations under the posterior of the duration."""
        elapsed, durations, posterior = self._posterior(state)
        if not durations.size:
            return Estimate(1.0, 0.0, 0.0, 0.0, 0.0)
        duration, rate = float(posterior @ durations), float(posterior @ (1.0 / durations))
        duration_std = float(np.sqrt(posterior @ (durations - duration) ** 2))
        rate_std = float(np.sqrt(posterior @ (1.0 / durations - rate) ** 2))
        return Estimate(self.phase_at(state), elapsed * rate_std, rate, max(0.0, duration - elapsed), duration_std)

    def _parts(self, state: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Views of the first sample (d,), the log-posterior (num_durations,) and the weights (num_durations, d, K)."""
        d, num = self.num_axes, self.durations.size
        return state[1 : 1 + d], state[1 + d : 1 + d + num], state[1 + d + num :].reshape(num, d, self.num_basis)

    def _posterior(self, state: NDArray) -> tuple[float, NDArray, NDArray]:
        """Returns the elapsed time [s], the durations [s] that have not passed, and their probabilities."""
        elapsed = max(float(state[0]) - 1.0, 0.0) * self.sample_period
        first = self._num_passed(elapsed)
        log_posterior = self._parts(state)[1][first:]
        if not log_posterior.size:
            return elapsed, log_posterior, log_posterior
        likelihood = np.exp(log_posterior - log_posterior.max())
        return elapsed, self.durations[first:], likelihood / likelihood.sum()

    def _num_passed(self, elapsed: float) -> int:
        return int(np.searchsorted(self.durations, elapsed * (1.0 - _ROUNDING)))


def _checked_demonstrations(demonstrations: Sequence[ArrayLike]) -> list[NDArray]:
    paths = [
        samples(path, f"demonstrations[{k}]", (-1, -1), "an (m, d) array, one row per sample")
        for k, path in enumerate(demonstrations)
    ]
    if len(paths) < 2:
        raise InputError(f"demonstrations must be at least 2, to tell how they vary, got {len(paths)}")
    d = paths[0].shape[1]
    for k, path in enumerate(paths):
        if len(path) < 2 or path.shape[1] != d or d < 1:
            raise InputError(
                f"demonstrations[{k}] must have at least 2 samples, and as many axes as all, got shape {path.shape}"
            )
    return paths


def _at_least_two(value: object, name: str) -> int:
    as_float = number(value, name, "a whole number >= 2", least=2.0)
    if as_float != int(as_float):
        raise InputError(f"{name} must be a whole number >= 2, got {as_float:g}")
    return int(as_float)
