"""Which action a person is doing, from the same rows that give the phase."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_softmax, softmax

from pace_drake.dtw.estimator import number, samples
from pace_drake.dtw.open_end import Distance, OpenEndSoftDTW
from pace_drake.errors import InputError


class ActionRecognizer:
    """Posterior over actions: each is as likely as its best alignment so far is cheap.

    Every action has one or more references, best of different people. The log-likelihood of an action is minus the
    lowest accumulated cost of its references, over a temperature: neighbouring samples share most of their window, so
    that costs must not be taken as independent evidence. Priors are equal.

    The state is one vector: those of all alignments, one after the other.

    Args:
        references: per action at least one (n, d).
        temperature: [cost] > 0; `fit` finds it.
        distance: of `OpenEndSoftDTW`, as are the others; the same for all, so that costs compare.
        gamma: [cost]
        window: [s]
        sample_period: [s]

    Raises:
        InputError: an argument cannot be used; the message names it.
    """

    def __init__(
        self,
        references: Mapping[str, Sequence[ArrayLike]],
        temperature: float = 10.0,
        *,
        distance: Distance = "wp",
        gamma: float = 0.3,
        window: float = 1.0,
        sample_period: float = 0.1,
    ) -> None:
        if not references or not all(len(group) for group in references.values()):
            raise InputError("references must hold at least one reference for each of at least one action")
        self.actions = tuple(references)
        self.temperature = number(temperature, "temperature", "> 0 [cost]", above=0.0)
        self._alignments = [
            OpenEndSoftDTW(one, gamma, distance, window, sample_period=sample_period)
            for group in references.values()
            for one in group
        ]
        self.num_axes = self._alignments[0].num_axes
        if any(one.num_axes != self.num_axes for one in self._alignments):
            raise InputError("references must all have the same number of axes")
        self._first = np.cumsum([0, *(len(group) for group in references.values())])[:-1]
        self._ends = np.cumsum([one.num_states for one in self._alignments])
        self.num_states = int(self._ends[-1])

    def initial_state(self) -> NDArray:
        """Returns a new state (num_states,)."""
        return np.concatenate([one.initial_state() for one in self._alignments])

    def step(self, state: NDArray, sample: ArrayLike) -> None:
        """Takes one more sample (d,), in place.

        Raises:
            InputError: the sample has the wrong shape or is not finite; the state is then unchanged.
        """
        for alignment, part in zip(self._alignments, self._parts(state), strict=True):
            alignment.step(part, sample)

    def probabilities_at(self, state: NDArray) -> NDArray:
        """Returns the probability (num_actions,) of each of `actions`; equal before the first sample."""
        costs = self._costs(state)
        return softmax(-costs / self.temperature) if np.isfinite(costs).all() else np.full(costs.size, 1 / costs.size)

    def probabilities(self, query: ArrayLike) -> NDArray:
        """Probabilities (m, num_actions) after each sample of a query (m, d).

        Raises:
            InputError: the query cannot be used.
        """
        return softmax(-self._costs_over(query) / self.temperature, axis=1)

    @classmethod
    def fit(
        cls,
        demonstrations: Mapping[str, Sequence[ArrayLike]],
        people: Mapping[str, Sequence[str]],
        *,
        distance: Distance = "wp",
        gamma: float = 0.3,
        window: float = 1.0,
        sample_period: float = 0.1,
        horizon: float = 10.0,
    ) -> "ActionRecognizer":
        """Returns a recogniser with one reference per person and action, and the temperature that fits best.

        The temperature minimises the log-loss of what each person's demonstrations are taken for by the references of
        the others.

        Args:
            demonstrations: per action (m_k, d) each.
            people: who showed each; at least 2 people.
            distance, gamma, window, sample_period: see the class.
            horizon: [s] from the start of an action within which probabilities should be right.

        Raises:
            InputError: fewer than 2 people, or a demonstration that cannot be used.
        """
        names = sorted({name for group in people.values() for name in group})
        if len(names) < 2:
            raise InputError("people must be at least 2: one to learn from and one to test on")
        # The demonstration of median length of each person stands for them.
        chosen: dict[str, dict[str, ArrayLike]] = {}
        for action, group in demonstrations.items():
            chosen[action] = {}
            for name in names:
                theirs = [one for one, who in zip(group, people[action], strict=True) if who == name]
                if theirs:
                    chosen[action][name] = sorted(theirs, key=np.shape)[(len(theirs) - 1) // 2]
        settings = {"distance": distance, "gamma": gamma, "window": window, "sample_period": sample_period}
        every_sample = max(round(1.0 / sample_period), 1)  # neighbours say the same
        costs, truth = [], []
        for name in names:
            others = {
                action: [one for who, one in by_person.items() if who != name] for action, by_person in chosen.items()
            }
            if not all(others.values()):
                continue  # the only one who showed some action
            recognizer = cls(others, **settings)  # type: ignore[arg-type]
            for k, action in enumerate(recognizer.actions):
                if name in chosen[action]:
                    query = np.asarray(chosen[action][name])[: round(horizon / sample_period)]
                    rows = recognizer._costs_over(query)[every_sample - 1 :: every_sample]
                    costs.append(rows)
                    truth.append(np.full(len(rows), k))
        if not costs:
            raise InputError("people: every action needs demonstrations of at least 2 people")
        table, right = np.concatenate(costs), np.concatenate(truth)

        def log_loss(log_temperature: float) -> float:
            return -float(np.mean(log_softmax(-table / np.exp(log_temperature), axis=1)[np.arange(len(right)), right]))

        from scipy.optimize import minimize_scalar  # 0.2 s, which is spent only where one is fitted

        best = minimize_scalar(log_loss, bounds=(-7.0, 12.0), method="bounded")
        references = {action: list(by_person.values()) for action, by_person in chosen.items()}
        return cls(references, float(np.exp(best.x)), **settings)  # type: ignore[arg-type]

    def _parts(self, state: NDArray) -> list[NDArray]:
        return np.split(state, self._ends[:-1])

    def _costs(self, state: NDArray) -> NDArray:
        lowest = [
            alignment.accumulated_cost(part).min()
            for alignment, part in zip(self._alignments, self._parts(state), strict=True)
        ]
        return np.minimum.reduceat(lowest, self._first)

    def _costs_over(self, query: ArrayLike) -> NDArray:
        d = self.num_axes
        rows = samples(query, "query", (-1, d), f"an (m, {d}) array")
        if len(rows) == 0:
            raise InputError("query must have at least 1 sample, got none")
        state = self.initial_state()
        costs = np.empty((len(rows), len(self.actions)))
        for i, sample in enumerate(rows):
            self.step(state, sample)
            costs[i] = self._costs(state)
        return costs
