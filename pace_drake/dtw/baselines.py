"""Baselines that look at no motion: what any estimator has to beat.

The constant 0.5 has a mean squared error of 1/12 against a linear phase. Elapsed over mean duration has about a
third of the squared coefficient of variation of the durations: it is good wherever people keep their pace, and many
published figures are worse. Both belong beside every table of errors.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw.duration import moment_beyond, spread_beyond
from pace_drake.dtw.estimator import Estimate, Estimator, number, samples
from pace_drake.errors import InputError

#: Spread of the logarithm of durations that stands for none, so that one formula holds for equal durations too.
_LEAST_LOG_STD = 1e-9


class ConstantPhase(Estimator):
    """Always the same phase.

    Its state is empty.

    Args:
        num_axes: d, values of a sample.
        value: the phase, in [0, 1].
        sample_period: [s] time between samples, > 0.

    Raises:
        InputError: value or sample_period is out of range.
    """

    def __init__(self, num_axes: int, value: float = 0.5, sample_period: float = 0.1) -> None:
        super().__init__(num_axes, num_states=0, sample_period=sample_period)
        meaning = "a phase in [0, 1]"
        self.value = number(value, "value", meaning, least=0.0)
        if self.value > 1.0:
            raise InputError(f"value must be {meaning}, got {self.value:g}")

    def initial_state(self) -> NDArray:
        """Returns an empty vector."""
        return np.zeros(0)

    def _step(self, state: NDArray, sample: NDArray) -> None:
        pass

    def phase_at(self, state: NDArray) -> float:
        """Returns the value, also before the first sample."""
        return self.value


class TimeOnly(Estimator):
    """Elapsed time over the mean duration of the action, at most 1.

    The remaining time is that of a log-normal duration T, fitted to the durations, that is known to exceed the elapsed
    time (`pace_drake.dtw.duration`). So the expected remaining time falls more slowly than time passes, and never to
    0: who is late already is expected to take still longer. The phase does not use this; it stays elapsed / mean, the
    usual baseline.

    The state is [number of samples].

    Args:
        num_axes: d, values of a sample.
        durations: (k,) [s] of demonstrations, k >= 1, > 0. With one, only phase and rate are known.
        sample_period: [s] time between samples, > 0; n samples take n - 1 periods.

    Raises:
        InputError: an argument is out of range.
    """

    def __init__(self, num_axes: int, durations: ArrayLike, sample_period: float = 0.1) -> None:
        super().__init__(num_axes, num_states=1, sample_period=sample_period)
        checked = samples(durations, "durations", (-1,), "a vector (k,) of times [s]")
        if not (checked.size and (checked > 0.0).all()):
            raise InputError(f"durations must be at least one, and all > 0 [s], got {checked.tolist()}")
        self.durations = checked.copy()
        self.durations.setflags(write=False)
        self.mean_duration = float(checked.mean())
        logs = np.log(checked)
        self._log_mean = float(logs.mean())
        self._log_std = max(float(logs.std(ddof=1)), _LEAST_LOG_STD) if logs.size > 1 else None

    def initial_state(self) -> NDArray:
        """Returns the vector [0]."""
        return np.zeros(1)

    def _step(self, state: NDArray, sample: NDArray) -> None:
        state[0] += 1.0

    def phase_at(self, state: NDArray) -> float:
        """Returns elapsed / mean duration, at most 1."""
        return min(1.0, self._elapsed(state) / self.mean_duration)

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns all that is known; the standard deviation of the phase is that of t / T given T > t."""
        elapsed, phase = self._elapsed(state), self.phase_at(state)
        rate = 1.0 / self.mean_duration if phase < 1.0 else 0.0
        if self._log_std is None:
            return Estimate(phase, rate=rate)
        known = (self._log_mean, self._log_std, elapsed)
        return Estimate(
            phase,
            elapsed * float(spread_beyond(-1, *known)),
            rate,
            max(0.0, float(moment_beyond(1, *known)) - elapsed),
            float(spread_beyond(1, *known)),
        )

    def _elapsed(self, state: NDArray) -> float:
        return max(float(state[0]) - 1.0, 0.0) * self.sample_period
