"""How good estimates are, against a linear phase (paper, Sec. IV-A): truth i / (m - 1) at sample i of m."""

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from pace_drake.dtw.estimator import Estimate

#: Fractions of an action at which remaining-time errors are read.
FRACTIONS = (0.25, 0.5, 0.75, 0.9)


def linear_phase(num_samples: int) -> NDArray:
    """The true phase (m,) of a whole demonstration, by definition linear from 0 to 1."""
    return np.linspace(0.0, 1.0, num_samples)


def mean_squared_error(phases: NDArray) -> float:
    """Mean squared error of the phases (m,) of a whole demonstration."""
    return float(np.mean((phases - linear_phase(len(phases))) ** 2))


@dataclass(frozen=True)
class Score:
    """How good an estimator is on one demonstration, or, averaged, on many.

    Attributes:
        mse: mean squared error of the phase.
        mae: mean absolute error of the phase.
        bias: mean error of the phase; > 0 leads.
        back_jumps: share of the samples at which the phase falls.
        remaining_time_error: [s] absolute, at `FRACTIONS`.
        coverage: share of the samples at which the central 90 % interval of the remaining time, half a sample period
            wider, holds the truth; NaN where there is none.
    """

    mse: float
    mae: float
    bias: float
    back_jumps: float
    remaining_time_error: tuple[float, ...]
    coverage: float = nan


def score(estimate: Estimate, sample_period: float, intervals: NDArray | None = None) -> Score:
    """Scores the estimates of a whole demonstration.

    An estimator without a prediction of its own is given the obvious one: remaining time = elapsed (1 - phase) / phase.

    Args:
        estimate: arrays (m,), m >= 2.
        sample_period: [s].
        intervals: (m, 2) [s] 90 % intervals of the remaining time.
    """
    phase = np.asarray(estimate.phase)
    m = len(phase)
    error = phase - linear_phase(m)
    elapsed = np.arange(m) * sample_period
    left = elapsed[-1] - elapsed
    predicted = np.asarray(estimate.remaining_time)
    remaining = np.where(np.isnan(predicted), extrapolated_remaining_time(phase, elapsed), predicted)
    at = [round(fraction * (m - 1)) for fraction in FRACTIONS]
    covered = nan
    if intervals is not None:
        half = 0.5 * sample_period
        covered = float(np.mean((intervals[:, 0] - half <= left) & (left <= intervals[:, 1] + half)))
    return Score(
        mse=float(np.mean(error**2)),
        mae=float(np.mean(np.abs(error))),
        bias=float(np.mean(error)),
        back_jumps=float(np.mean(np.diff(phase) < -1e-12)),
        remaining_time_error=tuple(float(abs(remaining[k] - left[k])) for k in at),
        coverage=covered,
    )


def extrapolated_remaining_time(phase: NDArray, elapsed: NDArray) -> NDArray:
    """Remaining time [s] if the mean rate so far went on; a phase below 0.02 is taken as 0.02."""
    phase = np.maximum(phase, 0.02)
    return elapsed * (1.0 - phase) / phase


def mean_score(scores: list[Score]) -> Score:
    """The mean of each attribute."""

    def mean(name: str) -> float:
        return float(np.mean([getattr(one, name) for one in scores]))

    return Score(
        mse=mean("mse"),
        mae=mean("mae"),
        bias=mean("bias"),
        back_jumps=mean("back_jumps"),
        remaining_time_error=tuple(np.mean([one.remaining_time_error for one in scores], axis=0).tolist()),
        coverage=mean("coverage"),
    )
