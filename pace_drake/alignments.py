"""Alignments of a scenario's actions: with which reference, of which kind, and how a filter over them is calibrated."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pace_drake.demos import Demonstration
from pace_drake.dtw.ensemble import MedianPhase
from pace_drake.dtw.estimator import Estimator
from pace_drake.dtw.filter import Calibration
from pace_drake.dtw.open_end import Distance, OpenEndSoftDTW
from pace_drake.scenario import EstimatorConfig
from pace_drake.task import Duration, HumanAction

#: Quantiles of the drawn durations to which training trials are stretched: for calibrations, and to judge references.
_CALIBRATED_AT, _FAST_AND_SLOW = np.array([0.1, 0.5, 0.9]), np.array([0.1, 0.9])
#: True phases at which references are judged, and the slope that a phase is taken to have at least.
_DECISIVE, _LEAST_SLOPE = np.linspace(0.3, 0.95, 14), 0.2
#: Smoothing of the alignments that an ensemble adds, by distance, in its units [m/s], [m].
_ENSEMBLE_GAMMA = {"derivative": 0.02, "euclidean": 0.05}


def choose_reference(
    duration: Duration,
    config: EstimatorConfig,
    candidates: Sequence[Demonstration],
    training: Sequence[Demonstration],
    period: float,
) -> Demonstration:
    """The candidate whose alignment tells most about the other people (Sec. III: one trajectory is selected).

    That is the one with the least ``spread``. A lead or lag that is the same for all costs nothing, as a policy learns
    what a phase means. On the reference a phase depends more than on any setting, and known people foretell well what
    it is worth for others.

    Args:
        duration: of the action; the trials are played fast and slow, as people differ when durations are drawn.
        config: of the paper's alignment.
        candidates: at least one.
        training: trials of at least two people; a candidate is not judged by its own person's.
        period: [s] of the tracker.
    """
    lengths = duration.quantile(_FAST_AND_SLOW).tolist()
    played = [(d.subject, _stretched(d, seconds, period), seconds) for d in training for seconds in lengths]

    def judged(candidate: Demonstration) -> float:
        others = [(hand, seconds) for subject, hand, seconds in played if subject != candidate.subject]
        phases = make_alignment(config, candidate, period).phases([hand for hand, _ in others], num_threads=2)
        return spread(phases, [seconds for _, seconds in others], period)

    return min(candidates, key=judged)


def spread(phases: Sequence[NDArray], durations: Sequence[float], period: float) -> float:
    """How differently an alignment judges people who are equally far, as a root mean square of the true phase.

    Over the part of an action in which decisions are made, the standard deviation of the phases of all people at the
    same true phase, divided by the slope of their mean there: a phase that does not move tells nothing.

    Args:
        phases: (m_k,) each, of several people.
        durations: [s] of each.
        period: [s] between samples.
    """
    at = np.array(
        [
            np.interp(_DECISIVE, np.arange(len(one)) * period / seconds, one)
            for one, seconds in zip(phases, durations, strict=True)
        ]
    )
    slope = np.maximum(np.gradient(at.mean(axis=0), _DECISIVE), _LEAST_SLOPE)
    return float(np.sqrt(np.mean((at.std(axis=0) / slope) ** 2)))


def make_alignment(
    config: EstimatorConfig, reference: Demonstration, period: float, *, tempo_free: bool = False
) -> OpenEndSoftDTW:
    """That of the paper; or one that does not lag behind fast people, as no path is favoured for its few cells."""
    return OpenEndSoftDTW(
        reference.resample(period).p_WH,
        config.gamma,
        cast(Distance, config.distance),
        config.window,
        steps="symmetric2" if tempo_free else "symmetric1",
        normalization="steps" if tempo_free else "none",
        sample_period=period,
    )


def make_ensemble(
    config: EstimatorConfig,
    alignment: Estimator,
    reference: Demonstration,
    training: list[Demonstration],
    period: float,
) -> MedianPhase:
    """The alignment, and others with the reference and one trial of each known person, by three distances."""
    firsts = {d.subject: d for d in reversed(training)}
    references = [reference, *(firsts[subject] for subject in sorted(firsts))]
    others = [replace(config, distance=distance, gamma=gamma) for distance, gamma in _ENSEMBLE_GAMMA.items()]
    return MedianPhase(
        [
            alignment,
            *(make_alignment(config, one, period, tempo_free=True) for one in references[1:]),
            *(make_alignment(other, one, period, tempo_free=True) for other in others for one in references),
        ]
    )


def calibrate(
    action: HumanAction,
    alignment: Estimator,
    reference: Demonstration,
    training: list[Demonstration],
    period: float,
    stretched: bool,
) -> Calibration:
    """What the filter learns from the training trials: as they are, or stretched to some of the drawn durations.

    Where durations are drawn, people differ as the task says, and not as the few who are known.
    """
    num_people = len({d.subject for d in (reference, *training)})
    if stretched:
        durations = action.duration.quantile(_CALIBRATED_AT)
        hands = [_stretched(d, seconds, period) for d in training for seconds in durations.tolist()]
    else:
        hands = [d.resample(period).p_WH for d in training]
    phases = alignment.phases(hands, num_threads=2)
    return Calibration.fit(phases, reference.duration, period, num_people if num_people > 1 else None)


def _stretched(trial: Demonstration, seconds: float, period: float) -> NDArray:
    """A trial (m, 3) [m] as a tracker sees it when it takes another duration."""
    return trial.positions(np.arange(int(seconds / period) + 1) * period, seconds)
