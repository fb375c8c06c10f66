"""Log-normal durations of an action that is known to go on: T given T > t, in closed form."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx, log_ndtr, ndtr, ndtri_exp


def moment_beyond(power: int, log_mean: ArrayLike, log_std: ArrayLike, time: ArrayLike) -> NDArray:
    """E[T^power | T > time] of a log-normal duration.

    With z = (ln time - log_mean) / log_std it is exp(p m + p^2 s^2 / 2) Phi(p s - z) / Phi(-z).

    Args:
        power: of T.
        log_mean, log_std: of ln T [ln s].
        time: [s] >= 0.
    """
    m, s, t = np.broadcast_arrays(np.asarray(log_mean, float), np.asarray(log_std, float), np.asarray(time, float))
    with np.errstate(divide="ignore"):
        z = (np.log(t) - m) / s
    early = z < 0.0
    # Each form is evaluated where it is used only: in the other's place its parts over- or underflow.
    z_early, z_late = np.where(early, z, -1.0), np.where(early, 1.0, z)
    before = np.exp(power * m + 0.5 * (power * s) ** 2) * ndtr(power * s - z_early) / ndtr(-z_early)
    late_time = np.where(early, 1.0, t)
    late = late_time**power * erfcx((z_late - power * s) / np.sqrt(2.0)) / erfcx(z_late / np.sqrt(2.0))
    return np.where(early, before, late)


def spread_beyond(power: int, log_mean: ArrayLike, log_std: ArrayLike, time: ArrayLike) -> NDArray:
    """Standard deviation of T^power given T > time; arguments as in `moment_beyond`."""
    mean = moment_beyond(power, log_mean, log_std, time)
    return np.sqrt(np.maximum(moment_beyond(2 * power, log_mean, log_std, time) - mean**2, 0.0))


def quantile_beyond(probability: float, log_mean: ArrayLike, log_std: ArrayLike, time: ArrayLike) -> NDArray:
    """Duration [s] that T given T > time stays below with a probability in (0, 1); arguments as in `moment_beyond`."""
    m, s, t = (np.asarray(one, float) for one in (log_mean, log_std, time))
    with np.errstate(divide="ignore"):
        a = (m - np.log(t)) / s
    return np.maximum(np.exp(m - s * ndtri_exp(np.log1p(-probability) + log_ndtr(a))), t)
