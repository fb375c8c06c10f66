"""Tuning open-end soft-DTW for one action: its reference, metric, smoothing and window, from demonstrations.

The paper tunes gamma and w by Bayesian optimisation against a linear phase, for a given reference (Sec. IV-A). Here the
reference is chosen as well, as it moves the error most. For each metric:

1. every demonstration is probed as the reference, with a few settings spread over the range;
2. Bayesian optimisation (Optuna's Gaussian-process sampler) goes on from the probes of the best references, over
   reference, gamma (its logarithm; the lowest part of the range means 0) and window.

A setting's score is the mean squared error of the phase over the demonstrations of people other than the reference's.
The Gaussian process sees its logarithm: errors spread over decades, and it is the small ones that matter.

Every setting keeps the error of every demonstration. So the report of what a new person would get (each person left
out, the best setting for the others taken, scored on the one left out) costs no further alignment.
"""

import hashlib
import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pace_drake.dtw.estimator import samples
from pace_drake.dtw.open_end import Distance, OpenEndSoftDTW
from pace_drake.dtw.scores import linear_phase, mean_squared_error
from pace_drake.errors import InputError, require

#: Metrics by the paper's names: hard minimum with Euclidean distance, and soft-DTW with either distance.
WP, EU, OE = "OS-DTW_WP", "OS-DTW_EU", "OE-DTW"
_DISTANCES: dict[str, Distance] = {WP: "wp", EU: "euclidean", OE: "euclidean"}

#: Copies of each demonstration, stretched in time by these, as training of policies makes them (paper, Sec. IV-C).
STRETCHES = (0.75, 1.0, 1.3)

# Decades of gamma over the typical local cost c. Where costs do not inform, the soft minimum advances by itself, at
# unit speed with gamma = c / ln 3 (-0.04 here): above the range there is little but this clock.
_LOG_GAMMA = (-3.25, 0.75)
_LEAST_LOG_GAMMA = -3.0  # below it gamma is 0
_WINDOW = (0.3, 3.0)  # [s]
_PROBES = ((-2.0, 0.5), (-1.0, 0.8), (-0.5, 1.2), (0.0, 0.8))  # (log gamma, window)
_NUM_REFERENCES = 3  # that the optimisation may choose among
_MOST_CANDIDATES = 24  # for the reference: probing costs their number times that of demonstrations


@dataclass(frozen=True)
class Setting:
    """Settings of an estimator, and which demonstration is its reference."""

    distance: Distance
    gamma: float  # [cost]
    window: float  # [s]
    reference: int  # index of the demonstration

    def estimator(self, demonstrations: Sequence[NDArray], sample_period: float) -> OpenEndSoftDTW:
        """Returns the estimator; ``sample_period`` in [s]."""
        return OpenEndSoftDTW(
            demonstrations[self.reference], self.gamma, self.distance, self.window, sample_period=sample_period
        )


@dataclass(frozen=True)
class Tuned:
    """What tuning found for one action.

    Attributes:
        setting: the best one.
        score: its mean squared error over the demonstrations of people other than the reference's.
        left_out_score: mean over people of the error on each, when tuned without them; NaN with fewer than 3.
        num_trials: how many settings the optimisation scored, the references' probes not counted.
    """

    setting: Setting
    score: float
    left_out_score: float
    num_trials: int


def tune(
    demonstrations: Sequence[NDArray],
    people: Sequence[str],
    sample_period: float,
    *,
    metrics: Sequence[str] = (WP, EU),
    trials: int = 60,
    seed: int = 0,
    stretches: Sequence[float] = (1.0,),
    journal: Path | None = None,
    on_trial: Callable[[int, float], object] = lambda done, best: None,
) -> Tuned:
    """Tunes the estimator of one action.

    Args:
        demonstrations: at least 2, (m_k, d) each.
        people: who showed each.
        sample_period: [s].
        metrics: which of `WP`, `EU`, `OE` to choose among. `OE` has only its reference to tune, which takes no trials.
        trials: how many settings to score after the probes, shared out evenly among the metrics.
        seed: same seed, same result, also if the search was interrupted and taken up again.
        stretches: each demonstration is also scored stretched by these factors; 1.0 is itself.
        journal: a file to which trials are appended; if it holds some of the same search, they are not done again.
        on_trial: called after each trial with how many are done and the best score so far.

    Raises:
        InputError: too few demonstrations, one that cannot be used, a journal of another search, or Optuna is missing.
    """
    if len(demonstrations) < 2 or len(people) != len(demonstrations):
        raise InputError(f"demonstrations must be at least 2, each with its person, got {len(demonstrations)}")
    for metric in metrics:
        require(metric in _DISTANCES, "metrics", f"must be among {', '.join(_DISTANCES)}, got {metric!r}")
    d = np.shape(demonstrations[0])[-1]
    paths = [
        samples(one, f"demonstrations[{k}]", (-1, d), f"an (m, {d}) array") for k, one in enumerate(demonstrations)
    ]
    search = _Search(paths, list(people), sample_period, tuple(stretches))
    log = None if journal is None else _Journal(journal, search.identity(seed))
    optimised = [metric for metric in metrics if metric != OE]
    if OE in metrics:
        search.probe(OE, [(-math.inf, _WINDOW[0])])
    for k, metric in enumerate(optimised):
        # The first metrics take the trials that cannot be shared out.
        search.optimise(metric, len(range(k, trials, len(optimised))), seed, log, on_trial)
    return search.result()


class _Search:
    """Demonstrations with their stretched copies, and the settings scored on them so far."""

    def __init__(self, paths: list[NDArray], people: list[str], sample_period: float, stretches: tuple[float, ...]):
        self._paths, self._people, self._period = paths, people, sample_period
        self._stretches = stretches
        self._copies = [[stretched(path, factor) for factor in stretches] for path in paths]
        self._errors: dict[Setting, NDArray] = {}  # (num_demonstrations,), in the order of scoring
        self._num_trials = 0

    def identity(self, seed: int) -> str:
        """A digest of all that trials depend on but the metric: a journal must not be used for another search."""
        content = hashlib.sha256(repr((seed, self._period, self._stretches, self._people, _PROBES)).encode())
        for path in self._paths:
            content.update(repr(path.shape).encode() + path.tobytes())
        return content.hexdigest()

    def probe(self, metric: str, probes: Sequence[tuple[float, float]] = _PROBES) -> list[int]:
        """Scores each candidate for the reference with a few (log gamma, window), and returns them, best first."""
        lengths = np.array([len(path) for path in self._paths])
        candidates = np.argsort(np.abs(lengths - np.median(lengths)), kind="stable")[:_MOST_CANDIDATES]
        scale = self._scale(_DISTANCES[metric])
        best = [
            min(self._score(self._setting(metric, scale, *probe, reference)) for probe in probes)
            for reference in candidates.tolist()
        ]
        return candidates[np.argsort(best, kind="stable")].tolist()

    def optimise(
        self, metric: str, trials: int, seed: int, journal: "_Journal | None", on_trial: Callable[[int, float], object]
    ) -> None:
        """Bayesian optimisation of one metric, which goes on from the journal."""
        try:
            import optuna
            import torch  # noqa: F401  Optuna's Gaussian processes need it, and would say so only later
        except ModuleNotFoundError as error:
            raise InputError(f"tuning needs {error.name}: install it with pip install 'pace_drake[tune]'") from None
        from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution

        references = self.probe(metric)[:_NUM_REFERENCES]
        scale = self._scale(_DISTANCES[metric])
        space: dict[str, BaseDistribution] = {
            "log_gamma": FloatDistribution(*_LOG_GAMMA),
            "reference": CategoricalDistribution(references),
        }
        if metric == WP:  # other metrics have no window
            space["window"] = FloatDistribution(*_WINDOW, log=True)

        def setting(params: dict[str, Any]) -> Setting:
            return self._setting(
                metric, scale, params["log_gamma"], params.get("window", _WINDOW[0]), params["reference"]
            )

        def log_score(params: dict[str, Any]) -> float:
            return math.log(max(self._score(setting(params)), 1e-12))

        def known(params: dict[str, Any]) -> optuna.trial.FrozenTrial:
            return optuna.trial.create_trial(params=params, distributions=space, value=log_score(params))

        verbosity = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        # The matrices are tiny: threads of linear algebra would wait for one another longer than they work. `pace` has
        # one thread already; whoever calls this from elsewhere has as many as cores, and waited twice as long.
        limits = threadpool_limits(1)
        try:
            study = optuna.create_study()
            for reference in references:
                for log_gamma, window in _PROBES:
                    params = {"log_gamma": log_gamma, "reference": reference, "window": window}
                    study.add_trial(known({name: params[name] for name in space}))
            for number in range(trials):
                if journal is not None and (row := journal.row(metric, number)) is not None:
                    params = row["params"]
                    self._errors[setting(params)] = np.array(row["errors"], dtype=float)
                    study.add_trial(known(params))
                else:
                    # A sampler of its own for each trial: what it proposes depends on the trials before only, and not
                    # on whether the search was interrupted between them.
                    own_seed = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
                    study.sampler = optuna.samplers.GPSampler(seed=own_seed, n_startup_trials=0)
                    trial = study.ask(space)
                    study.tell(trial, log_score(trial.params))
                    if journal is not None:
                        journal.add(metric, number, trial.params, self._errors[setting(trial.params)])
                self._num_trials += 1
                on_trial(self._num_trials, self._best()[1])
        finally:
            limits.restore_original_limits()
            optuna.logging.set_verbosity(verbosity)

    def result(self) -> Tuned:
        """The best setting of all that were scored."""
        return Tuned(*self._best(), self._left_out(), self._num_trials)

    def _setting(self, metric: str, scale: float, log_gamma: float, window: float, reference: int) -> Setting:
        """A setting in figures that people can read; windows are whole samples."""
        gamma = 0.0 if log_gamma < _LEAST_LOG_GAMMA else float(f"{scale * 10.0**log_gamma:.3g}")
        num_samples = max(round(window / self._period), 2)
        return Setting(_DISTANCES[metric], gamma, float(f"{num_samples * self._period:.9g}"), reference)

    def _scale(self, distance: Distance) -> float:
        """The typical local cost, over which gamma is searched: a metric's costs have units."""
        estimator = OpenEndSoftDTW(self._paths[0], 0.0, distance, 1.0, sample_period=self._period)
        costs = []
        for path in self._paths[1:]:
            state = estimator.initial_state()
            for sample in path:
                estimator.step(state, sample)
                costs.append(np.median(estimator.local_cost(state)))
        return max(float(np.median(costs)), 1e-9)

    def _score(self, setting: Setting) -> float:
        """The mean error of a setting; errors are NaN for the demonstrations of the reference's person."""
        if setting not in self._errors:
            estimator = setting.estimator(self._paths, self._period)
            self._errors[setting] = np.array(
                [
                    np.mean([mean_squared_error(z) for z in estimator.phases(copies)])
                    if self._is_test(k, setting.reference)
                    else math.nan
                    for k, copies in enumerate(self._copies)
                ]
            )
        return float(np.nanmean(self._errors[setting]))

    def _is_test(self, k: int, reference: int) -> bool:
        one_person = len(set(self._people)) == 1
        return k != reference and (one_person or self._people[k] != self._people[reference])

    def _best(self) -> tuple[Setting, float]:
        scores = {setting: float(np.nanmean(errors)) for setting, errors in self._errors.items()}
        best = min(scores, key=scores.__getitem__)
        return best, scores[best]

    def _left_out(self) -> float:
        settings, table = list(self._errors), np.array(list(self._errors.values()))
        scores = []
        for person in dict.fromkeys(self._people):
            theirs = np.array([one == person for one in self._people])
            # Settings whose reference is this person's cannot be tested on them, nor may they be used.
            usable = [k for k, one in enumerate(settings) if not theirs[one.reference]]
            others = table[usable][:, ~theirs]
            if np.isfinite(others).any(axis=1).all() and usable:
                best = usable[int(np.argmin(np.nanmean(others, axis=1)))]
                scores.append(np.mean(table[best, theirs]))
        return float(np.mean(scores)) if scores else math.nan


class _Journal:
    """The trials of one search, one line of JSON each after a first line that says which search it is.

    Args:
        path: made if it is not there. A last line that was cut short is dropped.
        search: digest of the search.

    Raises:
        InputError: the file is of another search, is no journal, or cannot be written.
    """

    def __init__(self, path: Path, search: str) -> None:
        self._path = path
        try:
            content = path.read_bytes() if path.exists() else b""
            whole = content[: content.rfind(b"\n") + 1]
            if whole != content:
                os.truncate(path, len(whole))
            header, *rows = [json.loads(line) for line in whole.splitlines()] or [{"search": search}]
            self._rows = {(row["metric"], row["number"]): row for row in rows}
            if not whole:
                self._append(header)
        except OSError as error:
            raise InputError(f"{path}: cannot be used as journal: {error.strerror}") from None
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: is no journal of a search; remove it or name another") from None
        if header != {"search": search}:
            raise InputError(
                f"{path}: belongs to another search (other data, seed or stretching); remove it or name another"
            )

    def row(self, metric: str, number: int) -> dict[str, Any] | None:
        """The trial of this number, with its ``params`` and ``errors``; None if it has not been done."""
        return self._rows.get((metric, number))

    def add(self, metric: str, number: int, params: dict[str, Any], errors: NDArray) -> None:
        """Appends a trial."""
        row = {"metric": metric, "number": number, "params": params}
        self._append(row | {"errors": [None if math.isnan(error) else float(error) for error in errors]})

    def _append(self, row: dict[str, Any]) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")


def stretched(path: NDArray, factor: float) -> NDArray:
    """Returns a path (m, d) played `factor` times as long, linearly interpolated: about (factor * m, d)."""
    if factor == 1.0:
        return path
    length = max(round((len(path) - 1) * factor), 1) + 1
    at = linear_phase(length) * (len(path) - 1)
    return np.column_stack([np.interp(at, np.arange(len(path)), axis) for axis in path.T])
