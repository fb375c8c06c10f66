"""Open-end soft-DTW (Algorithm 1 of the paper): how far along a reference a growing query is.

Differs from the printed algorithm:

- line 7: j* = argmin over j in [1, n] of R[i, j], minus 1; the printed range [0, n-1] takes the infinite
  column 0 and never the last reference sample (``test_self_alignment_reaches_one``). Ties: the lowest j.
- min^gamma of soft-DTW sums exp(-R / gamma), without a log in each cell; gamma = 0 is the hard minimum; the
  soft-min of infinities is infinite.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw import kernels
from pace_drake.dtw.estimator import Estimator, number, samples
from pace_drake.errors import InputError

Distance = Literal["wp", "euclidean", "sqeuclidean", "derivative"]
Steps = Literal["symmetric1", "symmetric2", "asymmetric"]
Normalization = Literal["none", "max", "steps"]
DISTANCES: tuple[str, ...] = get_args(Distance)
STEPS: tuple[str, ...] = get_args(Steps)
NORMALIZATIONS: tuple[str, ...] = get_args(Normalization)

#: [cost] A smoothing between 0 and this is refused: costs over gamma could overflow.
LEAST_GAMMA = 1e-100


class OpenEndSoftDTW(Estimator):
    """Open-end soft-DTW: aligns all samples so far with the part of a reference that costs least.

    An update costs O(n d), whatever the window and however many samples came before. Settings cannot be changed.

    Args:
        reference: (n, d) the reference q, n >= 2; a copy is kept.
        gamma: [cost] smoothing of the minimum; 0 is the hard minimum.
        distance: of two samples:
            "wp", Windowed-Pearson (Eq. 3), 1 - correlation of the windows that end there, summed over axes;
            "euclidean", not squared; "sqeuclidean", squared;
            "derivative", "euclidean" of the derivatives of Keogh and Pazzani (2001), per sample. A derivative needs
            the next sample, so that each sample stands for the one before it, in query and reference alike, and
            both are taken to be at rest before they begin.
        window: [s] of "wp", at least 2 samples; other distances ignore it.
        sample_period: [s] time between samples.
        steps: which cells lead to (i, j), and how often its distance counts then:
            "symmetric1", (i-1, j), (i, j-1), (i-1, j-1), once each (the paper);
            "symmetric2", the same, twice from (i-1, j-1), so that all paths to a cell have the same weight;
            "asymmetric", (i-1, j), (i-1, j-1), (i-1, j-2), once each: at most twice the reference's speed.
        normalization: the phase minimises
            "none", R[i, j] (the paper);
            "max", R[i, j] / max(i, j);
            "steps", R[i, j] / (i + j), with "asymmetric" R[i, j] / i (Tormene et al. 2009).
        pooled: of "wp": one correlation from the covariances and variances of all axes added up, so that axes count
            by how much they move; a distance is then in [0, 2].

    Raises:
        InputError: an argument is out of range; the message names it.
    """

    def __init__(
        self,
        reference: ArrayLike,
        gamma: float = 0.0,
        distance: Distance = "wp",
        window: float = 1.0,
        *,
        sample_period: float = 0.1,
        steps: Steps = "symmetric1",
        normalization: Normalization = "none",
        pooled: bool = False,
    ) -> None:
        self._reference = samples(reference, "reference", (-1, -1), "an (n, d) array, one row per sample").copy()
        n, d = self._reference.shape
        if n < 2 or d < 1:
            raise InputError(f"reference must have at least 2 samples of 1 axis, got shape {self._reference.shape}")
        self._gamma = number(gamma, "gamma", "a number >= 0 (0 is the hard minimum)", least=0.0)
        if self._gamma != 0.0 and not LEAST_GAMMA <= self._gamma <= kernels.LARGEST:
            raise InputError(f"gamma must be 0 or between {LEAST_GAMMA:g} and {kernels.LARGEST:g}, got {self._gamma:g}")
        period = number(sample_period, "sample_period", "> 0 [s]", above=0.0)
        self._window = number(window, "window", "a number [s]")
        self._distance, self._steps, self._normalization, self._pooled = distance, steps, normalization, bool(pooled)
        settings = (
            _choice(distance, "distance", DISTANCES),
            _choice(steps, "steps", STEPS),
            _choice(normalization, "normalization", NORMALIZATIONS),
        )
        compared = _late_derivatives(self._reference) if distance == "derivative" else self._reference
        axes = np.ascontiguousarray(compared.T)
        w, groups = 0, 1 if self._pooled else d
        tables = (np.empty((d, 0, n)), np.empty((groups, 0, n)), np.empty((2, d, n)), np.empty((groups, n)))
        if distance == "wp":
            # A window never holds more than n samples (k <= j + 1), so that a longer one gives the same result.
            w = round(min(self._window / period, n))
            if w < 2:
                raise InputError(f"window must hold at least 2 samples of {period:g} s, got {self._window:g} s")
            tables = kernels.window_tables(axes, w, groups)
        for array in (self._reference, axes, *tables):
            array.setflags(write=False)
        self._model = (axes, *tables, *settings, self._gamma)  # what compiled code needs, in its order
        super().__init__(d, kernels.num_states(d, n, w, settings[0], groups, self._gamma), period)

    @property
    def reference(self) -> NDArray:
        """The reference (n, d), read-only."""
        return self._reference

    @property
    def gamma(self) -> float:
        """Smoothing of the minimum [cost]."""
        return self._gamma

    @property
    def distance(self) -> Distance:
        """Distance of two samples."""
        return self._distance

    @property
    def window(self) -> float:
        """Length of the windows of "wp" [s], as it was given."""
        return self._window

    @property
    def steps(self) -> Steps:
        """Which cells lead to a cell."""
        return self._steps

    @property
    def normalization(self) -> Normalization:
        """By what accumulated costs are divided before the least is taken."""
        return self._normalization

    @property
    def pooled(self) -> bool:
        """Whether "wp" has one correlation for all axes."""
        return self._pooled

    # --- with a state that the caller owns ---

    def initial_state(self) -> NDArray:
        """Returns a new state vector (num_states,) that has seen no sample: R[0, 1..n] is infinite."""
        return kernels.initial_state(self.num_states, len(self._reference), self._gamma)

    def phase_at(self, state: NDArray) -> float:
        """Returns the phase in [0, 1] (Eq. 2); 0 before the first sample."""
        self._check(state)
        return float(state[kernels.PHASE])

    def accumulated_cost(self, state: NDArray) -> NDArray:
        """Returns R[i, 1..n] (n,), the cost of the best alignment that ends at each sample; inf where there is none."""
        self._check(state)
        n = len(self._reference)
        out = np.empty(n)
        kernels.write_accumulated_cost(state.copy(), n, self._gamma, out)
        return out

    def local_cost(self, state: NDArray) -> NDArray:
        """Returns the distances (n,) of the last sample to each reference sample; inf before the first one."""
        self._check(state)
        return state[kernels.COST : kernels.COST + len(self._reference)].copy()

    def _check(self, state: NDArray) -> None:
        if state.shape != (self.num_states,):
            raise ValueError(f"state must be a vector of length {self.num_states}, got {state.shape}")

    def _step(self, state: NDArray, sample: NDArray) -> None:
        # A copy, as for a read-only array another version would be compiled.
        kernels.step(state, sample.copy(), *self._model)

    def _take(self, state: NDArray, sample: ArrayLike) -> float:
        """Lines 4-8 of Algorithm 1, in place; returns the phase."""
        try:
            values = np.array(sample, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape == (self.num_axes,):
            phase = kernels.step(state, values, *self._model)
            if phase >= 0.0:
                return phase
        # Says what is wrong. Compiled code has checked the rest in a tenth of the time.
        return kernels.step(state, self._checked_sample(sample).copy(), *self._model)

    # --- batch and streaming ---

    def _phase(self, query: NDArray) -> NDArray:
        phases = np.empty(len(query))
        kernels.phases(self.initial_state(), query.copy(), *self._model, phases)
        return phases

    def update(self, sample: ArrayLike, time: float | None = None) -> float:
        """Takes one more sample and returns the phase; see `Estimator.update`."""
        if time is not None or self._state is None:
            return super().update(sample, time)
        phase = self._take(self._state, sample)
        self._num_samples += 1
        self._last = None
        return phase


def _choice(value: str, name: str, choices: tuple[str, ...]) -> int:
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(choices)}, got {value!r}")
    return choices.index(value)


def _late_derivatives(reference: NDArray) -> NDArray:
    """At each sample the derivative (n, d) at the one before it (Keogh and Pazzani, 2001), as compiled code has it."""
    padded = np.concatenate([reference[:1], reference[:1], reference])
    older, last, this = padded[:-2], padded[1:-1], padded[2:]
    return ((last - older) + (this - older) / 2.0) / 2.0
