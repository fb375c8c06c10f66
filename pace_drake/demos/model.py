"""Demonstrations: recorded or generated paths of a person's hand during one action."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pace_drake.errors import InputError

#: [m] from the world's origin; a hand that is farther away has been measured in other units.
FARTHEST = 10.0

Split = Literal["train", "validation", "all"]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One uniformly sampled path of the hand H in the world W, from the start to the end of one action.

    Attributes:
        action: the action shown, such as "place_rails".
        subject: who showed it.
        trial: which of the subject's trials it is.
        sample_period: [s] time between samples, > 0.
        p_WH: (num_samples, 3) [m] hand positions, at least 2, finite; a read-only copy is kept.
        synthetic: whether a generator made it rather than a person.

    Raises:
        InputError: an attribute is out of range; the message names the demonstration and the attribute.
    """

    action: str
    subject: str
    trial: str
    sample_period: float  # [s]
    p_WH: NDArray  # [m]
    synthetic: bool

    def __post_init__(self) -> None:
        for label in ("action", "subject", "trial"):
            text = getattr(self, label)
            if not (isinstance(text, str) and text and text.isprintable()):
                raise InputError(f"{label} of a demonstration must be a printable, non-empty text, got {text!r}")
        try:
            p_WH = np.array(self.p_WH, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise InputError(f"{self.name}: p_WH must be a (num_samples, 3) array of numbers") from None
        if p_WH.ndim != 2 or p_WH.shape[1] != 3:
            raise InputError(f"{self.name}: p_WH must have the shape (num_samples, 3), got {p_WH.shape}")
        if len(p_WH) < 2:
            raise InputError(f"{self.name}: p_WH must have at least 2 samples, got {len(p_WH)}")
        if not np.isfinite(p_WH).all():
            row = int(np.argmin(np.isfinite(p_WH).all(axis=1)))
            raise InputError(f"{self.name}: p_WH has NaN or inf in row {row}: interpolate or cut it")
        if not (math.isfinite(self.sample_period) and self.sample_period > 0.0):
            raise InputError(f"{self.name}: sample_period must be > 0 s, got {self.sample_period}")
        p_WH.setflags(write=False)
        object.__setattr__(self, "p_WH", p_WH)
        object.__setattr__(self, "sample_period", float(self.sample_period))

    @property
    def name(self) -> str:
        """Action, subject and trial in one string, for messages and figures."""
        return f"{self.action}/{self.subject}/{self.trial}"

    @property
    def num_samples(self) -> int:
        """Number of samples."""
        return self.p_WH.shape[0]

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return (self.num_samples - 1) * self.sample_period

    @property
    def times(self) -> NDArray:
        """Sample times (num_samples,) [s], from 0."""
        return np.arange(self.num_samples) * self.sample_period

    def position(self, time: float, duration: float | None = None) -> NDArray:
        """Returns the position when the time axis is linearly rescaled (Sec. IV-C of the paper).

        Args:
            time: [s] since the start of the action; before 0 and after `duration` the ends are held.
            duration: [s] that the whole path takes, > 0; None for the demonstrated one.

        Returns:
            (3,) [m] p_WH, linear between samples.

        Raises:
            InputError: `duration` is not > 0, or `time` is NaN.
        """
        last = self.p_WH.shape[0] - 1
        if duration is None:
            duration = last * self.sample_period
        elif not duration > 0.0:
            raise InputError(f"{self.name}: duration must be > 0 s, got {duration}")
        if math.isnan(time):
            raise InputError(f"{self.name}: time must be a number, got {time}")
        index = min(max(time / duration, 0.0), 1.0) * last
        before = min(int(index), last - 1)
        # As floats: for three numbers that takes half the time of arrays, with the same rounding. Exact at both ends.
        (a, b, c), (x, y, z) = self.p_WH[before : before + 2].tolist()
        fraction = index - before
        rest = 1.0 - fraction
        return np.array([rest * a + fraction * x, rest * b + fraction * y, rest * c + fraction * z])

    def positions(self, times: NDArray, duration: float) -> NDArray:
        """Returns the positions (m, 3) [m] at many times (m,) [s]; each as `position` gives it."""
        last = self.num_samples - 1
        index = np.clip(times / duration, 0.0, 1.0) * last
        before = np.minimum(index.astype(int), last - 1)
        fraction = (index - before)[:, np.newaxis]
        return (1.0 - fraction) * self.p_WH[before] + fraction * self.p_WH[before + 1]

    def resample(self, sample_period: float) -> "Demonstration":
        """Returns the demonstration at another sample period, by linear interpolation.

        Args:
            sample_period: [s] > 0. What remains after the last whole period is left out.

        Raises:
            InputError: fewer than 2 samples would remain.
        """
        if not sample_period > 0.0:
            raise InputError(f"{self.name}: sample_period must be > 0 s, got {sample_period}")
        num_samples = math.floor(self.duration / sample_period + 1e-9) + 1
        if num_samples < 2:
            raise InputError(f"{self.name}: sample_period must be at most {self.duration:g} s, got {sample_period}")
        return replace(
            self,
            sample_period=sample_period,
            p_WH=interpolate(np.arange(num_samples) * sample_period, self.times, self.p_WH),
        )


def interpolate(times: NDArray, known_times: NDArray, known: NDArray) -> NDArray:
    """Returns (len(times), d) values, linear in time between the known ones (len(known_times), d)."""
    return np.column_stack([np.interp(times, known_times, axis) for axis in known.T])


@dataclass(frozen=True, eq=False)
class DemonstrationSet:
    """Demonstrations of several actions, and for each action the one reference that phases are relative to.

    Attributes:
        demonstrations: all demonstrations but the references, in the order recorded.
        references: one demonstration per action; it is not among `demonstrations`.

    Raises:
        InputError: an action has no reference, or more than one; or a reference is among the demonstrations.
    """

    demonstrations: tuple[Demonstration, ...]
    references: tuple[Demonstration, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "demonstrations", tuple(self.demonstrations))
        object.__setattr__(self, "references", tuple(self.references))
        actions = [reference.action for reference in self.references]
        for action in actions:
            if actions.count(action) > 1:
                raise InputError(f"action {action!r} has {actions.count(action)} references, give exactly one")
        for demonstration in self.demonstrations:
            if demonstration.action not in actions:
                raise InputError(f"action {demonstration.action!r} has no reference, give one")
            if any(demonstration is reference for reference in self.references):
                raise InputError(f"{demonstration.name} is the reference and a demonstration, choose one")

    @classmethod
    def with_median_references(cls, demonstrations: Iterable[Demonstration]) -> "DemonstrationSet":
        """Returns a set where each action's reference is its demonstration of median length.

        For recordings that have no reference of their own. Of an even number, the shorter of the middle two.
        """
        demonstrations = list(demonstrations)
        references = []
        for action in dict.fromkeys(d.action for d in demonstrations):
            same = sorted((d for d in demonstrations if d.action == action), key=lambda d: d.duration)
            references.append(same[(len(same) - 1) // 2])
        rest = tuple(d for d in demonstrations if not any(d is reference for reference in references))
        return cls(rest, tuple(references))

    @property
    def actions(self) -> tuple[str, ...]:
        """The actions, in the order of their references."""
        return tuple(reference.action for reference in self.references)

    @property
    def synthetic(self) -> bool:
        """Whether any demonstration was made by a generator: figures and tables must then say so."""
        return any(d.synthetic for d in (*self.demonstrations, *self.references))

    def of(self, action: str) -> tuple[Demonstration, ...]:
        """Returns the demonstrations of an action.

        Raises:
            InputError: the set does not know the action.
        """
        self.reference(action)
        return tuple(d for d in self.demonstrations if d.action == action)

    def reference(self, action: str) -> Demonstration:
        """Returns the reference of an action.

        Raises:
            InputError: the set does not know the action.
        """
        for reference in self.references:
            if reference.action == action:
                return reference
        raise InputError(f"no demonstrations of {action!r}, there are: {', '.join(self.actions) or 'none'}")

    def split(self, part: Split) -> "DemonstrationSet":
        """Returns one part of the demonstrations, with all references.

        As in the paper (Sec. V-C) the last trial of each subject, per action, is for validation, and the
        trials before it are for training. A subject's only trial is for training.

        Args:
            part: "train", "validation" or "all".

        Raises:
            InputError: `part` is none of the three.
        """
        if part not in get_args(Split):
            raise InputError(f"split must be one of {', '.join(get_args(Split))}, got {part!r}")
        if part == "all":
            return self
        trials: dict[tuple[str, str], list[Demonstration]] = {}
        for demonstration in self.demonstrations:
            trials.setdefault((demonstration.action, demonstration.subject), []).append(demonstration)
        last = [group[-1] for group in trials.values() if len(group) > 1]
        wanted = part == "validation"
        return DemonstrationSet(
            tuple(d for d in self.demonstrations if any(d is one for one in last) == wanted), self.references
        )
