"""Signals to evaluate phase estimators with: what they may learn from, and what was held out.

Three sources give the same thing, a `SignalSet`: the synthetic hand paths of this package, the wrist
accelerations of real people that the package ``seglearn`` brings, and a folder of one's own recordings.
"""

import math
import os
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pace_drake.demos import watch
from pace_drake.demos.files import read_demonstrations
from pace_drake.demos.generator import generate_demonstrations
from pace_drake.demos.model import Demonstration
from pace_drake.errors import InputError, require

Side = Literal["right", "left"]

_OTHER_PEOPLE = 1_000_000  # added to the seed: a generator that makes other people
_WATCH_STRIDE = 5  # 50 Hz to 10 Hz
_WATCH_NUM_TRAINING_PEOPLE = 7  # of 10


@dataclass(frozen=True, eq=False)
class Signal:
    """One uniformly sampled signal from the start to the end of one action: positions, accelerations or others.

    Attributes:
        action: the action shown.
        subject: who showed it.
        trial: which of the subject's trials it is.
        sample_period: [s] time between samples, > 0.
        values: (m, d) finite, m >= 2, d >= 1, in the units of the `SignalSet`; a read-only copy is kept.
        synthetic: whether a generator made it rather than a person.

    Raises:
        InputError: an attribute is out of range; the message names the signal and the attribute.
    """

    action: str
    subject: str
    trial: str
    sample_period: float  # [s]
    values: NDArray
    synthetic: bool

    def __post_init__(self) -> None:
        for label in ("action", "subject", "trial"):
            text = getattr(self, label)
            require(isinstance(text, str) and text != "" and text.isprintable(), label, f"must be a text, got {text!r}")
        period = self.sample_period
        require(math.isfinite(period) and period > 0.0, self.name, f"sample_period must be > 0 s, got {period}")
        try:
            values = np.array(self.values, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise InputError(f"{self.name}: values must be an (m, d) array of numbers") from None
        require(
            values.ndim == 2 and values.shape[0] >= 2 and values.shape[1] >= 1,
            self.name,
            f"values must have the shape (m, d) with m >= 2 and d >= 1, got {values.shape}",
        )
        finite = np.isfinite(values).all(axis=1)
        require(
            bool(finite.all()), self.name, f"values has NaN or inf in row {np.argmin(finite)}: interpolate or cut it"
        )
        values.setflags(write=False)
        object.__setattr__(self, "sample_period", float(period))
        object.__setattr__(self, "values", values)

    @property
    def name(self) -> str:
        """Action, subject and trial in one string, for messages and figures."""
        return f"{self.action}/{self.subject}/{self.trial}"


@dataclass(frozen=True, eq=False)
class ActionSignals:
    """The signals of one action, in three parts.

    Attributes:
        action: the action.
        train: at least 2: a reference is chosen among them, and all that an estimator learns it learns here.
        heldout_trials: further trials of the people in `train`.
        heldout_people: trials of people who are not in `train`.

    Raises:
        InputError: too few signals, one that stands twice or in the wrong part, or different periods or axes.
    """

    action: str
    train: tuple[Signal, ...]
    heldout_trials: tuple[Signal, ...]
    heldout_people: tuple[Signal, ...]

    def __post_init__(self) -> None:
        for part in ("train", "heldout_trials", "heldout_people"):
            object.__setattr__(self, part, tuple(getattr(self, part)))
        name = f"action {self.action!r}"
        require(
            len(self.train) >= 2,
            name,
            f"needs at least 2 training signals, got {len(self.train)}: record more trials, or hold out fewer people",
        )
        require(
            len(self.heldout_trials) + len(self.heldout_people) > 0,
            name,
            "has nothing held out to evaluate with: record a third trial of one person, or a second person",
        )
        (common, number), *_ = Counter(signal.name for signal in self.signals).most_common()
        require(number == 1, name, f"{number} signals are called {common!r}, give each its own subject or trial")
        first = self.train[0]
        for signal in self.signals:
            require(signal.action == self.action, name, f"{signal.name} belongs to another action")
            require(
                signal.sample_period == first.sample_period and signal.values.shape[1] == first.values.shape[1],
                name,
                f"{signal.name} and {first.name} must have the same sample period and number of axes",
            )
        known = {signal.subject for signal in self.train}
        for signal in self.heldout_trials:
            require(signal.subject in known, name, f"{signal.name} is a held-out trial of a person not in train")
        for signal in self.heldout_people:
            require(signal.subject not in known, name, f"{signal.name} is of a held-out person, who is in train")

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Those of all three parts."""
        return (*self.train, *self.heldout_trials, *self.heldout_people)


@dataclass(frozen=True, eq=False)
class SignalSet:
    """Signals of several actions to evaluate phase estimators with.

    Attributes:
        title: what they are, in a few words.
        source: where they come from, to be cited.
        licence: of the data.
        units: of the values.
        actions: at least one, each with its own name.

    Raises:
        InputError: there is no action, or two of one name.
    """

    title: str
    source: str
    licence: str
    units: str
    actions: tuple[ActionSignals, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "actions", tuple(self.actions))
        names = [one.action for one in self.actions]
        require(bool(names), self.title, "has no action, give at least one")
        require(len(set(names)) == len(names), self.title, f"an action stands twice in {', '.join(names)}")

    @property
    def synthetic(self) -> bool:
        """Whether a generator made any of the signals: figures and tables must then say so."""
        return any(signal.synthetic for one in self.actions for signal in one.signals)

    @property
    def description(self) -> str:
        """One line for people: what the signals are and how many; it begins with SYNTHETIC where any is."""
        counts = [
            f"{sum(len(getattr(one, part)) for one in self.actions)} {meaning}"
            for part, meaning in (
                ("train", "training signals"),
                ("heldout_trials", "held-out trials"),
                ("heldout_people", "signals of held-out people"),
            )
        ]
        num_actions = f"{len(self.actions)} action{'s' * (len(self.actions) > 1)}"
        return f"{'SYNTHETIC ' * self.synthetic}{self.title}: {', '.join((num_actions, *counts))}"


def signal_of(demonstration: Demonstration) -> Signal:
    """Returns a demonstration's path as a signal."""
    d = demonstration
    return Signal(d.action, d.subject, d.trial, d.sample_period, d.p_WH, d.synthetic)


def synthetic_signals(seed: int = 0) -> SignalSet:
    """SYNTHETIC hand positions [m], 10 Hz, of the three actions of the chair task; see `generate_demonstrations`.

    Training: all trials of 5 people but their last, and the reference. Held-out trials: the last ones. Held-out
    people: all trials of 5 others, S6 to S10, who come from another seed.

    Args:
        seed: same seed, same signals.

    Raises:
        InputError: the seed is negative.
    """
    demonstrations = generate_demonstrations(seed)
    train, validation = demonstrations.split("train"), demonstrations.split("validation")
    others = generate_demonstrations(seed + _OTHER_PEOPLE)
    num_people = len({d.subject for d in demonstrations.demonstrations})
    new_names = {f"S{k + 1}": f"S{num_people + k + 1}" for k in range(num_people)}
    return SignalSet(
        title="hand positions in a chair assembly",
        source=f"pace_drake.demos.synthetic_signals(seed={seed})",
        licence="BSD-3-Clause, as pace_drake",
        units="m",
        actions=tuple(
            ActionSignals(
                action,
                train=tuple(signal_of(d) for d in (*train.of(action), train.reference(action))),
                heldout_trials=tuple(signal_of(d) for d in validation.of(action)),
                heldout_people=tuple(signal_of(replace(d, subject=new_names[d.subject])) for d in others.of(action)),
            )
            for action in demonstrations.actions
        ),
    )


def watch_signals(side: Side = "right") -> SignalSet:
    """Wrist accelerations of real people in 7 shoulder exercises, 10 Hz; see `pace_drake.demos.watch`.

    A signal is one set of 20 repetitions. Training: people S01 to S07. Held-out people: S08 to S10. There are no
    held-out trials, as each person did one set.

    Args:
        side: the arm that wore the watch.

    Raises:
        InputError: another side, or the package with the recordings is not installed.
    """
    require(side in get_args(Side), "side", f"must be {' or '.join(get_args(Side))}, got {side!r}")
    recordings = [recording for recording in watch.read_watch() if recording.side == side]

    def signals(exercise: str, training: bool) -> tuple[Signal, ...]:
        return tuple(
            Signal(
                exercise,
                f"S{r.person:02d}",
                side,
                _WATCH_STRIDE * watch.SAMPLE_PERIOD,
                _thinned(r.values[:, :3], _WATCH_STRIDE),
                synthetic=False,
            )
            for r in recordings
            if r.exercise == exercise and (r.person <= _WATCH_NUM_TRAINING_PEOPLE) == training
        )

    return SignalSet(
        title=f"accelerations of the {side} wrist in sets of 20 shoulder exercises",
        source="PyPI seglearn 1.2.5; Burns et al. 2018, arXiv:1802.01489",
        licence="BSD-3-Clause, Copyright (c) 2018 David M. Burns",
        units="g (multiples of gravity; the source names no unit)",
        actions=tuple(
            ActionSignals(exercise, signals(exercise, True), (), signals(exercise, False))
            for exercise in sorted({r.exercise for r in recordings})
        ),
    )


def folder_signals(
    folder: str | os.PathLike[str], period: float = 0.1, heldout: Collection[str] | None = None
) -> SignalSet:
    """The .npz and .csv demonstration files in a folder, as `read_demonstrations` reads them; others are ignored.

    The action is the file's label, else its name without the suffix. Sample rates become one by linear
    interpolation. People held out are the same for all actions, so that nothing of theirs is learnt from. Of the
    others, the last trial (in the order of the files' names, then within a file) of an action is held out
    where a person has 3 or more.

    Args:
        folder: the folder; its subfolders are not searched.
        period: [s] between the samples returned, > 0.
        heldout: the people held out; None for the last 30 % (rounded up) in the alphabetical order of their
            names, nobody where there is one person only.

    Raises:
        InputError: a file cannot be used, or there is too little to learn from or to evaluate with; the message
            is one line that names the file or the action.
    """
    require(period > 0.0, "period", f"must be > 0 s, got {period}")
    folder = Path(folder)
    demonstrations = _read_folder(folder, period)
    people = sorted({d.subject for d in demonstrations})
    if heldout is None:
        heldout = people[len(people) - math.ceil(len(people) * 3 / 10) :] if len(people) > 1 else ()
    for person in heldout:
        require(person in people, "heldout", f"nobody is called {person!r}, there are: {', '.join(people)}")
    try:
        return SignalSet(
            title=f"recordings in {folder.resolve().name}",
            source=str(folder),
            licence="that of the recordings",
            units="m where a file holds positions, otherwise as recorded",
            actions=tuple(
                _split([d for d in demonstrations if d.action == action], heldout)
                for action in dict.fromkeys(d.action for d in demonstrations)
            ),
        )
    except InputError as error:
        raise InputError(f"{folder}: {error}") from None


def _read_folder(folder: Path, period: float) -> list[Demonstration]:
    require(folder.is_dir(), str(folder), "no such folder, check the path")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".npz", ".csv"))
    require(bool(paths), str(folder), "holds no .npz or .csv file, put demonstrations there")
    demonstrations: list[Demonstration] = []
    for path in paths:
        recorded = read_demonstrations(path, require_positions=False)
        try:
            demonstrations += [d.resample(period) for d in recorded]
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return demonstrations


def _split(demonstrations: Sequence[Demonstration], heldout: Collection[str]) -> ActionSignals:
    """Splits the demonstrations of one action."""
    num_trials = Counter(d.subject for d in demonstrations)
    last = {d.subject: d for d in demonstrations}
    train, trials, people = [], [], []
    for d in demonstrations:
        if d.subject in heldout:
            people.append(signal_of(d))
        elif num_trials[d.subject] >= 3 and d is last[d.subject]:
            trials.append(signal_of(d))
        else:
            train.append(signal_of(d))
    return ActionSignals(demonstrations[0].action, tuple(train), tuple(trials), tuple(people))


def _thinned(values: NDArray, stride: int) -> NDArray:
    """Returns every `stride`-th sample, each the mean of the last `stride` ones: a filter that knows no future."""
    num_means = (len(values) - 1) // stride
    blocks = values[1 : 1 + num_means * stride].reshape(num_means, stride, values.shape[1])
    return np.concatenate([values[:1], blocks.mean(axis=1)])
