"""Open-end soft-DTW (Algorithm 1 of the paper): how far along a reference a growing query is.

Differs from the printed algorithm:

- line 7: j* = argmin over j in [1, n] of R[i, j], minus 1; the printed range [0, n-1] takes the infinite
  column 0 and never the last reference sample (``test_self_alignment_reaches_one``). Ties: the lowest j.
- min^gamma is a shifted log-sum-exp; gamma = 0 is the hard minimum; the soft-min of infinities is infinite.
"""

import operator
from dataclasses import dataclass, field
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw import kernels
from pace_drake.errors import InputError

Distance = Literal["euclidean", "sqeuclidean", "wp"]
DISTANCES: tuple[str, ...] = get_args(Distance)

_INDEX = {"euclidean": kernels.EUCLIDEAN, "sqeuclidean": kernels.SQEUCLIDEAN, "wp": kernels.WP}


def _checked_samples(values: ArrayLike, name: str, shape: tuple[int, ...], meaning: str) -> NDArray:
    """Returns a new contiguous float64 array of the wanted shape (-1: any length), or raises InputError."""
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError(f"{name} must be {meaning}, got something that is no array of numbers") from None
    if array.shape != shape and (
        array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True))
    ):
        raise InputError(f"{name} must be {meaning}, got shape {array.shape}")
    if not kernels.in_range(array):
        where = np.argwhere(~(np.abs(array) <= kernels.LARGEST))[0].tolist()
        raise InputError(
            f"{name} has the value {array[tuple(where)]} at index {where}: NaN, inf and sizes above"
            f" {kernels.LARGEST:g} cannot be aligned, remove or interpolate them"
        )
    return array


@dataclass(frozen=True, eq=False)
class OpenEndKernel:
    """The unchanging part of an alignment: a reference and its settings. The caller owns the changing part.

    The changing part is one flat float64 vector that can live in a Drake discrete state; it may hold inf. Its
    layout is ``[number of samples, last samples (for "wp": window * d), R[i, 1..n]]``.

    Attributes:
        reference: (n, d) the reference q, n >= 2; a read-only copy is kept.
        gamma: smoothing of the minimum, in the units of summed distances; 0 is the hard minimum.
        distance: "euclidean" (not squared), "sqeuclidean", or "wp" (Windowed-Pearson, Eq. 3).
        window: [samples] length w >= 2 of the windows of "wp"; the other distances ignore it.

    Raises:
        InputError: a setting or the reference is out of range; the message names it.
    """

    reference: NDArray
    gamma: float = 0.0
    distance: Distance = "wp"
    window: int = 10
    _axes: NDArray = field(init=False, repr=False)  # (d, n)
    _windows: NDArray = field(init=False, repr=False)  # (d, w, n)
    _distance_index: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        reference = _checked_samples(self.reference, "reference", (-1, -1), "an (n, d) array, one row per sample")
        n, d = reference.shape
        if n < 2 or d < 1:
            raise InputError(f"reference must have at least 2 samples of 1 axis, got shape {reference.shape}")
        try:
            gamma = float(self.gamma)
        except (TypeError, ValueError):
            raise InputError(f"gamma must be a number >= 0, got {self.gamma!r}") from None
        if not 0.0 <= gamma <= kernels.LARGEST:
            raise InputError(f"gamma must be finite and >= 0 (0 is the hard minimum), got {gamma}")
        if self.distance not in DISTANCES:
            raise InputError(f"distance must be one of {', '.join(DISTANCES)}, got {self.distance!r}")
        try:
            window = operator.index(self.window)
        except TypeError:
            raise InputError(f"window must be a whole number of samples >= 2, got {self.window!r}") from None
        if window < 2:
            raise InputError(f"window must be at least 2 samples, got {window}")
        axes = np.ascontiguousarray(reference.T)
        # A window never holds more than n samples (k <= j + 1), so that a longer one gives the same result.
        windows = kernels.normalized_windows(axes, min(window, n)) if self.distance == "wp" else np.empty((d, 0, n))
        for array in (reference, axes, windows):
            array.setflags(write=False)
        for name, value in (
            ("reference", reference),
            ("gamma", gamma),
            ("window", window),
            ("_axes", axes),
            ("_windows", windows),
            ("_distance_index", _INDEX[self.distance]),
        ):
            object.__setattr__(self, name, value)

    @property
    def num_reference_samples(self) -> int:
        """Length n of the reference [samples]."""
        return self.reference.shape[0]

    @property
    def num_axes(self) -> int:
        """Dimension d of a sample."""
        return self.reference.shape[1]

    @property
    def num_states(self) -> int:
        """Length of the state vector."""
        return 1 + self._windows.shape[1] * self.num_axes + self.num_reference_samples

    def initial_state(self) -> NDArray:
        """Returns a new state vector (num_states,) that has seen no sample: R[0, 1..n] is infinite."""
        state = np.zeros(self.num_states)
        self.accumulated_cost(state)[:] = np.inf
        return state

    def update(self, state: NDArray, sample: ArrayLike) -> None:
        """Takes one more query sample: lines 4-6 of Algorithm 1, in place.

        Args:
            state: (num_states,) float64, contiguous and writable; from `initial_state`.
            sample: (d,) the query sample p_i.

        Raises:
            InputError: the sample has the wrong shape or is not finite; the state is then unchanged.
            ValueError: the state is no vector of this kernel.
        """
        checked = _checked_samples(sample, "sample", (self.num_axes,), f"a vector of {self.num_axes} values")
        self._check_state(state)
        if not (state.flags.c_contiguous and state.flags.writeable):
            raise ValueError("state must be contiguous and writable: it is updated in place")
        kernels.update(state, checked, self._axes, self._windows, self._distance_index, self.gamma)

    def phase(self, state: NDArray) -> float:
        """Returns the phase in [0, 1] (lines 7-8 of Algorithm 1, Eq. 2); 0 before the first sample."""
        self._check_state(state)
        # A row of infinities, before the first sample, has its first minimum at index 0.
        return float(self.accumulated_cost(state).argmin() / (self.num_reference_samples - 1))

    def num_samples(self, state: NDArray) -> int:
        """Returns how many query samples the state has seen."""
        return int(state[0])

    def accumulated_cost(self, state: NDArray) -> NDArray:
        """Returns a view (n,) of R[i, 1..n], the cost of the best alignment that ends at each sample."""
        return state[self.num_states - self.num_reference_samples :]

    def _check_state(self, state: NDArray) -> None:
        if state.shape != (self.num_states,) or state.dtype != np.float64:
            raise ValueError(
                f"state must be a float64 vector of length {self.num_states}, got {state.dtype} {state.shape}"
            )


class OpenEndSoftDTW:
    """Streaming open-end soft-DTW: one update per sample, O(n d) ("wp": O(n d w)) each.

    Args:
        reference: (n, d) the reference q, n >= 2.
        gamma: smoothing of the minimum, >= 0; 0 is the hard minimum.
        distance: "wp" (Windowed-Pearson, Eq. 3), "euclidean" or "sqeuclidean".
        window: [samples] length w >= 2 of the windows of "wp".

    Raises:
        InputError: an argument is out of range; the message names it.
    """

    def __init__(self, reference: ArrayLike, gamma: float = 0.0, distance: Distance = "wp", window: int = 10) -> None:
        self._kernel = OpenEndKernel(cast(NDArray, reference), gamma, distance, window)
        self._state = self._kernel.initial_state()

    @property
    def kernel(self) -> OpenEndKernel:
        """The reference and the settings."""
        return self._kernel

    @property
    def phase(self) -> float:
        """Phase in [0, 1] of the samples so far; 0.0 before the first one."""
        return self._kernel.phase(self._state)

    @property
    def num_samples(self) -> int:
        """Number of samples since the start or the last reset."""
        return self._kernel.num_samples(self._state)

    @property
    def accumulated_cost(self) -> NDArray:
        """Copy (n,) of the row R[i, 1..n]."""
        return self._kernel.accumulated_cost(self._state).copy()

    def update(self, sample: ArrayLike) -> float:
        """Takes the sample p_i (d,) and returns the phase.

        Raises:
            InputError: the sample has the wrong shape or is not finite; nothing has changed then.
        """
        self._kernel.update(self._state, sample)
        return self.phase

    def reset(self) -> None:
        """Forgets all samples."""
        self._state = self._kernel.initial_state()


def phase(
    query: ArrayLike,
    reference: ArrayLike,
    *,
    gamma: float = 0.0,
    distance: Distance = "wp",
    window: int = 10,
) -> NDArray:
    """Phases of a whole query, each from the samples up to it (Algorithm 1).

    Args:
        query: (m, d) the query p, m >= 1.
        reference: (n, d) the reference q, n >= 2.
        gamma: smoothing of the minimum, >= 0; 0 is the hard minimum.
        distance: "wp" (Windowed-Pearson, Eq. 3), "euclidean" or "sqeuclidean".
        window: [samples] length w >= 2 of the windows of "wp".

    Returns:
        (m,) phases in [0, 1], bit for bit those that `OpenEndSoftDTW` gives sample by sample.

    Raises:
        InputError: an argument is out of range; the message names it.
    """
    kernel = OpenEndKernel(cast(NDArray, reference), gamma, distance, window)
    samples = _checked_samples(
        query, "query", (-1, kernel.num_axes), f"an (m, {kernel.num_axes}) array like the reference"
    )
    if samples.shape[0] == 0:
        raise InputError("query must have at least 1 sample, got none")
    phases = np.empty(samples.shape[0])
    kernels.phases(
        kernel.initial_state(),
        samples,
        kernel._axes,
        kernel._windows,
        kernel._distance_index,
        kernel.gamma,
        phases,
    )
    return phases
