"""Estimator files: tuned estimators of several actions, in one readable YAML file that scenarios name.

The file is complete: references are written out, so that neither the demonstrations nor the tuning is needed to use it.
It is parsed as plain data; nothing in it is executed.
"""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml
from numpy.typing import NDArray

from pace_drake.dtw.estimator import samples
from pace_drake.dtw.filter import Calibration, PhaseFilter
from pace_drake.dtw.open_end import Distance, OpenEndSoftDTW
from pace_drake.errors import InputError, require
from pace_drake.files import write_whole

_HEADER = "# Phase estimators, written by pace tune: `pace run SCENARIO --set estimator_file=THIS_FILE`.\n"


@dataclass(frozen=True, eq=False)
class ActionEstimator:
    """The tuned estimator of one action.

    Attributes:
        distance, gamma, window: see `OpenEndSoftDTW`.
        reference_name: which demonstration it is, for people.
        reference: (n, d).
        calibration: of the filter over it.
        score: errors that tuning saw, by name; for people.
        goal: (d,) where the action ends: the mean last sample of the demonstrations. By default, and in a file without
            it, the reference's last sample.
    """

    distance: Distance
    gamma: float  # [cost]
    window: float  # [s]
    reference_name: str
    reference: NDArray
    calibration: Calibration
    score: dict[str, float]
    goal: NDArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not self.goal.size:
            object.__setattr__(self, "goal", self.reference[-1])

    def moved(self, shift: NDArray) -> "ActionEstimator":
        """The same elsewhere, by ``shift`` (d,)."""
        return replace(self, reference=self.reference + shift, goal=self.goal + shift)

    def alignment(self, sample_period: float) -> OpenEndSoftDTW:
        """Open-end soft-DTW alone; ``sample_period`` in [s]."""
        return OpenEndSoftDTW(self.reference, self.gamma, self.distance, self.window, sample_period=sample_period)

    def fused(self, sample_period: float) -> PhaseFilter:
        """The Bayesian filter over the alignment."""
        return PhaseFilter(self.alignment(sample_period), self.calibration)


@dataclass(frozen=True, eq=False)
class EstimatorFile:
    """The estimators in one file.

    Attributes:
        description: what they were tuned on; says SYNTHETIC where that was generated.
        sample_period: [s] of the samples they expect.
        units: of the samples.
        actions: by the action's name, at least one.
    """

    description: str
    sample_period: float
    units: str
    actions: Mapping[str, ActionEstimator]


def write_estimator_file(path: str | os.PathLike[str], content: EstimatorFile) -> None:
    """Writes an estimator file; an older one stays until the new one is whole.

    Raises:
        InputError: the place cannot be written to.
    """
    actions = {
        name: {
            "distance": one.distance,
            "gamma": one.gamma,
            "window": one.window,
            "score": dict(one.score),
            "calibration": asdict(one.calibration),
            "goal": one.goal.tolist(),
            "reference_name": one.reference_name,
            "reference": one.reference.tolist(),
        }
        for name, one in content.actions.items()
    }
    document = {
        "description": content.description,
        "sample_period": content.sample_period,
        "units": content.units,
        "actions": actions,
    }
    text = _HEADER + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=120)
    write_whole(Path(path), lambda temporary: temporary.write_text(text, encoding="utf-8"))


def read_estimator_file(path: str | os.PathLike[str]) -> EstimatorFile:
    """Reads an estimator file.

    Raises:
        InputError: the file cannot be used; the message is one line that names the file and the field.
    """
    path = Path(path)
    try:
        document = yaml.load(path.read_text(encoding="utf-8"), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'no text file'})") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{path}: is no YAML file ({' '.join(str(error).split())}), write it with pace tune") from None
    try:
        top = _mapping(document, "the file", {"description", "sample_period", "units", "actions"})
        actions = top["actions"]
        require(isinstance(actions, dict) and bool(actions), "actions", "must name at least one action")
        period = _number(top["sample_period"], "sample_period")
        return EstimatorFile(
            str(top["description"]),
            period,
            str(top["units"]),
            {str(name): _action(one, f"actions.{name}", period) for name, one in actions.items()},
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _action(content: object, where: str, sample_period: float) -> ActionEstimator:
    known = {field.name for field in fields(ActionEstimator)}
    if isinstance(content, dict) and "goal" not in content:
        known.remove("goal")  # which the first files did not say
    one = _mapping(content, where, known)
    calibration = _mapping(one["calibration"], f"{where}.calibration", {field.name for field in fields(Calibration)})
    numbers: dict[str, Any] = {}
    for number in fields(Calibration):
        at, value = f"{where}.calibration.{number.name}", calibration[number.name]
        if number.type is float:
            numbers[number.name] = _number(value, at)
        else:
            require(isinstance(value, list), at, f"must be a list of numbers, is {value!r}")
            numbers[number.name] = tuple(_number(one, at) for one in value)
    try:
        reference = samples(one["reference"], "reference", (-1, -1), "a list of samples")
        d = reference.shape[1]
        goal = one.get("goal", reference[-1])
        action = ActionEstimator(
            cast(Distance, one["distance"]),
            _number(one["gamma"], "gamma"),
            _number(one["window"], "window"),
            str(one["reference_name"]),
            reference,
            Calibration(**numbers),
            {str(name): _number(value, f"score.{name}") for name, value in _mapping(one["score"], "score").items()},
            samples(goal, "goal", (d,), f"a vector of {d} values"),
        )
        action.alignment(sample_period)  # whether the settings go together
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return action


def _mapping(content: object, where: str, names: set[str] | None = None) -> dict[str, Any]:
    """Returns a mapping with exactly these keys (None: any), or raises InputError that names the first wrong one."""
    if not isinstance(content, dict):
        raise InputError(f"{where}: must be a mapping of {', '.join(sorted(names or ['names to numbers']))}")
    if names is not None:
        for name in sorted(names - set(content)):
            raise InputError(f"{where}: has no {name!r}")
        for name in content:
            require(name in names, where, f"has the unknown key {name!r}")
    return content


def _number(value: object, name: str) -> float:
    require(isinstance(value, int | float) and not isinstance(value, bool), name, f"must be a number, is {value!r}")
    return float(cast(float, value))
