"""Tuning the estimators of all actions of a signal set, in parallel processes."""

import math
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from queue import Empty, Queue
from typing import cast

import numpy as np

from pace_drake.demos.signals import ActionSignals, SignalSet, folder_signals, synthetic_signals, watch_signals
from pace_drake.dtw.baselines import TimeOnly
from pace_drake.dtw.estimator_file import ActionEstimator, EstimatorFile
from pace_drake.dtw.filter import PhaseFilter
from pace_drake.dtw.scores import mean_squared_error
from pace_drake.dtw.tune import Tuned, stretched, tune
from pace_drake.errors import require
from pace_drake.processes import worker_processes


def load_signals(data: str, seed: int) -> SignalSet:
    """Returns the signals that a command line names.

    Args:
        data: "synthetic", "watch", or else a folder of demonstration files ("./watch" for one of such a name).
        seed: of the synthetic people.

    Raises:
        InputError: the data cannot be used.
    """
    if data == "synthetic":
        return synthetic_signals(seed)
    return watch_signals() if data == "watch" else folder_signals(data)


@dataclass(frozen=True)
class Job:
    """One search: of one action, among some metrics.

    Attributes:
        signals: of the action; its training part is used only.
        metrics: see `pace_drake.dtw.tune.tune`.
        trials: settings to score.
        seed: of the search.
        stretches: see `tune`.
        journal: where trials are kept; None for nowhere.

    Raises:
        InputError: too few training signals.
    """

    signals: ActionSignals
    metrics: tuple[str, ...]
    trials: int
    seed: int
    stretches: tuple[float, ...] = (1.0,)
    journal: Path | None = None

    def __post_init__(self) -> None:
        require(
            len(self.signals.train) >= 3,
            f"action {self.signals.action!r}",
            f"needs at least 3 training signals, got {len(self.signals.train)}: one becomes the reference, and a spread"
            " needs 2 more",
        )


#: What is called after a trial: (number of the job, trials done, best score so far).
OnTrial = Callable[[int, int, float], object]


def run_jobs(jobs: Iterable[Job], num_processes: int, on_trial: OnTrial = lambda *_: None) -> list[Tuned]:
    """Runs searches, and returns their results in the order of the jobs; the number of processes does not change them.

    Args:
        jobs: at least one.
        num_processes: how many run at a time; with 1 they run here.
        on_trial: called after each trial.

    Raises:
        InputError: as `tune`.
    """
    jobs = list(jobs)
    if num_processes == 1:
        return [_run(job, number, on_trial) for number, job in enumerate(jobs)]
    with get_context("spawn").Manager() as manager, worker_processes(min(num_processes, len(jobs))) as workers:
        queue = cast("Queue[tuple[int, int, float]]", manager.Queue())
        futures = [workers.submit(_run, job, number, _Put(queue)) for number, job in enumerate(jobs)]
        pending = set(futures)
        while pending:
            done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            _report(queue, on_trial)
            for future in done:
                future.result()  # one that failed ends them all; what the others have found is in their journals
        return [future.result() for future in futures]


@dataclass(frozen=True)
class _Put:
    """Passes a report on to another process; a class, so that it can be sent there itself."""

    queue: "Queue[tuple[int, int, float]]"

    def __call__(self, number: int, done: int, best: float) -> None:
        self.queue.put((number, done, best))


def _report(queue: "Queue[tuple[int, int, float]]", on_trial: OnTrial) -> None:
    while True:
        try:
            message = queue.get_nowait()
        except Empty:
            return
        on_trial(*message)


def _run(job: Job, number: int, on_trial: OnTrial) -> Tuned:
    train = job.signals.train
    return tune(
        [signal.values for signal in train],
        [signal.subject for signal in train],
        train[0].sample_period,
        metrics=job.metrics,
        trials=job.trials,
        seed=job.seed,
        stretches=job.stretches,
        journal=job.journal,
        on_trial=lambda done, best: on_trial(number, done, best),
    )


def left_out_time_score(action: ActionSignals, stretches: Iterable[float] = (1.0,)) -> float:
    """Mean over people of the squared error of time alone on each, with the mean duration of the others.

    What `Tuned.left_out_score` has to beat. NaN for a single person.

    Args:
        action: its training part is used only.
        stretches: each signal is also scored stretched by these factors, as in `tune`.
    """
    factors = tuple(stretches)
    scores = []
    for person in dict.fromkeys(one.subject for one in action.train):
        others = [
            (len(one.values) - 1) * one.sample_period * factor
            for one in action.train
            if one.subject != person
            for factor in factors
        ]
        if not others:
            return math.nan
        theirs = [one for one in action.train if one.subject == person]
        time = TimeOnly(theirs[0].values.shape[1], others, theirs[0].sample_period)
        phases = time.phases(stretched(one.values, factor) for one in theirs for factor in factors)
        scores.append(np.mean([mean_squared_error(z) for z in phases]))
    return float(np.mean(scores))


def fused_estimator(action: ActionSignals, tuned: Tuned) -> PhaseFilter:
    """The filter over a tuned alignment, calibrated on the training signals other than the reference."""
    period = action.train[0].sample_period
    estimator = tuned.setting.estimator([signal.values for signal in action.train], period)
    reference = action.train[tuned.setting.reference]
    others = [signal for signal in action.train if signal is not reference]
    num_people = len({signal.subject for signal in action.train})
    return PhaseFilter.fit(
        estimator,
        [signal.values for signal in others],
        (len(reference.values) - 1) * period,
        num_people if num_people > 1 else None,
    )


def estimator_file(signals: SignalSet, tuned: Iterable[Tuned]) -> EstimatorFile:
    """What `pace tune` writes: one tuned and calibrated estimator per action."""
    actions = {}
    for action, one in zip(signals.actions, tuned, strict=True):
        reference = action.train[one.setting.reference]
        score = {"train_mse": one.score, "trials": float(one.num_trials)}
        if math.isfinite(one.left_out_score):
            score["left_out_mse"] = one.left_out_score
        actions[action.action] = ActionEstimator(
            one.setting.distance,
            one.setting.gamma,
            one.setting.window,
            reference.name,
            reference.values,
            fused_estimator(action, one).calibration,
            score,
            np.mean([signal.values[-1] for signal in action.train], axis=0),
        )
    return EstimatorFile(signals.description, signals.actions[0].train[0].sample_period, signals.units, actions)
