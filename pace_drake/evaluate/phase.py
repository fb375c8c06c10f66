"""Phase estimators compared on one signal set: the paper's Table II, with what it leaves out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import nan
from time import perf_counter

import numpy as np

from pace_drake.demos.signals import ActionSignals, Signal, SignalSet
from pace_drake.dtw.baselines import ConstantPhase, TimeOnly
from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.dtw.filter import PhaseFilter
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.dtw.promp import ProMP
from pace_drake.dtw.scores import FRACTIONS, Score, mean_score, score
from pace_drake.dtw.tune import EU, OE, WP, Tuned
from pace_drake.evaluate.tuning import Job, fused_estimator

#: Table II of the paper: phase MSE on its own training data, of these actions; for orientation only.
PAPER_ACTIONS = ("place rails", "place screws", "screwing")
PAPER_TABLE_II = {OE: (0.100, 0.091, 0.168), EU: (0.012, 0.013, 0.052), WP: (0.002, 0.012, 0.006)}

PARTS = ("train", "heldout_trials", "heldout_people")
CONSTANT, TIME, DERIVATIVE, PROMP, FUSED = "constant 0.5", "time only", "derivative DTW", "ProMP", "fused"
#: In the order of the tables.
ESTIMATORS = (CONSTANT, TIME, OE, EU, DERIVATIVE, PROMP, WP, FUSED)
#: What is tuned, each in a search of its own.
SEARCHES = (OE, EU, WP)


@dataclass(frozen=True)
class Fitted:
    """The estimators of one action, fitted to its training signals.

    Attributes:
        action: its signals.
        estimators: by the name in the tables.
        references: index in ``action.train`` of the reference of those that have one.
        tuned: what the searches found, by metric.
    """

    action: ActionSignals
    estimators: Mapping[str, Estimator]
    references: Mapping[str, int]
    tuned: Mapping[str, Tuned]


def searches(signals: SignalSet, trials: int, seed: int) -> list[Job]:
    """The searches that `fit_all` needs the results of, action by action: on training signals alone.

    Args:
        signals: at least 3 training signals per action.
        trials: settings to score in each.
        seed: of the searches.

    Raises:
        InputError: too few signals of an action.
    """
    return [Job(action, (metric,), trials, seed) for action in signals.actions for metric in SEARCHES]


def fit_all(signals: SignalSet, tuned: Iterable[Tuned]) -> list[Fitted]:
    """The estimators of each action, from the results of `searches` in their order."""
    results = iter(tuned)
    return [fit(action, {metric: next(results) for metric in SEARCHES}) for action in signals.actions]


def fit(action: ActionSignals, tuned: Mapping[str, Tuned]) -> Fitted:
    """All estimators of one action; derivative DTW takes reference and window from Windowed-Pearson, with gamma 0."""
    train = [signal.values for signal in action.train]
    period = action.train[0].sample_period
    num_axes = train[0].shape[1]
    wp = tuned[WP].setting
    derivative = OpenEndSoftDTW(train[wp.reference], 0.0, "derivative", sample_period=period)
    estimators: dict[str, Estimator] = {
        CONSTANT: ConstantPhase(num_axes, sample_period=period),
        TIME: TimeOnly(num_axes, [(len(path) - 1) * period for path in train], period),
        OE: tuned[OE].setting.estimator(train, period),
        EU: tuned[EU].setting.estimator(train, period),
        DERIVATIVE: derivative,
        PROMP: ProMP(train, period),
        WP: wp.estimator(train, period),
        FUSED: fused_estimator(action, tuned[WP]),
    }
    references = {metric: tuned[metric].setting.reference for metric in SEARCHES}
    references |= {DERIVATIVE: wp.reference, FUSED: wp.reference}
    return Fitted(action, {name: estimators[name] for name in ESTIMATORS}, references, tuned)


@dataclass(frozen=True)
class Latency:
    """Wall time of one streaming update [s]."""

    p50: float
    p99: float


@dataclass(frozen=True)
class Evaluation:
    """Scores of all estimators.

    Attributes:
        signals: what they were evaluated on.
        fitted: the estimators, per action.
        scores: [action][estimator][part]; None where the part has no signals. A reference is not scored on itself.
        latency: [estimator], over one signal of each action.
    """

    signals: SignalSet
    fitted: Sequence[Fitted]
    scores: Mapping[str, Mapping[str, Mapping[str, Score | None]]]
    latency: Mapping[str, Latency]

    @property
    def part(self) -> str:
        """The part that says most of what a new person would get: held-out people, or trials if there are none."""
        return PARTS[2] if any(one.heldout_people for one in self.signals.actions) else PARTS[1]

    def mean(self, estimator: str, part: str) -> Score | None:
        """The mean over actions; None where a part has no signals."""
        found = [of_action[estimator][part] for of_action in self.scores.values()]
        present = [one for one in found if one is not None]
        return mean_score(present) if present else None

    def mse(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """``{action: {estimator: {part: MSE or None}}}``, and the mean over actions as ``"mean"``."""
        table = {
            action: {
                name: {part: None if one is None else one.mse for part, one in parts.items()}
                for name, parts in of_action.items()
            }
            for action, of_action in self.scores.items()
        }
        table["mean"] = {
            name: {part: None if (one := self.mean(name, part)) is None else one.mse for part in PARTS}
            for name in ESTIMATORS
        }
        return table

    def rows(self) -> list[dict[str, object]]:
        """One flat row per action, estimator and part, for a CSV file."""
        rows: list[dict[str, object]] = []
        for action, of_action in self.scores.items():
            for name, parts in of_action.items():
                for part, one in parts.items():
                    if one is None:
                        continue
                    row = asdict(one)
                    errors = row.pop("remaining_time_error")
                    row |= {
                        f"remaining_time_error_{fraction:.0%}": error
                        for fraction, error in zip(FRACTIONS, errors, strict=True)
                    }
                    rows.append({"action": action, "estimator": name, "part": part, **row})
        return rows


def evaluate(signals: SignalSet, fitted: Sequence[Fitted]) -> Evaluation:
    """Scores fitted estimators on every part of the signal set that they were fitted to."""
    scores = {
        one.action.action: {name: {part: _score_part(one, name, part) for part in PARTS} for name in one.estimators}
        for one in fitted
    }
    latency = {
        name: _latency([(one.estimators[name], one.action.signals[-1]) for one in fitted]) for name in ESTIMATORS
    }
    return Evaluation(signals, fitted, scores, latency)


def _score_part(fitted: Fitted, name: str, part: str) -> Score | None:
    signals: Sequence[Signal] = getattr(fitted.action, part)
    if part == "train" and name in fitted.references:
        signals = [one for k, one in enumerate(signals) if k != fitted.references[name]]
    if not signals:
        return None
    estimator = fitted.estimators[name]
    return mean_score([_score_signal(estimator, signal) for signal in signals])


def _score_signal(estimator: Estimator, signal: Signal) -> Score:
    intervals = None
    if isinstance(estimator, PhaseFilter):
        intervals = estimator.remaining_time_intervals(signal.values)
    return score(estimator.estimates(signal.values), signal.sample_period, intervals)


def _latency(streams: Iterable[tuple[Estimator, Signal]]) -> Latency:
    times: list[float] = []
    for estimator, signal in streams:
        estimator.update(signal.values[0])  # the first one may compile
        estimator.reset()
        for sample in signal.values:
            begin = perf_counter()
            estimator.update(sample)
            times.append(perf_counter() - begin)
        estimator.reset()
    p50, p99 = np.quantile(times, [0.5, 0.99]) if times else (nan, nan)
    return Latency(float(p50), float(p99))


def example(fitted: Fitted) -> tuple[Signal, dict[str, Estimate]]:
    """One held-out signal of an action, and what each estimator says of it (Fig. 7 of the paper)."""
    signal = (*fitted.action.heldout_people, *fitted.action.heldout_trials)[0]
    return signal, {name: one.estimates(signal.values) for name, one in fitted.estimators.items()}
