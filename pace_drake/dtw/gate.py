"""A hand at rest does not advance the phase."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw.baselines import ConstantPhase
from pace_drake.dtw.estimator import Estimate, Estimator, number, samples
from pace_drake.errors import InputError


class MovementGate(Estimator):
    """Withholds samples from another estimator while the hand rests.

    Soft-DTW takes at least half a step along the reference with every sample that tells it nothing, so a resting hand
    "advances" at about nominal speed. Behind the gate the inner estimator sees motion only; what it makes of time,
    such as `TimeOnly` and `ProMP` do, is then time in motion.

    Rest, seen over the samples of the last `rest_time`: at least three quarters of them lie within a radius of their
    median (axis by axis). The radius is what a straight motion at `rest_speed` would need, so slower ones rest and
    faster ones don't. Why this one:

    - extent, not net displacement: a hand that circles comes back to where it was and yet works;
    - no speeds from differences: tremor and sensor noise of 2 mm make 3 cm/s at 10 Hz;
    - a quarter may lie anywhere: a spike neither ends a rest nor, as it is withheld, reaches the inner estimator.

    Falling asleep costs: until a rest fills three quarters of the window its samples pass, 0.1 to 0.3 s of drift
    for each rest at the defaults and 10 Hz. A pause shorter than that is not seen at all. Waking: a rest ends with
    the sample that leaves too few inside. Samples just before it that had left the radius, taken for spikes until then,
    are handed on first, so that no motion is lost but what lies within the radius. Rate and remaining time of an
    estimate are those of the inner estimator, which does not know how long a rest will last.

    For positions only. An accelerometer shows gravity at any steady speed, and noise says little about rest.

    A reference that rests or works slowly has to lose the same samples, or the alignment must skip what no query ever
    shows: build the gate with `of_reference`. Squared errors of Windowed-Pearson without a gate, with one for queries
    alone, and with one for both: 0.063, 0.098, 0.055 on real assembly (LEGO, hands at 3 cm/s in the median, a quarter
    of the samples withheld); 0.0094, 0.0102, 0.0052 on synthetic people (validation trials of seeds 0, 5, 6).

    The state is [samples seen (at most those of the window), withheld samples in a row that may be motion, samples of
    the window (oldest first), state of the inner estimator].

    Args:
        estimator: the inner one; its own streaming state is not used.
        rest_speed: [units of a sample / s] > 0; the default is for hands in metres.
        rest_time: [s] of the window, at least one sample period. A shorter one loses less at the start of a rest, but
            cannot tell noise from motion: 0.3 s at 2 cm/s passes 14 % of the samples of a hand at rest (noise 2 mm).

    Raises:
        InputError: rest_speed or rest_time is out of range.
    """

    def __init__(self, estimator: Estimator, rest_speed: float = 0.02, rest_time: float = 0.5) -> None:
        self.estimator = estimator
        self.rest_speed = number(rest_speed, "rest_speed", "> 0 [units of a sample / s]", above=0.0)
        self.rest_time = number(rest_time, "rest_time", "> 0 [s]", above=0.0)
        period = estimator.sample_period
        if self.rest_time < period:
            raise InputError(f"rest_time must be at least the sample period {period:g} s, got {self.rest_time:g} s")
        self._window = round(self.rest_time / period) + 1
        super().__init__(
            estimator.num_axes, 2 + self._window * estimator.num_axes + estimator.num_states, estimator.sample_period
        )
        straight = self.rest_speed * period * np.arange(self._window)[:, np.newaxis]
        self._squared_radius = float(_squared_spread(straight)[0])
        self._reference_phases: NDArray | None = None  # of `of_reference`

    @classmethod
    def of_reference(
        cls,
        reference: ArrayLike,
        make: Callable[[NDArray], Estimator],
        rest_speed: float = 0.02,
        rest_time: float = 0.5,
        *,
        sample_period: float = 0.1,
    ) -> "MovementGate":
        """Returns a gate around an estimator whose reference has lost its rests as well.

        Phases are then mapped back to the time of the whole reference, and jump over its rests when the hand moves on;
        a rest at its very end counts as done. Standard deviation and rate remain those of the inner estimator.

        Args:
            reference: (n, d).
            make: makes the inner estimator from what is left of the reference (k, d), 2 <= k <= n; its phase must be
                linear in that.
            rest_speed: [units of a sample / s] as in the constructor.
            rest_time: [s] as in the constructor.
            sample_period: [s] of the reference and of the estimator.

        Raises:
            InputError: an argument is out of range, or the reference never moves.
        """
        meaning = "an (n, d) array, one row per sample, d >= 1"
        whole = samples(reference, "reference", (-1, -1), meaning)
        if not whole.size:
            raise InputError(f"reference must be {meaning}, got shape {whole.shape}")
        probe = cls(ConstantPhase(whole.shape[1], sample_period=sample_period), rest_speed, rest_time)
        moving = np.flatnonzero(~probe.resting(whole))
        if moving.size < 2:
            raise InputError("reference must move faster than rest_speed for at least 2 samples")
        gate = cls(make(whole[moving]), rest_speed, rest_time)
        if gate.sample_period != probe.sample_period:
            raise InputError(f"sample_period must be that of the estimator, {gate.sample_period:g} s")
        gate._reference_phases = moving / (len(whole) - 1)
        gate._reference_phases[-1] = 1.0
        return gate

    def resting(self, query: ArrayLike) -> NDArray:
        """Returns whether the hand rests at each sample of a query (m, d), from the samples up to it: (m,) bool.

        Raises:
            InputError: as `phase`.
        """
        return self._rest_and_far(self._checked_query(query))[0]

    def rests_at(self, state: NDArray) -> bool:
        """Returns whether the hand rests in a state."""
        window, _ = self._parts(state)
        return bool(state[0] == self._window and _squared_spread(window)[0] <= self._squared_radius)

    def initial_state(self) -> NDArray:
        """Returns a new state that has seen no sample."""
        return np.append(np.zeros(self.num_states - self.estimator.num_states), self.estimator.initial_state())

    def _step(self, state: NDArray, sample: NDArray) -> None:
        window, inner = self._parts(state)
        window[:-1] = window[1:]
        window[-1] = sample
        state[0] = min(state[0] + 1.0, self._window)
        pending = int(state[1])
        if state[0] == self._window:
            squared_spread, squared_distance = _squared_spread(window)
            if squared_spread <= self._squared_radius:
                state[1] = self._next_pending(pending, bool(squared_distance > self._squared_radius))
                return
        state[1] = 0.0
        for held_back in window[-1 - pending :]:
            self.estimator._step(inner, held_back)

    def phase_at(self, state: NDArray) -> float:
        """Returns the inner phase, which stands still while the hand rests."""
        return float(self._of_whole_reference(self.estimator.phase_at(self._parts(state)[1])))

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns the inner estimate."""
        return self.estimator.estimate_at(self._parts(state)[1])._replace(phase=self.phase_at(state))

    # Who rests does not depend on the inner estimator, so that one can take what is left of a query at once.

    def _phase(self, query: NDArray) -> NDArray:
        passed, last_passed = self._passed(query)
        return np.asarray(self._of_whole_reference(self.estimator._phase(query[passed])[last_passed]))

    def _estimates(self, query: NDArray) -> Estimate:
        passed, last_passed = self._passed(query)
        inner = Estimate(*(np.asarray(values)[last_passed] for values in self.estimator._estimates(query[passed])))
        return inner._replace(phase=self._of_whole_reference(inner.phase))

    def _of_whole_reference(self, phase: float | NDArray) -> float | NDArray:
        known = self._reference_phases
        return phase if known is None else np.interp(phase, np.linspace(0.0, 1.0, known.size), known)

    def _passed(self, query: NDArray) -> tuple[NDArray, NDArray]:
        """Returns the indices of the samples that pass, and for each sample (m,) which of these was the last."""
        passed: list[int] = []
        last_passed = np.empty(len(query), dtype=int)
        pending = 0
        for i, (rests, far) in enumerate(zip(*self._rest_and_far(query), strict=True)):
            if rests:
                pending = self._next_pending(pending, bool(far))
            else:
                passed += range(i - pending, i + 1)
                pending = 0
            last_passed[i] = len(passed) - 1
        return np.array(passed), last_passed

    def _next_pending(self, pending: int, far: bool) -> int:
        """How many of the newest samples may be motion, after one more that was withheld."""
        return min(pending + 1, self._window - 1) if far else 0

    def _rest_and_far(self, query: NDArray) -> tuple[NDArray, NDArray]:
        """Whether the hand rests at each sample (m,), and whether the sample is outside the radius."""
        rest, far = np.zeros((2, len(query)), dtype=bool)
        if len(query) >= self._window:
            windows = np.moveaxis(sliding_window_view(query, self._window, axis=0), -1, 1)
            squared_spread, squared_distance = _squared_spread(windows)
            rest[self._window - 1 :] = squared_spread <= self._squared_radius
            far[self._window - 1 :] = squared_distance > self._squared_radius
        return rest, far

    def _parts(self, state: NDArray) -> tuple[NDArray, NDArray]:
        """Views of the window (w, d) and of the state of the inner estimator."""
        end = 2 + self._window * self.num_axes
        return state[2:end].reshape(self._window, self.num_axes), state[end:]


def _squared_spread(windows: NDArray) -> tuple[NDArray, NDArray]:
    """Squared distances from the median: the one that three quarters keep, and that of the last sample.

    Args:
        windows: (..., w, d).

    Returns:
        (...) and (...).
    """
    w = windows.shape[-2]
    ordered = np.sort(windows, axis=-2)
    median = 0.5 * (ordered[..., (w - 1) // 2, :] + ordered[..., w // 2, :])
    squares = (windows - median[..., np.newaxis, :]) ** 2
    # Axis by axis, as a sum over an axis may round otherwise for one window than for many.
    distances = sum(np.moveaxis(squares, -1, 0))
    return np.sort(distances, axis=-1)[..., w - 1 - w // 4], distances[..., -1]
