"""A study with participants, simulated: what its tests would say, and how often they would say it.

Every participant works with every method, a few trials each; a participant's figure is the mean cost over their trials
with a method (paper, Sec. V-D: 12 people, 2 trials, Wilcoxon's signed-rank test).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import stats

#: As in the paper.
NUM_PARTICIPANTS, NUM_TRIALS = 12, 2
#: Numbers of participants whose power is told.
SIZES = (12, 24, 36)


@dataclass(frozen=True)
class PairTest:
    """Two methods, compared by the costs of the same participants.

    Attributes:
        first, second: their names.
        difference: [s] mean cost of the first minus that of the second.
        p: two-sided, of the exact Wilcoxon signed-rank test.
        p_holm: after Holm's correction for all pairs of the study.
        effect: matched-pairs rank-biserial correlation in [-1, 1]; above 0 the second costs less.
    """

    first: str
    second: str
    difference: float
    p: float
    p_holm: float
    effect: float


@dataclass(frozen=True)
class Study:
    """What one study says.

    Attributes:
        participants, trials: how many.
        means: [s] by method.
        friedman_p: of the Friedman test over all methods; NaN with fewer than 3.
        pairs: every two methods.
    """

    participants: int
    trials: int
    means: dict[str, float]
    friedman_p: float
    pairs: tuple[PairTest, ...]


class Participants:
    """People of whom many episodes are known, with every method: studies are drawn from them.

    Args:
        costs: by method, (E,) [s] of the same episodes.
        person: (E,) who played each.
    """

    def __init__(self, costs: Mapping[str, np.ndarray], person: np.ndarray) -> None:
        self.costs = dict(costs)
        self._episodes = [np.flatnonzero(person == one) for one in np.unique(person)]

    @property
    def number(self) -> int:
        """How many people there are."""
        return len(self._episodes)

    def draw(
        self, participants: int, trials: int, rng: np.random.Generator, methods: Sequence[str] | None = None
    ) -> dict[str, np.ndarray]:
        """Mean costs (participants,) by method of a study; trials are drawn for each method by itself.

        Args:
            participants, trials: how many.
            rng: the only source of randomness.
            methods: None: all.
        """
        who = rng.choice(self.number, size=participants, replace=participants > self.number)
        return {
            method: np.array([self.costs[method][rng.choice(self._episodes[k], size=trials)].mean() for k in who])
            for method in methods or self.costs
        }

    def study(self, participants: int, trials: int, rng: np.random.Generator) -> Study:
        """One study and its tests."""
        return study_of(self.draw(participants, trials, rng), trials)

    def power(
        self, first: str, second: str, participants: int, trials: int, studies: int, rng: np.random.Generator
    ) -> float:
        """Share of studies in which two methods differ with p < 0.05, the second costing less."""
        found = 0
        for _ in range(studies):
            drawn = self.draw(participants, trials, rng, (first, second))
            difference = drawn[first] - drawn[second]
            found += difference.mean() > 0 and _wilcoxon(difference) < 0.05
        return found / studies


def study_of(costs: Mapping[str, np.ndarray], trials: int) -> Study:
    """The tests of a study.

    Args:
        costs: by method, (P,) [s] of the same participants.
        trials: of each participant with each method, for the record.
    """
    names = list(costs)
    pairs = list(combinations(names, 2))
    differences = [costs[a] - costs[b] for a, b in pairs]
    raw = [_wilcoxon(d) for d in differences]
    return Study(
        participants=len(next(iter(costs.values()))),
        trials=trials,
        means={name: float(values.mean()) for name, values in costs.items()},
        friedman_p=float(stats.friedmanchisquare(*costs.values()).pvalue) if len(names) > 2 else float("nan"),
        pairs=tuple(
            PairTest(a, b, float(d.mean()), p, corrected, rank_biserial(d))
            for (a, b), d, p, corrected in zip(pairs, differences, raw, holm(raw), strict=True)
        ),
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down correction (1979)."""
    order = np.argsort(p_values)
    corrected, so_far = np.empty(len(p_values)), 0.0
    for rank, k in enumerate(order):
        so_far = max(so_far, min(1.0, (len(p_values) - rank) * p_values[k]))
        corrected[k] = so_far
    return corrected.tolist()


def rank_biserial(difference: np.ndarray) -> float:
    """Matched-pairs rank-biserial correlation: (W+ - W-) / (W+ + W-) (Kerby 2014); 0 if nothing differs."""
    nonzero = difference[difference != 0]
    if not len(nonzero):
        return 0.0
    ranks = stats.rankdata(np.abs(nonzero))
    return float((ranks[nonzero > 0].sum() - ranks[nonzero < 0].sum()) / ranks.sum())


def _wilcoxon(difference: np.ndarray) -> float:
    if not difference.any():
        return 1.0
    return float(stats.wilcoxon(difference, method="exact").pvalue)
