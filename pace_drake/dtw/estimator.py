"""What all phase estimators have in common: streaming, batch, and a flat state that a caller may own."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from math import inf, isfinite, nan
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.errors import InputError

#: Beyond this size a square or a sum could overflow, and one infinite cost would spoil all later ones.
LARGEST = 1e100

#: [s] the longest loss of samples that `Estimator.update` bridges by linear interpolation.
MAX_GAP = 0.5


class Estimate(NamedTuple):
    """What is known of the action after the samples so far; arrays (m,) where it stands for a whole query.

    Attributes:
        phase: in [0, 1].
        phase_std: standard deviation of the phase; NaN where the estimator gives none.
        rate: [1/s] speed of the phase; NaN likewise.
        remaining_time: [s] expected time to the end of the action; NaN likewise.
        remaining_time_std: [s] NaN likewise.
    """

    phase: float | NDArray
    phase_std: float | NDArray = nan
    rate: float | NDArray = nan
    remaining_time: float | NDArray = nan
    remaining_time_std: float | NDArray = nan


class Estimator(ABC):
    """How far an action has come, from its samples.

    Three ways to use one estimator:

    - streaming: `update(sample)` takes one more sample and returns the phase, `reset()` begins a new action;
    - batch: `phase(query)` gives the phase after each sample of a query, `phases(queries)` of many queries;
    - with a state that the caller owns, such as a Drake discrete state: `initial_state()`, `step(state, sample)`,
      `phase_at(state)`, `estimate_at(state)`. These change nothing but the state.

    All three give the same numbers, bit for bit.

    Args:
        num_axes: d, values of a sample.
        num_states: length of the state vector.
        sample_period: [s] time between samples, > 0.
    """

    def __init__(self, num_axes: int, num_states: int, sample_period: float) -> None:
        self.num_axes = num_axes
        self.num_states = num_states
        self.sample_period = number(sample_period, "sample_period", "> 0 [s]", above=0.0)
        self._state: NDArray | None = None  # of the streaming use
        self._num_samples = 0
        self._last: tuple[NDArray, float] | None = None  # the last sample, and its time [s]

    # --- what an estimator defines ---

    @abstractmethod
    def initial_state(self) -> NDArray:
        """Returns a new float64 state vector (num_states,) that has seen no sample."""

    @abstractmethod
    def _step(self, state: NDArray, sample: NDArray) -> None:
        """Takes a checked sample into a checked state, in place."""

    @abstractmethod
    def phase_at(self, state: NDArray) -> float:
        """Returns the phase in [0, 1] of a state; 0 before the first sample, where the estimator knows no better."""

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns all that the estimator knows in a state."""
        return Estimate(self.phase_at(state))

    # --- with a state that the caller owns ---

    def step(self, state: NDArray, sample: ArrayLike) -> None:
        """Takes one more sample, in place.

        Args:
            state: (num_states,) float64, contiguous and writable; from `initial_state`.
            sample: (d,) finite.

        Raises:
            InputError: the sample has the wrong shape or is not finite; the state is then unchanged.
            ValueError: the state is no vector of this estimator.
        """
        flags = state.flags
        if state.shape == (self.num_states,) and state.dtype == np.float64 and flags.c_contiguous and flags.writeable:
            self._take(state, sample)
            return
        self._checked_sample(sample)  # may raise the error that is looked for first
        if state.shape != (self.num_states,) or state.dtype != np.float64:
            raise ValueError(
                f"state must be a float64 vector of length {self.num_states}, got {state.dtype} {state.shape}"
            )
        raise ValueError("state must be contiguous and writable: it is updated in place")

    def _take(self, state: NDArray, sample: ArrayLike) -> float | None:
        """Takes a sample that has not been checked into a checked state; returns the phase where it costs nothing."""
        self._step(state, self._checked_sample(sample))
        return None

    def _checked_sample(self, sample: ArrayLike) -> NDArray:
        return samples(sample, "sample", (self.num_axes,), f"a vector of {self.num_axes} values")

    # --- batch ---

    def phase(self, query: ArrayLike) -> NDArray:
        """Phases (m,) of a query (m, d), m >= 1, each from the samples up to it.

        Raises:
            InputError: the query is empty, of the wrong shape, or not finite.
        """
        return self._phase(self._checked_query(query))

    def phases(self, queries: Iterable[ArrayLike], num_threads: int = 1) -> list[NDArray]:
        """Phases of many queries, as `phase` gives them.

        Args:
            queries: each (m, d); lengths may differ.
            num_threads: how many threads share the work; compiled estimators gain by it.

        Raises:
            InputError: a query cannot be used; the message numbers it from 0.
        """
        checked = [self._checked_query(query, f"queries[{k}]") for k, query in enumerate(queries)]
        if num_threads == 1:
            return [self._phase(query) for query in checked]
        with ThreadPoolExecutor(num_threads) as pool:
            return list(pool.map(self._phase, checked))

    def estimates(self, query: ArrayLike) -> Estimate:
        """All estimates of a query (m, d): arrays (m,), each from the samples up to it.

        Raises:
            InputError: as `phase`.
        """
        return self._estimates(self._checked_query(query))

    def _phase(self, query: NDArray) -> NDArray:
        state = self.initial_state()
        phases = np.empty(len(query))
        for i, sample in enumerate(query):
            self._step(state, sample)
            phases[i] = self.phase_at(state)
        return phases

    def _estimates(self, query: NDArray) -> Estimate:
        state = self.initial_state()
        rows = []
        for sample in query:
            self._step(state, sample)
            rows.append(self.estimate_at(state))
        return Estimate(*np.array(rows).T)

    def _checked_query(self, query: ArrayLike, name: str = "query") -> NDArray:
        d = self.num_axes
        checked = samples(query, name, (-1, d), f"an (m, {d}) array like the reference")
        if checked.shape[0] == 0:
            raise InputError(f"{name} must have at least 1 sample, got none")
        return checked

    # --- streaming ---

    def update(self, sample: ArrayLike, time: float | None = None) -> float:
        """Takes one more sample and returns the phase.

        Args:
            sample: (d,) finite.
            time: [s] when it was taken. Samples that were lost since the last one are then filled in by linear
                interpolation, so that a gap does not shift the alignment; a gap above `MAX_GAP` is refused.

        Raises:
            InputError: the sample has the wrong shape or is not finite, time does not increase, or the gap is too
                long; nothing has changed then.
        """
        if self._state is None:
            self._state = self.initial_state()
        if time is None:
            self.step(self._state, sample)
            self._num_samples += 1
            self._last = None
            return self.phase_at(self._state)
        at = number(time, "time", "a finite number [s]")
        new = self._checked_sample(sample)
        path = new[np.newaxis]
        if self._last is not None:
            last, last_time = self._last
            gap = at - last_time
            if gap <= 0.0:
                raise InputError(f"time must increase, got {at:g} s after {last_time:g} s")
            if gap > MAX_GAP + self.sample_period:
                raise InputError(
                    f"time jumps by {gap:g} s, from {last_time:g} s to {at:g} s: more than {MAX_GAP} s are lost and"
                    " cannot be bridged; call reset() and begin the action anew"
                )
            # Rounding to whole periods absorbs jitter; two samples within half a period count as one each.
            num_steps = max(1, round(gap / self.sample_period))
            path = last + (new - last) * (np.arange(1, num_steps + 1) / num_steps)[:, np.newaxis]
            path[-1] = new
        for one in path:
            self.step(self._state, one)
        self._num_samples += len(path)
        self._last = (new, at)
        return self.phase_at(self._state)

    @property
    def estimate(self) -> Estimate:
        """All that is known after the streamed samples so far."""
        return self.estimate_at(self._state if self._state is not None else self.initial_state())

    @property
    def num_samples(self) -> int:
        """Number of streamed samples since the start or the last reset, bridged ones included."""
        return self._num_samples

    def reset(self) -> None:
        """Forgets the streamed samples: a new action begins."""
        self._state, self._num_samples, self._last = None, 0, None


def samples(values: ArrayLike, name: str, shape: tuple[int, ...], meaning: str) -> NDArray:
    """Returns a contiguous float64 array of the wanted shape (-1: any length).

    Args:
        values: what a caller gave; returned itself where it is such an array already.
        name: of the argument, for the message.
        shape: wanted.
        meaning: of the shape, for the message.

    Raises:
        InputError: another shape, no numbers, or a value that is not finite or above `LARGEST` in size.
    """
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be {meaning}, got something that is no array of numbers") from None
    if np.ndim(values) != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name} must be {meaning}, got shape {np.shape(values)}")
    bad = ~(np.abs(array) <= LARGEST)  # also true for NaN
    if bad.any():
        where = np.argwhere(bad)[0].tolist()
        raise InputError(
            f"{name} has the value {array[tuple(where)]} at index {where}: NaN, inf and sizes above {LARGEST:g}"
            " cannot be aligned, remove or interpolate them"
        )
    return array


def number(value: object, name: str, meaning: str, *, above: float = -inf, least: float = -inf) -> float:
    """Returns a finite number as float, or raises InputError that names the argument and says what it must be."""
    try:
        as_float = float(cast(float, value))
    except (TypeError, ValueError):
        raise InputError(f"{name} must be {meaning}, got {value!r}") from None
    if not (isfinite(as_float) and as_float > above and as_float >= least):
        raise InputError(f"{name} must be {meaning}, got {as_float:g}")
    return as_float
