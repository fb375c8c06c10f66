"""A Bayesian filter over phase and rate: what the motion says and what the time says, fused.

Alignment alone is biased in a way that is the same for most people (they lead or lag the reference), it lags for
people who are faster than the reference, and it does not say how sure it is. Time alone is right on average and
knows nothing of this person. The filter learns from demonstrations how far each is to be trusted, and weighs them.

The model. An action takes T seconds, and the true phase is s = t / T (rate 1 / T). Over people, log T is normal: the
prior. When the alignment says z after t seconds, the duration that it implies is t / z, with

    log(t / z) = log T + offset(z) + slope(z) (log T - mean) + error,    error ~ N(0, std(z)^2)

The offset is how people lead or lag the reference at this phase, the slope how much more so the slower ones: this is
how the lag of fast people is undone. The error is large where an alignment has little to go by, as at the beginning.
All three are curves over z, learnt from demonstrations. The posterior of log T is then normal, and truncated, as the
action still goes on (T > t); everything follows from it in closed form: mean and spread of phase, rate and remaining
time, and intervals.

The newest z is all that is used of the motion: the alignment's row is the memory of all samples before it. (A filter
that fits one rate to all z so far, with correlated errors, was tried first; it did worse than the newest z on most
sets, as the errors of an alignment are a walk rather than noise about a line.)

Fusing a distribution of durations with the likelihood of an alignment is ours; the paper leaves the prediction of
completion times to future work.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from pace_drake.dtw.duration import moment_beyond, quantile_beyond, spread_beyond
from pace_drake.dtw.estimator import Estimate, Estimator, number
from pace_drake.errors import InputError

_LEVELS = np.linspace(0.0, 1.0, 21)  # of z, at which `Calibration.fit` learns the curves
_BANDWIDTH = 0.07  # [phase] of the Gaussian kernel with which it does
_SLOPE_SHRINKAGE = 0.5  # how many people's worth of evidence says that the offset does not depend on the duration
_LEAST_STD = 0.02  # of log T: no few demonstrations show less
_LEAST_PHASE = 1 / 200  # an alignment that has not moved implies a duration of this many times t at most


@dataclass(frozen=True)
class Calibration:
    """What the filter has learnt about the people and the alignment of one action.

    The curves are linear between values that are evenly spaced over z in [0, 1]; a single value is a constant.

    Attributes:
        duration_log_mean: mean of log T [log s] over people.
        duration_log_std: standard deviation of log T.
        offset: curve; by how much log(t / z) exceeds log T for a person of average duration.
        slope: curve; by how much more, per unit of log T.
        std: curve; standard deviation of log(t / z) about that.

    Raises:
        InputError: a value is out of range; the message names it.
    """

    duration_log_mean: float
    duration_log_std: float
    offset: tuple[float, ...]
    slope: tuple[float, ...]
    std: tuple[float, ...]

    def __post_init__(self) -> None:
        number(self.duration_log_mean, "duration_log_mean", "a finite number")
        number(self.duration_log_std, "duration_log_std", "> 0", above=0.0)
        for name, least in (("offset", -math.inf), ("slope", -math.inf), ("std", 0.0)):
            curve = getattr(self, name)
            if not curve:
                raise InputError(f"{name} must have at least one value")
            checked = tuple(
                number(value, name, f"finite values{' > 0' * (name == 'std')}", above=least) for value in curve
            )
            object.__setattr__(self, name, checked)

    @classmethod
    def fit(
        cls, phases: Sequence[NDArray], reference_duration: float, sample_period: float, num_people: int | None = None
    ) -> "Calibration":
        """Learns from the phases that an estimator gave for whole demonstrations of the action.

        Args:
            phases: (m_k,) each, in [0, 1], of at least 2 demonstrations that are not the reference.
            reference_duration: [s] of the reference, which counts as one more person, aligned without any error.
            sample_period: [s].
            num_people: how many people the demonstrations are of, the reference's included; by default each its own.
                Spreads are widened from those of these people to those of one more, by sqrt(1 + 1 / num_people).

        Raises:
            InputError: phases of fewer than 2 demonstrations, or a duration that is none.
        """
        reference_duration = number(reference_duration, "reference_duration", "> 0 [s]", above=0.0)
        if len(phases) < 2:
            raise InputError(f"phases must be of at least 2 demonstrations beside the reference, got {len(phases)}")
        num = len(phases) + 1
        log_T = np.log([*((len(z) - 1) * sample_period for z in phases), reference_duration])
        mean, std = float(log_T.mean()), max(float(log_T.std(ddof=1)), _LEAST_STD)
        x = log_T - mean
        # Kernel averages over z: the mean deviation of each demonstration, with 0 for the reference, ...
        kernels, deviations = [], []
        for k, z in enumerate(phases):
            elapsed = np.arange(1, len(z)) * sample_period
            kernel = np.exp(-0.5 * ((_LEVELS[:, np.newaxis] - z[1:]) / _BANDWIDTH) ** 2)
            kernels.append(kernel / np.maximum(kernel.sum(axis=1, keepdims=True), 1e-9))
            deviations.append(np.log(elapsed / np.maximum(z[1:], _LEAST_PHASE)) - log_T[k])
        table = np.array([kernel @ one for kernel, one in zip(kernels, deviations, strict=True)] + [0.0 * _LEVELS])
        # ... its regression on log T (a ridge: with few people a slope must earn its keep), ...
        slope = x @ table / (x @ x + _SLOPE_SHRINKAGE * std**2)
        offset = table.mean(axis=0) * num / (num + 0.5)
        # ... and what remains, between demonstrations and within them.
        squares = sum(
            (kernel * (one - (offset + slope * x[k])[:, np.newaxis]) ** 2).sum(axis=1)
            for k, (kernel, one) in enumerate(zip(kernels, deviations, strict=True))
        )
        one_more = 1.0 + 1.0 / (num if num_people is None else max(num_people, 1))
        return cls(
            mean,
            std * math.sqrt(one_more),
            tuple(offset.tolist()),
            tuple(slope.tolist()),
            tuple(np.sqrt(one_more * squares / max(num - 2, 1) + _LEAST_STD**2).tolist()),
        )


class Interval(NamedTuple):
    """Bounds between which a value lies with a given probability."""

    low: float
    high: float


class _Posterior(NamedTuple):
    """Mean and standard deviation of log T, without regard to T > t; and the elapsed time t [s]."""

    log_mean: NDArray
    log_std: NDArray
    elapsed: NDArray


class PhaseFilter(Estimator):
    """Fuses an alignment's phase with the distribution of durations (see the module).

    State: [the inner estimator's state, number of samples, highest z so far, how many samples there were when it was
    reached].

    Args:
        estimator: gives z, such as `OpenEndSoftDTW`.
        calibration: from `Calibration.fit`, or through `PhaseFilter.fit`.
        fused: whether the phase is the filter's mean. If not, it is the alignment's own, and the filter only adds what
            an alignment cannot say: rate and remaining time.
    """

    def __init__(self, estimator: Estimator, calibration: Calibration, fused: bool = True) -> None:
        super().__init__(estimator.num_axes, estimator.num_states + 3, estimator.sample_period)
        self.estimator = estimator
        self.calibration = calibration
        self.fused = fused

    @classmethod
    def fit(
        cls,
        estimator: Estimator,
        demonstrations: Sequence[ArrayLike],
        reference_duration: float,
        num_people: int | None = None,
    ) -> "PhaseFilter":
        """Returns the filter of an estimator, calibrated on demonstrations of its action.

        Args:
            estimator: see the class.
            demonstrations: at least 2 whole ones, (m_k, d), the reference not among them.
            reference_duration: [s].
            num_people: see `Calibration.fit`.

        Raises:
            InputError: fewer than 2 demonstrations, one that cannot be used, or a duration that is none.
        """
        if len(demonstrations) < 2:
            raise InputError(f"demonstrations must be at least 2 beside the reference, got {len(demonstrations)}")
        reference_duration = number(reference_duration, "reference_duration", "> 0 [s]", above=0.0)
        phases = estimator.phases(demonstrations)
        return cls(estimator, Calibration.fit(phases, reference_duration, estimator.sample_period, num_people))

    def initial_state(self) -> NDArray:
        """Returns a new state (num_states,)."""
        return np.append(self.estimator.initial_state(), [0.0, -1.0, 0.0])

    def _step(self, state: NDArray, sample: NDArray) -> None:
        self._take(state, sample)

    def _take(self, state: NDArray, sample: ArrayLike) -> None:
        inner = state[:-3]
        # Which checks the sample; nothing has changed yet if it cannot be used.
        z = self.estimator._take(inner, sample)
        if z is None:
            z = self.estimator.phase_at(inner)
        state[-3] += 1.0
        if z > state[-2]:
            state[-2:] = z, state[-3]

    def phase_at(self, state: NDArray) -> float:
        """Returns the phase; the filter's mean is 0 before the second sample, as no time has passed."""
        if not self.fused:
            return self.estimator.phase_at(state[:-3])
        posterior = self._posterior_at(state)
        return float(_phase_mean(posterior.elapsed, moment_beyond(-1, *posterior)))

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns mean and standard deviation of phase and remaining time, and the mean rate."""
        summary = _summary(self._posterior_at(state))
        estimate = Estimate(*(float(value) for value in summary))
        return estimate if self.fused else estimate._replace(phase=self.phase_at(state))

    def fuse(self, z: NDArray, elapsed: NDArray) -> Estimate:
        """Returns the fused estimates for phases of the alignment after elapsed times [s]; arrays of one shape."""
        return _summary(self._posterior(z, elapsed))

    def _phase(self, query: NDArray) -> NDArray:
        z = self.estimator._phase(query)
        if not self.fused:
            return z
        posteriors = self._posteriors(z)
        return _phase_mean(posteriors.elapsed, moment_beyond(-1, *posteriors))

    def _estimates(self, query: NDArray) -> Estimate:
        z = self.estimator._phase(query)
        estimates = _summary(self._posteriors(z))
        return estimates if self.fused else estimates._replace(phase=z)

    def remaining_time_interval(self, state: NDArray, probability: float = 0.9) -> Interval:
        """Returns the interval [s] of the remaining time that leaves the same probability on both sides.

        Raises:
            InputError: `probability` is not between 0 and 1.
        """
        low, high = _remaining_time_interval(self._posterior_at(state), probability)
        return Interval(float(low), float(high))

    def remaining_time_intervals(self, query: ArrayLike, probability: float = 0.9) -> NDArray:
        """Returns the intervals (m, 2) [s] after each sample of a query; see `remaining_time_interval`.

        Raises:
            InputError: as `phase` and `remaining_time_interval`.
        """
        posteriors = self._posteriors(self.estimator.phase(query))
        return np.column_stack(_remaining_time_interval(posteriors, probability))

    def phase_interval(self, state: NDArray, probability: float = 0.9) -> Interval:
        """Returns the interval of the phase that leaves the same probability on both sides.

        Raises:
            InputError: `probability` is not between 0 and 1.
        """
        low, high = self.remaining_time_interval(state, probability)
        elapsed = self.elapsed(state)
        return Interval(*((elapsed / (elapsed + left) if elapsed > 0.0 else 0.0) for left in (high, low)))

    def end_probability(self, state: NDArray) -> float:
        """Returns the probability that the action has ended by now (T <= t), if nobody had said that it goes on.

        It is judged by when the alignment came farthest: after the end it stays there, and says no more of T.
        """
        elapsed = self.elapsed(state)
        _, z, num = state[-3:]
        log_mean, log_std, _ = self._posterior(np.asarray(z), np.asarray(self._elapsed(num)))
        return float(ndtr((np.log(elapsed) - log_mean) / log_std)) if elapsed > 0.0 else 0.0

    def elapsed(self, state: NDArray) -> float:
        """Returns the time [s] from the first to the last sample."""
        return self._elapsed(state[-3])

    def _elapsed(self, num_samples: float) -> float:
        return max(float(num_samples) - 1.0, 0.0) * self.sample_period

    def _posterior_at(self, state: NDArray) -> _Posterior:
        return self._posterior(np.asarray(self.estimator.phase_at(state[:-3])), np.asarray(self.elapsed(state)))

    def _posteriors(self, z: NDArray) -> _Posterior:
        return self._posterior(z, np.arange(len(z)) * self.sample_period)

    def _posterior(self, z: NDArray, elapsed: NDArray) -> _Posterior:
        """The posterior after `elapsed` [s] when the alignment says `z`: a product of two normal distributions."""
        c = self.calibration
        offset, slope, std = (
            np.interp(z, np.linspace(0.0, 1.0, len(curve)), curve) for curve in (c.offset, c.slope, c.std)
        )
        sensitivity = 1.0 + slope
        # Before any time has passed the alignment implies nothing.
        begun = elapsed > 0.0
        information = np.where(begun, sensitivity / std**2, 0.0)
        implied = np.log(np.where(begun, elapsed, 1.0) / np.maximum(z, _LEAST_PHASE))
        precision = 1.0 / c.duration_log_std**2 + information * sensitivity
        shift = information * (implied - offset - c.duration_log_mean) / precision
        return _Posterior(c.duration_log_mean + shift, 1.0 / np.sqrt(precision), elapsed)


def _phase_mean(elapsed: NDArray, rate: NDArray) -> NDArray:
    return np.minimum(elapsed * rate, 1.0)


def _summary(posterior: _Posterior) -> Estimate:
    elapsed, rate = posterior.elapsed, moment_beyond(-1, *posterior)
    return Estimate(
        phase=_phase_mean(elapsed, rate),
        phase_std=elapsed * spread_beyond(-1, *posterior),
        rate=rate,
        remaining_time=np.maximum(moment_beyond(1, *posterior) - elapsed, 0.0),
        remaining_time_std=spread_beyond(1, *posterior),
    )


def _remaining_time_interval(posterior: _Posterior, probability: float) -> tuple[NDArray, NDArray]:
    if not 0.0 < number(probability, "probability", "between 0 and 1") < 1.0:
        raise InputError(f"probability must be between 0 and 1, got {probability:g}")
    low, high = (
        np.maximum(quantile_beyond(0.5 + 0.5 * side * probability, *posterior) - posterior.elapsed, 0.0)
        for side in (-1.0, 1.0)
    )
    return low, high
