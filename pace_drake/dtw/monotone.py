"""A phase that never goes back, and never rises faster than a person can work."""

import numpy as np
from numpy.typing import NDArray

from pace_drake.dtw.estimator import Estimate, Estimator, number


class Monotone(Estimator):
    """Limits the phase of another estimator: no step back, and at most `max_rate` forward.

    An alignment may jump: back, where a later sample makes an earlier place the likelier one, and forward, where
    cycles look alike or it has lagged behind. The motion itself does neither.

    No step back: what a threshold on the phase has decided is not taken back, and the squared error of alignments falls
    by 5 to 30 % on the synthetic people, as they jump back wrongly more often than not. In return a wrong jump forward
    stays until the inner phase has caught up; a single one to 1 stays for good.

    `max_rate` takes the harm out of that, and lags by (jump / max_rate) behind a jump that is right. Those are common:
    at 2 / mean duration it costs more than it brings with Windowed-Pearson, at 3 / mean duration about nothing. Slower
    limits are for those who need a smooth phase rather than a right one.

    The first sample is limited too: an action begins at the phase that the inner estimator gives before any sample.
    All other values of an estimate are the inner ones: they belong to the unlimited phase.

    The state is [state of the inner estimator, last phase].

    Args:
        estimator: the inner one; its own streaming state is not used.
        max_rate: [1/s] highest speed of the phase, > 0; None for no limit.

    Raises:
        InputError: max_rate is out of range.
    """

    def __init__(self, estimator: Estimator, max_rate: float | None) -> None:
        super().__init__(estimator.num_axes, estimator.num_states + 1, estimator.sample_period)
        self.estimator = estimator
        self.max_rate = None if max_rate is None else number(max_rate, "max_rate", "> 0 [1/s], or None", above=0.0)
        self._largest_step = np.inf if self.max_rate is None else self.max_rate * self.sample_period

    def initial_state(self) -> NDArray:
        """Returns a new state that has seen no sample."""
        inner = self.estimator.initial_state()
        return np.append(inner, self.estimator.phase_at(inner))

    def _step(self, state: NDArray, sample: NDArray) -> None:
        inner = state[:-1]
        self.estimator._step(inner, sample)
        state[-1] = self._limited(state[-1], self.estimator.phase_at(inner))

    def phase_at(self, state: NDArray) -> float:
        """Returns the limited phase."""
        return float(state[-1])

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns the inner estimate with the limited phase."""
        return self.estimator.estimate_at(state[:-1])._replace(phase=self.phase_at(state))

    # A whole query goes through the inner estimator at once: that may be compiled.

    def _phase(self, query: NDArray) -> NDArray:
        return self._all_limited(self.estimator._phase(query))

    def _estimates(self, query: NDArray) -> Estimate:
        estimates = self.estimator._estimates(query)
        return estimates._replace(phase=self._all_limited(np.asarray(estimates.phase)))

    def _all_limited(self, phases: NDArray) -> NDArray:
        last = self.phase_at(self.initial_state())
        limited = np.empty(len(phases))
        for i, phase in enumerate(phases):
            limited[i] = last = self._limited(last, phase)
        return limited

    def _limited(self, last: float, phase: float) -> float:
        return min(max(last, phase), last + self._largest_step)
