"""A sweep: a grid of trainings and evaluations, each a task that yields one row of a table.

This file knows the grid and one task; ``pace_drake.learning.sweep_runner`` runs many of them.
"""

import hashlib
import json
import resource
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from itertools import product
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.common.yaml import yaml_load_typed

from pace_drake import __version__
from pace_drake.envs.pool import Pool, make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.errors import InputError, require
from pace_drake.evaluate.play import Played, play
from pace_drake.evaluate.policies import POOL_SIZE, interval
from pace_drake.observation import check_observation
from pace_drake.people import load_people
from pace_drake.policies import Policy
from pace_drake.scenario import SYNTHETIC, Scenario, load_scenario

#: Held-out people that every policy is evaluated on: the known ones' last trials, and people whom nothing has seen.
SPLITS = ("validation", "unseen")
#: First part of the seed of the evaluation's episodes: they are the same for all tasks of a scenario, which pairs them.
_EPISODES_SEED = 1 << 31


@dataclass(frozen=True)
class Cell:
    """A point of the grid; None is the scenario's own value."""

    scenario: str
    estimator: str
    observation: str | None
    human_idle_weight: float | None
    seed: int

    def __str__(self) -> str:
        parts = [self.scenario, f"estimator {self.estimator}"]
        parts += [f"observation {self.observation}"] * (self.observation is not None)
        parts += [f"lambda {self.human_idle_weight:g}"] if self.human_idle_weight is not None else []
        return ", ".join([*parts, f"seed {self.seed}"])


@dataclass(frozen=True)
class SweepTask:
    """One training with its evaluation.

    Attributes:
        cell: where in the grid.
        scenario: with all overrides in it.
        steps: decisions to train on.
        episodes: of the evaluation, on each of ``SPLITS``.
        key: digest of all that the row depends on, so that no row is taken for that of another task.
    """

    cell: Cell
    scenario: Scenario
    steps: int
    episodes: int
    key: str


@dataclass(frozen=True)
class Failure:
    """A cell without a row, and why in one line."""

    cell: Cell
    reason: str


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """What a sweep file says; see ``examples/sweep.yaml``. Its grid is the product of the first five."""

    scenarios: list[str]
    """Names, or files ending in .yaml relative to the working directory."""
    seeds: list[int] = field(default_factory=lambda: [0])
    """Of the trainings."""
    human_idle_weight: list[float | None] = field(default_factory=lambda: [None])
    """[-] lambda of Eq. 1; if none are given, the scenario's own."""
    observation: list[str | None] = field(default_factory=lambda: [None])
    """Observation sets; likewise."""
    estimators: dict[str, dict[str, Any]] = field(default_factory=lambda: {"default": {}})
    """Named sets of overrides: dotted keys of the scenario, and values."""
    overrides: list[str] = field(default_factory=list)
    """``key=value`` for all tasks; the grid's own values come after them."""
    steps: int = 300_000
    """Decisions to train on."""
    episodes: int = 2000
    """To evaluate on, of each split."""
    retries: int = 2
    """How many times a task that failed is tried again."""

    def tasks(self) -> tuple[list[SweepTask], list[Failure]]:
        """The tasks of the grid, seeds changing fastest, and the cells whose scenario cannot be used."""
        tasks: list[SweepTask] = []
        failures: list[Failure] = []
        for name, estimator, observation, weight in product(
            self.scenarios, self.estimators, self.observation, self.human_idle_weight
        ):
            cells = [Cell(name, estimator, observation, weight, seed) for seed in self.seeds]
            overrides = [*self.overrides, *(_override(*item) for item in self.estimators[estimator].items())]
            overrides += [f"observation={observation}"] * (observation is not None)
            overrides += [f"task.human_idle_weight={weight!r}"] * (weight is not None)
            try:
                scenario = load_scenario(name, tuple(overrides))
                _check_held_out(scenario)
                digest = _digest(scenario)
            except InputError as error:
                failures += [Failure(cell, str(error)) for cell in cells]
                continue
            for cell in cells:
                content = [__version__, name, estimator, digest, cell.seed, self.steps, self.episodes]
                key = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32]
                tasks.append(SweepTask(cell, scenario, self.steps, self.episodes, key))
        return tasks, failures


def load_sweep(path: Path) -> Sweep:
    """Loads and checks a sweep file.

    Raises:
        InputError: a file that cannot be read, an unknown key, a value or a scenario that cannot be used; file and key
            are named. Sets of overrides under ``estimators`` are not tried: one that is wrong concerns its cells alone.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        what = error.strerror if isinstance(error, OSError) else "not a text file"
        raise InputError(f"{path}: cannot read the sweep: {what}") from error
    except yaml.YAMLError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error
    try:
        sweep = _checked(content)
        for name in sweep.scenarios:
            _check_held_out(load_scenario(name, tuple(sweep.overrides)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return sweep


def _checked(content: object) -> Sweep:
    if not isinstance(content, dict):
        raise InputError("keys and values are expected, such as scenarios: [ikea_chair]")
    known = [one.name for one in fields(Sweep)]
    for key in content:
        require(key in known, str(key), f"is no key of a sweep; those are {', '.join(known)}")
    require("scenarios" in content, "scenarios", "is missing; name at least one, such as [ikea_chair]")
    for name in ("scenarios", "seeds", "human_idle_weight", "observation"):
        if name in content:
            values = _items(content[name], name)
            require(bool(values), name, "must not be empty")
            for k, value in enumerate(values):
                require(value not in values[:k], f"{name}.{k}", f"stands there already: {value!r}")
    for k, value in enumerate(content["scenarios"]):
        require(isinstance(value, str), f"scenarios.{k}", f"must be a name or a file, is {value!r}")
    for k, value in enumerate(content.get("seeds", [])):
        require(_is_int(value) and value >= 0, f"seeds.{k}", f"must be a whole number >= 0, is {value!r}")
    for k, value in enumerate(content.get("human_idle_weight", [])):
        usable = _is_int(value) or isinstance(value, float)
        require(usable and 0 < value < inf, f"human_idle_weight.{k}", f"must be a number > 0, is {value!r}")
    for k, value in enumerate(content.get("observation", [])):
        require(isinstance(value, str), f"observation.{k}", f"must be a name, is {value!r}")
        check_observation(value, f"observation.{k}")
    for k, value in enumerate(_items(content.get("overrides", []), "overrides")):
        require(isinstance(value, str), f"overrides.{k}", f"must be a text key=value, is {value!r}")
    for name, least in (("steps", 1), ("episodes", 2), ("retries", 0)):
        value = content.get(name, least)
        require(_is_int(value) and value >= least, name, f"must be a whole number >= {least}, is {value!r}")
    if "estimators" in content:
        content = {**content, "estimators": _estimators(content["estimators"])}
    return Sweep(**content)


def _items(value: object, name: str) -> Sequence[Any]:
    if not isinstance(value, list):
        raise InputError(f"{name}: must be a list, such as [a, b], is {value!r}")
    return value


def _is_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _estimators(value: object) -> dict[str, dict[str, Any]]:
    what = "must be named sets of overrides, such as {wp: {}}"
    if not isinstance(value, dict) or not value:
        raise InputError(f"estimators: {what}, is {value!r}")
    for name, overrides in value.items():
        require(isinstance(name, str), "estimators", f"{what}; {name!r} is no name")
        usable = isinstance(overrides, dict) and all(isinstance(key, str) for key in overrides)
        require(usable, f"estimators.{name}", f"must be keys of the scenario and values, is {overrides!r}")
    return value


def _override(key: str, value: object) -> str:
    # One line of YAML; the document's end mark follows plain scalars.
    text = yaml.safe_dump(value, default_flow_style=True, width=inf, sort_keys=False)
    return f"{key}={text.removesuffix('...' + chr(10)).strip()}"


def _check_held_out(scenario: Scenario) -> None:
    require(
        scenario.human.demonstrations == SYNTHETIC,
        "human.demonstrations",
        f"recordings are all played, none is held out for the evaluation: a sweep needs {SYNTHETIC} people",
    )


def _digest(scenario: Scenario) -> str:
    """Of the scenario and of the files that it names and a task reads."""
    digest = hashlib.sha256(scenario.to_yaml().encode())
    paths = [scenario.chart_path()]
    paths += [scenario.resolve(scenario.estimator_file)] if scenario.estimator_file else []
    for path in paths:
        try:
            digest.update(path.read_bytes())
        except OSError as error:
            raise InputError(f"{path}: cannot read the file: {error.strerror}") from error
    return digest.hexdigest()


def run_task(task: SweepTask) -> dict[str, Any]:
    """Trains on the twin with one thread, evaluates on held-out people, and returns a row (``ROW_UNITS``).

    Raises:
        InputError: the twin or the training cannot use the scenario.
    """
    # torch, only where one trains
    from pace_drake.learning.greedy import GreedyPolicy
    from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo

    scenario = task.scenario
    started = time.perf_counter()
    model = train_ppo(scenario, replace(TWIN_SETTINGS, steps=task.steps, seed=task.cell.seed), backend="twin")
    training_time = time.perf_counter() - started
    row: dict[str, Any] = {
        "scenario": task.cell.scenario,
        "estimator": task.cell.estimator,
        "observation": scenario.observation,
        "human_idle_weight": scenario.task.human_idle_weight,
        "seed": task.cell.seed,
        "steps": task.steps,
        "episodes": task.episodes,
    }
    policy = GreedyPolicy(model, scenario)
    for split in SPLITS:
        played = _evaluate(scenario, policy, split, task.episodes)
        row |= {f"{split}_{name}": value for name, value in _means(played).items()}
    return row | {
        "training_time": training_time,
        "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }


def _evaluate(scenario: Scenario, policy: Policy, split: str, episodes: int) -> Played:
    # Phases do not depend on lambda: one pool serves the tasks that differ in it, or in their seed.
    task = replace(scenario.task, human_idle_weight=1.0)
    pool = _pool(replace(scenario, task=task, human=replace(scenario.human, split=split)).to_yaml())
    held_out = replace(scenario, human=replace(scenario.human, split=split))
    parts = pool.sample(episodes, np.random.default_rng([_EPISODES_SEED, SPLITS.index(split), 1]))
    return play(AssemblyTwin(held_out, pool, episodes), parts, policy)


@lru_cache(maxsize=2 * len(SPLITS))
def _pool(held_out: str) -> Pool:
    """Of a scenario, as text; a pool takes about 2 s."""
    scenario = yaml_load_typed(schema=Scenario, data=held_out)
    rng = np.random.default_rng([_EPISODES_SEED, SPLITS.index(scenario.human.split), 0])
    return make_pool(scenario, load_people(scenario), POOL_SIZE, rng)


def _means(played: Played) -> dict[str, Any]:
    low, high = interval(played.cost)
    return {
        "cost": float(played.cost.mean()),
        "cost_low": low,
        "cost_high": high,
        "robot_idle": played.robot_idle.mean(axis=0).tolist(),
        "human_idle": played.human_idle.mean(axis=0).tolist(),
        "robot_idle_total": float(played.robot_idle.sum(axis=1).mean()),
        "human_idle_total": float(played.human_idle.sum(axis=1).mean()),
        "decisions": float(played.decisions.mean()),
        "truncated": float(1 - played.finished.mean()),
    }


#: Columns of a row in order, with their units. Idle times without ``total`` are lists, one value per joint action.
#: ``cost_low`` and ``cost_high`` bound the 95 % interval of the mean; ``decisions`` are per episode, ``truncated`` is
#: the share of episodes that were cut off. ``peak_memory`` is that of the worker up to then.
ROW_UNITS: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "estimator", "observation"), ""),
    **{name: "-" for name in ("human_idle_weight", "seed", "steps", "episodes")},
    **{
        f"{split}_{name}": "-" if name in ("decisions", "truncated") else "s"
        for split in SPLITS
        for name in (
            "cost",
            "cost_low",
            "cost_high",
            "robot_idle",
            "human_idle",
            "robot_idle_total",
            "human_idle_total",
            "decisions",
            "truncated",
        )
    },
    "training_time": "s",
    "peak_memory": "byte",
}
