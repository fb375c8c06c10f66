"""Whether an action has ended, from the hand alone, so that nobody has to say so."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pace_drake.dtw.baselines import ConstantPhase
from pace_drake.dtw.estimator import number, samples
from pace_drake.dtw.filter import PhaseFilter
from pace_drake.dtw.gate import MovementGate
from pace_drake.errors import InputError


class EndDetector:
    """Says that an action has ended, by two signs.

    - The hand rests where the action ends, and the filter holds an end possible (probability >= `likely`): the sign for
      positions, fast and seldom false.
    - The filter is sure that the duration has passed (probability >= `certain`): the only sign without a `goal`, and
      the last resort with one.

    Once said, it stays said until a new state. The state is [whether it has ended, samples in a row with a sign, the
    filter's state, the rest detector's state].

    Args:
        estimator: the filter of the action.
        goal: (d,) where the hand is at the end, or at the next action's start, such as the mean last sample of the
            demonstrations; None for signals that are no positions.
        radius: [units of a sample] about the goal.
        likely: probability of an end that makes a rest at the goal a sign.
        certain: probability of an end that is a sign by itself.
        hold_time: [s] for which a sign must last.
        rest_speed: [units of a sample / s] see `MovementGate`.
        rest_time: [s] likewise.

    Raises:
        InputError: an argument is out of range; the message names it.
    """

    def __init__(
        self,
        estimator: PhaseFilter,
        goal: ArrayLike | None = None,
        *,
        radius: float = 0.12,
        likely: float = 0.02,
        certain: float = 0.99,
        hold_time: float = 0.3,
        rest_speed: float = 0.02,
        rest_time: float = 0.5,
    ) -> None:
        self.estimator = estimator
        d = estimator.num_axes
        self.goal = None if goal is None else samples(goal, "goal", (d,), f"a vector of {d} values")
        self.radius = number(radius, "radius", "> 0", above=0.0)
        self.likely, self.certain = (
            number(value, name, "a probability in [0, 1]", least=0.0)
            for name, value in (("likely", likely), ("certain", certain))
        )
        if not self.likely <= self.certain <= 1.0:
            raise InputError(f"certain must be in [likely, 1], got {self.certain:g}")
        self._hold = max(round(number(hold_time, "hold_time", ">= 0 [s]", least=0.0) / estimator.sample_period), 1)
        self._rest = MovementGate(ConstantPhase(d, sample_period=estimator.sample_period), rest_speed, rest_time)
        self._split = 2 + estimator.num_states
        self.num_states = self._split + self._rest.num_states

    def initial_state(self) -> NDArray:
        """Returns a new state (num_states,) of an action that has just begun."""
        return np.concatenate([np.zeros(2), self.estimator.initial_state(), self._rest.initial_state()])

    def filter_state(self, state: NDArray) -> NDArray:
        """Returns the view of the filter's part of a state."""
        return state[2 : self._split]

    def step(self, state: NDArray, sample: ArrayLike) -> None:
        """Takes one more sample (d,), in place.

        Raises:
            InputError: the sample has the wrong shape or is not finite; the state is then unchanged.
        """
        of_filter, of_rest = self.filter_state(state), state[self._split :]
        self.estimator.step(of_filter, sample)
        self._rest.step(of_rest, sample)
        state[1] = state[1] + 1.0 if self._sign(of_filter, of_rest, np.asarray(sample)) else 0.0
        if state[1] >= self._hold:
            state[0] = 1.0

    def ended_at(self, state: NDArray) -> bool:
        """Returns whether the action has ended."""
        return bool(state[0])

    def end(self, query: ArrayLike) -> int | None:
        """Returns at which sample of a query (m, d), from 0, the end is said first; None if nowhere.

        Raises:
            InputError: the query cannot be used.
        """
        d = self.estimator.num_axes
        state = self.initial_state()
        for i, sample in enumerate(samples(query, "query", (-1, d), f"an (m, {d}) array")):
            self.step(state, sample)
            if self.ended_at(state):
                return i
        return None

    def _sign(self, of_filter: NDArray, of_rest: NDArray, sample: NDArray) -> bool:
        probability = self.estimator.end_probability(of_filter)
        if probability >= self.certain:
            return True
        return (
            self.goal is not None
            and probability >= self.likely
            and float(np.linalg.norm(sample - self.goal)) <= self.radius
            and self._rest.rests_at(of_rest)
        )
