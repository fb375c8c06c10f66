"""Several references of one action: each query follows the one that it resembles most."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.errors import InputError

#: Settings that the alignments must share, as costs could not be compared otherwise.
_SHARED = ("num_axes", "sample_period", "distance", "gamma", "steps", "normalization", "pooled")


class SeveralReferences(Estimator):
    """One alignment per reference; the phase of the one with the lowest accumulated cost so far.

    One person's way of doing an action is a poor reference for another's, and which one fits shows in the cost of the
    alignment. Costs are not normalised by the length of a reference: the end is open, all alignments have seen the same
    samples, and a reference is charged for what it had to match. (Dividing by the length of the path, max(i, j),
    makes no difference on the synthetic people.) Ties go to the first.

    The phase may jump when another reference takes the lead; see `Monotone`. Costs time and memory for every reference.

    The state is that of the alignments, one after the other.

    Args:
        alignments: at least one, of the same settings; references and windows may differ.

    Raises:
        InputError: there is none, or their settings differ.
    """

    def __init__(self, alignments: Sequence[OpenEndSoftDTW]) -> None:
        self.alignments = tuple(alignments)
        if not self.alignments:
            raise InputError("alignments must be at least one, got none")
        first = self.alignments[0]
        for k, alignment in enumerate(self.alignments):
            for name in _SHARED:
                mine, others = getattr(alignment, name), getattr(first, name)
                if mine != others:
                    raise InputError(
                        f"alignments[{k}] must have the {name} of alignments[0], {others}, got {mine}: costs could"
                        " not be compared"
                    )
        super().__init__(first.num_axes, sum(one.num_states for one in self.alignments), first.sample_period)
        self._starts = np.cumsum([one.num_states for one in self.alignments])[:-1]

    def initial_state(self) -> NDArray:
        """Returns a new state that has seen no sample."""
        return np.concatenate([one.initial_state() for one in self.alignments])

    def _step(self, state: NDArray, sample: NDArray) -> None:
        for alignment, part in zip(self.alignments, self._parts(state), strict=True):
            alignment._step(part, sample)

    def phase_at(self, state: NDArray) -> float:
        """Returns the phase along the best reference."""
        best, part = self._best_part(state)
        return self.alignments[best].phase_at(part)

    def estimate_at(self, state: NDArray) -> Estimate:
        """Returns the estimate of the best alignment."""
        best, part = self._best_part(state)
        return self.alignments[best].estimate_at(part)

    def best(self, state: NDArray) -> int:
        """Returns the index of the alignment with the lowest accumulated cost; 0 before the first sample."""
        return self._best_part(state)[0]

    def _best_part(self, state: NDArray) -> tuple[int, NDArray]:
        parts = self._parts(state)
        costs = [one.accumulated_cost(part).min() for one, part in zip(self.alignments, parts, strict=True)]
        best = int(np.argmin(costs))
        return best, parts[best]

    def _parts(self, state: NDArray) -> list[NDArray]:
        """Views of the states of the alignments."""
        return np.split(state, self._starts)
