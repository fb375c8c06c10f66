"""The median of several phases."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pace_drake.dtw.estimator import Estimator
from pace_drake.errors import InputError


class MedianPhase(Estimator):
    """The median of the phases of several estimators of one action, such as alignments with several people's trials.

    A person's trial is a poor reference for another person in some places, and a distance is blind to some motions;
    alignments that differ in both err in different places, and one that is lost does not move the median. Unlike
    `SeveralReferences` it need not compare their costs. An ensemble of alignments is ours.

    The state is that of the estimators, one after the other.

    Args:
        estimators: at least one, of the same axes and sample period.

    Raises:
        InputError: there is none, or their axes or sample periods differ.
    """

    def __init__(self, estimators: Sequence[Estimator]) -> None:
        self.estimators = tuple(estimators)
        if not self.estimators:
            raise InputError("estimators must be at least one, got none")
        first = self.estimators[0]
        for k, one in enumerate(self.estimators):
            for name in ("num_axes", "sample_period"):
                mine, others = getattr(one, name), getattr(first, name)
                if mine != others:
                    raise InputError(f"estimators[{k}] must have the {name} of estimators[0], {others}, got {mine}")
        super().__init__(first.num_axes, sum(one.num_states for one in self.estimators), first.sample_period)
        self._starts = np.cumsum([one.num_states for one in self.estimators])[:-1]

    def initial_state(self) -> NDArray:
        """Returns a new state that has seen no sample."""
        return np.concatenate([one.initial_state() for one in self.estimators])

    def _step(self, state: NDArray, sample: NDArray) -> None:
        for one, part in zip(self.estimators, np.split(state, self._starts), strict=True):
            one._step(part, sample)

    def phase_at(self, state: NDArray) -> float:
        """Returns the median of the phases."""
        parts = np.split(state, self._starts)
        return float(np.median([one.phase_at(part) for one, part in zip(self.estimators, parts, strict=True)]))

    def _phase(self, query: NDArray) -> NDArray:
        return np.median([one._phase(query) for one in self.estimators], axis=0)
