"""Pool: drawn durations, with what the estimators say of them, of which episodes of the twin are put together."""

import json
import os
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np

from pace_drake.dtw.ensemble import MedianPhase
from pace_drake.dtw.filter import PhaseFilter
from pace_drake.errors import InputError
from pace_drake.files import cache_folder, write_whole
from pace_drake.observation import FUSED_SETS
from pace_drake.people import People
from pace_drake.scenario import Scenario
from pace_drake.task import Episode

#: What the estimators say at a sample (``Phases``), and what they say of joint actions: done (systems.PhaseEstimator).
NUM_ESTIMATES = 4
_JOINT = (1.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Phases:
    """What the estimators say of several actions, end to end.

    Attributes:
        values: (total, 4) after the first sample, the second, ... of each action: the estimator's phase; the phase
            filter's mean and standard deviation of the phase, and its mean remaining time [s], NaN without a filter.
        start, length: where those of an action are.
        before: (N, 4) before the first sample of an action.
    """

    values: np.ndarray
    start: np.ndarray
    length: np.ndarray
    before: np.ndarray


@dataclass(frozen=True)
class Pool:
    """Drawn durations of which episodes are put together.

    Each human action, the robot's tasks, the preparations and the homings of an episode are those of any of K drawn
    episodes, so that K of them make K to the power of N + 3. Where the draws are of several people, the human actions
    of an episode are all one person's.

    Attributes:
        num_people: the first K / num_people draws of human actions are the first person's, and so on.
        human: (N, K) [s]; demonstration: (N, K), -1 for joint actions; phases: of each action and draw.
        robot: (K, NUM_ROBOT_DRAWS, M), preparation: (K, L), homing: (K, L) [s].
    """

    num_people: int
    human: np.ndarray
    demonstration: np.ndarray
    phases: Phases
    robot: np.ndarray
    preparation: np.ndarray
    homing: np.ndarray

    @property
    def num_parts(self) -> int:
        """N + 3: how many draws make an episode."""
        return len(self.human) + 3

    def sample(self, count: int, rng: np.random.Generator, person: np.ndarray | None = None) -> np.ndarray:
        """Draws episodes: (count, N + 3) indices of draws.

        Args:
            count: how many.
            rng: the only source of randomness.
            person: (count,) who plays each of them, from 0; None draws that too.
        """
        n, size = self.human.shape
        parts = rng.integers(size, size=(count, self.num_parts))
        if self.num_people > 1:
            each = size // self.num_people
            who = rng.integers(self.num_people, size=count) if person is None else np.asarray(person)
            parts[:, :n] = who[:, np.newaxis] * each + parts[:, :n] % each
        return parts

    def person(self, parts: np.ndarray) -> np.ndarray:
        """(count,) who plays the episodes of ``sample``, from 0."""
        return parts[:, 0] // (self.human.shape[1] // self.num_people)

    def episode(self, parts: np.ndarray) -> Episode:
        """The episode of one row of ``sample``, as the diagram takes it."""
        n = len(self.human)
        rows = np.arange(n)
        return Episode(
            human=self.human[rows, parts[:n]],
            demonstration=self.demonstration[rows, parts[:n]],
            robot=self.robot[parts[n]],
            preparation=self.preparation[parts[n + 1]],
            homing=self.homing[parts[n + 2]],
        )


#: Draws of each person in a pool, where people differ.
_DRAWS_EACH = 8

#: Usual size of a pool, in training and for comparisons.
POOL_SIZE = 512
#: How many files ``cached_pool`` keeps, those last used.
MAX_CACHED = 20


def make_pool(
    scenario: Scenario,
    people: People,
    size: int,
    rng: np.random.Generator,
    num_people: int | None = None,
) -> Pool:
    """Draws a pool of ``size`` and computes the phases of its (demonstration, duration) pairs.

    Args:
        scenario: a validated scenario.
        people: of the scenario.
        size: K; rounded up to a whole number of draws for each person.
        rng: the only source of randomness.
        num_people: how many play; None takes one for every few draws. Where nothing distinguishes them
            (``pace_correlation`` 0) everybody is the same.
    """
    if not people.rescale or scenario.human.pace_correlation == 0:
        num_people = 1
        drawn = [people.sample(scenario, rng) for _ in range(size)]
    else:
        num_people = num_people or -(-size // _DRAWS_EACH)
        group, each = people.draw_group(num_people, rng), -(-size // num_people)
        drawn = [people.sample(scenario, rng, person) for person in group for _ in range(each)]
    human = np.array([episode.human for episode in drawn]).T.copy()
    demonstration = np.array([episode.demonstration for episode in drawn]).T.copy()
    return Pool(
        num_people,
        human,
        demonstration,
        exact_phases(scenario, people, human, demonstration),
        np.array([episode.robot for episode in drawn]),
        np.array([episode.preparation for episode in drawn]),
        np.array([episode.homing for episode in drawn]),
    )


def exact_phases(scenario: Scenario, people: People, duration: np.ndarray, demonstration: np.ndarray) -> Phases:
    """What the scenario's own estimators say of (demonstration, duration) pairs, sample by sample.

    Args:
        scenario: gives the tracker's period and the estimators.
        people: whose hands.
        duration: (N, K) [s].
        demonstration: (N, K).
    """
    period = scenario.human.sample_period
    found: list[np.ndarray] = []
    before = np.zeros((len(duration), NUM_ESTIMATES))
    for j, estimator in enumerate(people.estimators(scenario)):
        if estimator is None:
            found += [np.array([_JOINT])] * duration.shape[1]
            before[j] = _JOINT
            continue
        hands = []
        for seconds, index in zip(duration[j], demonstration[j], strict=True):
            # One sample more than ticks can fall into the action, whatever its start.
            times = np.arange(int(seconds / period) + 2) * period
            hands.append(people.demonstrations[j][int(index)].positions(times, float(seconds)))
        if isinstance(estimator, PhaseFilter):
            # Once for both: the filter's phase is its mean, the other that of the alignment with the reference.
            several = estimator.estimator
            if isinstance(several, MedianPhase):
                each = [one.phases(hands, num_threads=2) for one in several.estimators]
                reference = each[0]
                aligned = [np.median(phases, axis=0) for phases in zip(*each, strict=True)]
            else:
                reference = aligned = several.phases(hands, num_threads=2)
            elapsed = np.concatenate([np.arange(len(z)) * period for z in aligned])
            fused = estimator.fuse(np.concatenate(aligned), elapsed)
            name = scenario.task.human_actions[j].name
            z = fused.phase if scenario.estimator_of(name).fused else np.concatenate(reference)
            values = np.column_stack([z, fused.phase, fused.phase_std, fused.remaining_time])
            found += np.split(values, np.cumsum([len(one) for one in aligned])[:-1])
            start = PhaseFilter(several, estimator.calibration).estimate_at(estimator.initial_state())
            first = start.phase if scenario.estimator_of(name).fused else several.phase_at(several.initial_state())
            before[j] = first, start.phase, start.phase_std, start.remaining_time
        else:
            nothing = np.full(3, np.nan)
            found += [
                np.column_stack([z, np.tile(nothing, (len(z), 1))]) for z in estimator.phases(hands, num_threads=2)
            ]
            before[j] = estimator.phase_at(estimator.initial_state()), *nothing
    length = np.array([len(phases) for phases in found])
    shape = duration.shape
    start_index = np.concatenate([[0], np.cumsum(length)[:-1]])
    return Phases(np.concatenate(found), start_index.reshape(shape), length.reshape(shape), before)


def cached_pool(scenario: Scenario, people: People, size: int, seed: int | Sequence[int]) -> Pool:
    """The pool that ``make_pool`` draws with a generator of this seed, kept in the user's cache.

    A file is found by the hash of all that determines it, this program's text included; one that is damaged is made
    again, with a warning. The ``MAX_CACHED`` last used are kept.

    Args:
        scenario: a validated scenario.
        people: of the scenario.
        size: see ``make_pool``.
        seed: of all draws.
    """
    key = pool_key(scenario, people, size, seed)
    path = cache_folder("pools") / f"pool_{key[:24]}.npz"
    try:
        pool = _read_pool(path, key)
        os.utime(path)  # used last
        return pool
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        warnings.warn(f"{path}: damaged ({error}), the pool is made again", stacklevel=2)
    pool = make_pool(scenario, people, size, np.random.default_rng(seed))
    try:
        write_whole(path, lambda part: _write_pool(part, pool, key))
        kept = sorted(path.parent.glob("pool_*.npz"), key=lambda file: file.stat().st_mtime_ns)
        for old in kept[:-MAX_CACHED]:
            old.unlink(missing_ok=True)
    except (OSError, InputError) as error:  # another process that tidies up, or a full disk
        warnings.warn(f"the pool cannot be kept: {error}", stacklevel=2)
    return pool


def pool_key(scenario: Scenario, people: People, size: int, seed: int | Sequence[int]) -> str:
    """Hash of all that determines the pool of ``cached_pool``: equal keys, equal pools."""
    package = Path(__file__).resolve().parents[1]
    texts = (*sorted((package / "dtw").glob("*.py")), *(package / f"{name}.py" for name in _MODULES))
    content = {
        # Lambda weighs what happens and changes nothing of it.
        "task": {**asdict(scenario.task), "human_idle_weight": None},
        "estimator": {name: asdict(config) for name, config in scenario.estimator.items()},
        "estimator_file": sha256(scenario.resolve(scenario.estimator_file).read_bytes()).hexdigest()
        if scenario.estimator_file
        else "",
        "fused": scenario.observation in FUSED_SETS,
        "sample_period": scenario.human.sample_period,
        "pace_correlation": scenario.human.pace_correlation,
        "rescale": people.rescale,
        "size": size,
        "seed": np.asarray(seed).tolist(),
        "versions": {name: version(name) for name in ("numpy", "scipy", "numba")},
        "program": [sha256(path.read_bytes()).hexdigest() for path in texts],
    }
    digest = sha256(json.dumps(content, sort_keys=True).encode())
    for group in (*people.demonstrations, [d for d in people.references if d is not None], *people.training):
        digest.update(b"group")
        for d in group:
            about = [d.action, d.subject, d.trial, d.sample_period, d.num_samples]
            digest.update(json.dumps(about).encode() + d.p_WH.tobytes())
    return digest.hexdigest()


#: The modules beside ``dtw`` whose text determines a pool.
_MODULES = ("people", "alignments", "task", "envs/pool", "demos/model")
_PHASES, _ARRAYS = (
    [field.name for field in fields(Phases)],
    ["human", "demonstration", "robot", "preparation", "homing"],
)


def _write_pool(path: Path, pool: Pool, key: str) -> None:
    arrays = {name: getattr(pool, name) for name in _ARRAYS}
    arrays |= {f"phases_{name}": getattr(pool.phases, name) for name in _PHASES}
    np.savez(path, allow_pickle=False, about=np.array(json.dumps({"key": key, "people": pool.num_people})), **arrays)


def _read_pool(path: Path, key: str) -> Pool:
    with np.load(path, allow_pickle=False) as file:  # checks the sum of every array
        about = json.loads(str(file["about"]))
        if about["key"] != key:
            raise ValueError("it is another pool")
        phases = Phases(**{name: file[f"phases_{name}"] for name in _PHASES})
        pool = Pool(num_people=int(about["people"]), phases=phases, **{name: file[name] for name in _ARRAYS})
    # The compiled kernel looks up without asking.
    if not (phases.start >= 0).all() or not (phases.start + phases.length <= len(phases.values)).all():
        raise ValueError("its phases are not where it says")
    return pool
