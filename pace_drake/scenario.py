"""A scenario: everything a run needs, in one typed file (Drake's ``yaml_load_typed``)."""

import traceback
from dataclasses import dataclass, field, is_dataclass
from difflib import get_close_matches
from hashlib import sha256
from math import inf, isfinite
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_type_hints

import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from pace_drake.errors import InputError, require
from pace_drake.lcm.config import LcmConfig
from pace_drake.observation import check_observation
from pace_drake.resources import resource_path
from pace_drake.safety.config import SafetyConfig
from pace_drake.stations.workcell import Workcell
from pace_drake.task import Task

SYNTHETIC = "synthetic"
SPLITS = ("train", "validation", "unseen", "all")
MONITORS = ("told", "detector", "button")
PERCEPTIONS = ("true_poses", "cameras")


@dataclass(kw_only=True)
class EstimatorConfig:
    """How the phase of one human action is estimated."""

    distance: str = "wp"
    """``wp`` (Windowed-Pearson, Eq. 3), ``euclidean`` or ``sqeuclidean``."""
    gamma: float = 0.0
    """[cost] smoothing of the minimum (Algorithm 1, line 5); 0 is the hard minimum."""
    window: float = 1.0
    """[s] window of the Windowed-Pearson distance; at least two samples."""
    fused: bool = False
    """Whether the phase is the Bayesian filter's (alignment and elapsed time) instead of the alignment's alone."""
    ensemble: bool = False
    """Whether the filter, where its phase is used, stands on the median of several alignments: with the reference and
    one trial of every known person, by this distance, by that of the derivatives, and by the Euclidean."""


@dataclass(kw_only=True)
class HumanConfig:
    """Whose hands are seen."""

    demonstrations: str = SYNTHETIC
    """``synthetic`` (the seeded generator), or a file (.npz, .csv) of recorded demonstrations."""
    seed: int = 0
    """Seed of the synthetic demonstrations."""
    split: str = "validation"
    """Which synthetic trials are played: of the people whom the estimators know, ``train``, ``validation`` (the last
    trial of each) or ``all``; or those of twelve ``unseen`` people."""
    pace_correlation: float = 0.0
    """[-] in [0, 1) how far the durations of one person's actions go together: the share of their variance that is
    between people. 0: each is drawn by itself, as in the paper. Above 0, an episode is also one person's throughout."""
    unseen_variety: float = 1.0
    """How much the styles of unseen people differ, relative to those of the known ones; 2 makes unusual people."""
    sample_period: float = 0.1
    """[s] of the hand tracker (the paper: 10 Hz)."""
    monitor: str = "told"
    """How the robot knows which action the person is in: ``told`` (the simulated person's truth), ``detector`` (the
    hand and the button), or ``button`` (the exported input ``button`` alone)."""
    workplace: list[float] = field(default_factory=lambda: [0.85, 0.0, 0.15])
    """[m] in world: recordings are moved, all by one vector, so that their mean lies here, as their frame is the
    recorder's; empty: they are in the world frame already. References move with them, so that phases stay the same.
    With a real, tracked person nothing is moved: recordings must then be in the world frame."""


@dataclass(kw_only=True)
class Scenario:
    """A task, the people in it, the estimator, the chart, the policies and the workcell."""

    name: str = "unnamed"
    description: str = ""
    task: Task = field(default_factory=Task)
    human: HumanConfig = field(default_factory=HumanConfig)
    estimator: dict[str, EstimatorConfig] = field(default_factory=dict)
    """Per non-joint human action, by name; the default estimator where none is given."""
    estimator_file: str = ""
    """A file that ``pace tune`` wrote; for the actions in it, it replaces distance, gamma, window and reference."""
    statechart: str = "pace_task"
    """Name of a chart in statecharts/, or a file ending in .scxml."""
    decide_at_start: bool = True
    """Decide at t = 0 with the last robot task done (docs/departures.md); else start with robot task 1 as in Fig. 2."""
    decision_timeout: float = 1.0
    """[s] after which a decision without an answer counts as 0."""
    wait_timeout: float = 1e9
    """[s] for which the prepared robot waits for the person; the paper: for ever."""
    max_decisions: int = 200
    """An episode with more decisions is truncated."""
    max_time: float = 1800.0
    """[s] simulated, after which an episode is truncated, such as one in which a hand that rests near the robot's path
    holds the robot for good."""
    observation: str = "paper"
    """What policies see: ``none``, ``paper``, ``fused`` or ``history`` (pace_drake.observation)."""
    policy: str = "learned"
    """What answers the decisions; see ``pace run --help``."""
    elapsed_threshold: dict[str, float] = field(default_factory=dict)
    """[s] per human action, by name; an action without one is never interrupted for assistance."""
    phase_threshold: dict[str, float] = field(default_factory=dict)
    """[-] likewise."""
    remaining_time_threshold: dict[str, float] = field(default_factory=dict)
    """[s] likewise, of the time that the phase says remains."""
    learned_policy: str = ""
    """ONNX file: shipped with the project, or relative to the working directory."""
    workcell: Workcell = field(default_factory=Workcell)
    perception: str = "true_poses"
    """How the robot knows where components are, at the plant level: ``true_poses`` (the simulation's), or ``cameras``
    (rendered pictures of the tags on them; docs/perception.md)."""
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    lcm: LcmConfig = field(default_factory=LcmConfig)

    def validate(self) -> None:
        """Raises InputError that names the field if the scenario cannot be used."""
        self.task.validate()
        self.safety.validate()
        self.lcm.validate()
        # An empty gripper closes this much further than one that holds something: more could not be told apart.
        squeeze = self.workcell.gripper_squeeze
        require(
            not self.safety.grasp_check or self.safety.grasp_tolerance < squeeze,
            "safety.grasp_tolerance",
            f"must be less than workcell.gripper_squeeze, {squeeze} [m], is {self.safety.grasp_tolerance}",
        )
        names = [action.name for action in self.task.human_actions if not action.joint]
        for group in ("estimator", "elapsed_threshold", "phase_threshold", "remaining_time_threshold"):
            for name in getattr(self, group):
                require(
                    name in names,
                    f"{group}.{name}",
                    f"is not a non-joint human action; those are {', '.join(names)}",
                )
        for name, estimator in self.estimator.items():
            require(
                estimator.distance in ("wp", "euclidean", "sqeuclidean"),
                f"estimator.{name}.distance",
                f"must be wp, euclidean or sqeuclidean, is {estimator.distance!r}",
            )
            require(0 <= estimator.gamma < inf, f"estimator.{name}.gamma", f"must be >= 0, is {estimator.gamma}")
            require(
                2 * self.human.sample_period <= estimator.window < inf,
                f"estimator.{name}.window",
                f"must hold at least 2 samples of {self.human.sample_period} s, is {estimator.window} [s]",
            )
        require(
            0 < self.human.sample_period < inf,
            "human.sample_period",
            f"must be > 0 [s], is {self.human.sample_period}",
        )
        require(
            self.human.split in SPLITS,
            "human.split",
            f"must be one of {', '.join(SPLITS)}, is {self.human.split!r}",
        )
        require(
            self.human.monitor in MONITORS,
            "human.monitor",
            f"must be one of {', '.join(MONITORS)}, is {self.human.monitor!r}",
        )
        workplace = self.human.workplace
        require(
            len(workplace) in (0, 3) and all(isfinite(value) for value in workplace),
            "human.workplace",
            f"must be x, y, z [m] in the world frame, or empty, is {workplace}",
        )
        require(
            0 <= self.human.pace_correlation < 1,
            "human.pace_correlation",
            f"must lie in [0, 1), is {self.human.pace_correlation}",
        )
        require(
            0 <= self.human.unseen_variety < inf,
            "human.unseen_variety",
            f"must be >= 0, is {self.human.unseen_variety}",
        )
        require(
            self.perception in PERCEPTIONS,
            "perception",
            f"must be one of {', '.join(PERCEPTIONS)}, is {self.perception!r}",
        )
        check_observation(self.observation)
        require(self.human.seed >= 0, "human.seed", f"must be >= 0, is {self.human.seed}")
        require(self.max_decisions > 0, "max_decisions", f"must be > 0, is {self.max_decisions}")
        for name in ("decision_timeout", "wait_timeout", "max_time"):
            value = getattr(self, name)
            require(isfinite(value) and value > 0, name, f"must be > 0 [s], is {value}")

    def estimator_of(self, action: str) -> EstimatorConfig:
        """The estimator of one human action."""
        return self.estimator.get(action, EstimatorConfig())

    @staticmethod
    def resolve(path: str) -> Path:
        """A file that a scenario names: relative to the working directory, or shipped with the project."""
        if Path(path).exists():
            return Path(path)
        try:
            return resource_path(path)
        except FileNotFoundError:
            raise InputError(f"{path}: no such file here or in the installation; check the scenario") from None

    def chart_path(self) -> Path:
        """The file of the statechart."""
        is_file = self.statechart.endswith(".scxml")
        return self.resolve(self.statechart if is_file else f"statecharts/{self.statechart}.scxml")

    def to_yaml(self) -> str:
        """The resolved scenario; ``load_scenario`` reads it back equal."""
        return yaml_dump_typed(self, schema=Scenario)


def scenario_hash(scenario: Scenario) -> str:
    """SHA-256 of the resolved scenario, in hexadecimal."""
    return sha256(scenario.to_yaml().encode()).hexdigest()


def scenario_names() -> list[str]:
    """Names of the scenarios that travel with the project."""
    return sorted(path.stem for path in resource_path("scenarios").glob("*.yaml"))


def load_scenario(name: str, overrides: tuple[str, ...] = ()) -> Scenario:
    """Loads and validates a scenario.

    Args:
        name: one of ``scenario_names()``, or a file ending in .yaml.
        overrides: ``key=value`` texts; dots lead into the file, list elements by number, values are YAML, such as
            ``task.human_actions.0.duration.mean=20``.

    Raises:
        InputError: no such scenario, a key that does not exist (named), a value that cannot be used (field named).
    """
    if name.endswith((".yaml", ".yml")):
        path = Path(name)
    elif name in scenario_names():
        path = resource_path(f"scenarios/{name}.yaml")
    else:
        raise InputError(f"unknown scenario {name!r}; known are {', '.join(scenario_names())}, or name a .yaml file")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        what = error.strerror if isinstance(error, OSError) else "not a text file"
        raise InputError(f"{path}: cannot read the scenario: {what}") from error
    for override in overrides:
        _check_key(override)
    try:
        content = yaml.safe_load(text)
        for override in overrides:
            _override(content, override)
        scenario = yaml_load_typed(schema=Scenario, data=yaml.safe_dump(content, sort_keys=False), defaults=Scenario())
        scenario.validate()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except AssertionError as error:  # yaml_load_typed, where it expects a mapping
        where = _place_in_scenario(error)
        raise InputError(f"{path}: {where}: {str(error)[:40]!r} stands where keys and values are expected") from error
    except (yaml.YAMLError, RuntimeError, ValueError, TypeError, KeyError, AttributeError) as error:
        where = _place_in_scenario(error)
        raise InputError(f"{path}: {where}{': ' if where else ''}{' '.join(str(error).split())}") from error
    return scenario


def _place_in_scenario(error: Exception) -> str:
    """The dotted key at which ``yaml_load_typed`` failed, list elements as []; empty if it is not known.

    Its errors do not say where, but its frames do; should Drake rename them, the place is merely missing.
    """
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    items = (f for f in frames if f.f_code.co_name == "_merge_yaml_dict_item_into_target")
    names = ["[]" if name == "_" else name for name in (f.f_locals.get("name") for f in items) if name]
    # An Optional or a union is entered twice under the same name.
    return ".".join(name for k, name in enumerate(names) if k == 0 or name != names[k - 1])


def _check_key(override: str) -> None:
    """Raises InputError that says what there is, where the schema has no such key; Drake would blame the file."""
    key, equals, _ = override.partition("=")
    schema: Any = Scenario
    for part in key.strip().split(".") if equals and key else ():
        if isinstance(schema, UnionType):
            schema = next((one for one in get_args(schema) if is_dataclass(one)), None)
        if is_dataclass(schema):
            known = get_type_hints(schema)
            if part not in known:
                near = get_close_matches(part, known, n=3)
                hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
                raise InputError(f"cannot set {key.strip()!r}: no such key {part!r}; {hint}")
            schema = known[part]
        else:
            # What a list or a mapping holds; what holds nothing is left to Drake.
            schema = get_args(schema)[-1] if get_args(schema) else None


def _override(content: object, text: str) -> None:
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise InputError(f"cannot set {text!r}; write key=value, such as task.human_idle_weight=3")
    *parents, last = key.strip().split(".")
    at = content
    try:
        for part in parents:
            at = at.setdefault(part, {}) if isinstance(at, dict) else at[int(part)]  # type: ignore[index]
        if isinstance(at, list):
            at[int(last)] = yaml.safe_load(value)
        else:
            at[last] = yaml.safe_load(value)  # type: ignore[index]
    except (IndexError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"cannot set {key!r}: the scenario has no such key") from error
