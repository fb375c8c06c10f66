"""Policies in redrawn worlds of people: how much of a difference is the policies', and how much the people's.

A world is a seed: five people who are known (their training trials, from which references, calibrations, thresholds
and policies come, and their validation trials), and twelve who are not. Everything is searched, fitted and trained
anew in each world, on training trials alone, and all play the same episodes of it.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pace_drake.envs.pool import Pool, cached_pool, make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.errors import InputError
from pace_drake.evaluate.fitted_optimum import fitted_optimum
from pace_drake.evaluate.perfect_phase import play_with_perfect_phase
from pace_drake.evaluate.play import Played, play
from pace_drake.evaluate.policies import POOL_SIZE, Player, clairvoyant_costs, play_all
from pace_drake.evaluate.thresholds import RULES, search_thresholds
from pace_drake.evaluate.timed_optimum import timed_optimum
from pace_drake.observation import FUSED_SETS, OBSERVATION_SETS
from pace_drake.people import NUM_UNSEEN, load_people
from pace_drake.policies import Policy
from pace_drake.policies.factory import make_policy
from pace_drake.processes import worker_processes
from pace_drake.scenario import SYNTHETIC, Scenario

WORLD_SPLITS = ("train", "validation", "unseen")
#: Names of the rows of the table that others are compared with.
NO_PHASE, PERFECT, EXPLICIT, FITTED = "optimum without phase", "perfect phase", "explicit query", "fitted optimum"
CLAIRVOYANT = "clairvoyant"

#: Trains a policy in a scenario (its observation set says what it sees), with a seed.
Train = Callable[[Scenario, int], Policy]


def ppo_name(observation: str) -> str:
    """The name of a learned policy's row."""
    return f"PPO, {observation}" if observation != "none" else "PPO, no phase"


@dataclass(frozen=True)
class WorldResult:
    """What every policy did in one world.

    Attributes:
        seed: of the world.
        played: by split and policy.
        clairvoyant: by split, (E,) [s] least possible costs.
        person: by split, (E,) who played each episode, from 0.
        phase_rmse: by split, of the paper's phase at all samples of the pool's non-joint actions.
    """

    seed: int
    played: dict[str, dict[str, Played]]
    clairvoyant: dict[str, np.ndarray]
    person: dict[str, np.ndarray]
    phase_rmse: dict[str, float]


@dataclass(frozen=True)
class Sizes:
    """On how much things are searched, fitted and played.

    Attributes:
        training_draws, draws: of each human action, in the pool of training and in those that are played.
        search_episodes: in which thresholds are searched.
        fit_episodes: from which surfaces are fitted.
    """

    training_draws: int = POOL_SIZE
    draws: int = 480
    search_episodes: int = 6000
    fit_episodes: int = 30_000


@dataclass(frozen=True)
class WorldTask:
    """One world to be evaluated; it can be sent to another process.

    Attributes:
        scenario: its task, estimators and chart; its people must be synthetic.
        seed: of the world, and of all that is random in it.
        episodes: per split and policy.
        train: trains the learned policies; None: there are none.
        observations: the observation sets that policies are learnt for.
        given: more policies to play, as ``policies.factory`` names them.
        splits: of the people that play.
        phase_error: see ``with_phase_error``; while playing alone, nobody has trained with it.
        sizes: see there.
    """

    scenario: Scenario
    seed: int
    episodes: int
    train: Train | None = None
    observations: tuple[str, ...] = tuple(OBSERVATION_SETS)
    given: tuple[str, ...] = ()
    splits: tuple[str, ...] = WORLD_SPLITS
    phase_error: float = 0.0
    sizes: Sizes = Sizes()


def evaluate_worlds(
    tasks: Sequence[WorldTask], jobs: int = 1, done: Callable[[int], None] = lambda _number: None
) -> list[WorldResult]:
    """Evaluates worlds, in processes of their own if there are several jobs; the results are the same.

    Args:
        tasks: at least one.
        jobs: how many at once.
        done: told how many are done.

    Raises:
        InputError: see ``evaluate_world``.
    """
    if jobs == 1 or len(tasks) == 1:
        found = []
        for number, task in enumerate(tasks):
            found.append(evaluate_world(task))
            done(number + 1)
        return found
    with worker_processes(min(jobs, len(tasks))) as workers:
        futures = [workers.submit(evaluate_world, task) for task in tasks]
        for number, future in enumerate(as_completed(futures)):
            future.result()  # one that failed ends them all
            done(number + 1)
        return [future.result() for future in futures]


def evaluate_world(task: WorldTask) -> WorldResult:
    """Makes the people of one world, everything that is learnt from them, and plays it all.

    Raises:
        InputError: the people are recordings: they cannot be drawn anew.
    """
    scenario, seed = task.scenario, task.seed
    if scenario.human.demonstrations != SYNTHETIC:
        raise InputError("human.demonstrations: worlds of people are redrawn, which recordings cannot be")
    players = roster(scenario, seed, task.train, task.observations, task.sizes)
    for name in task.given:
        policy = make_policy(name, scenario, any_observation=True)
        players[f"given: {Path(name).name}"] = partial(play, policy=policy)
    playing = {}
    for split in task.splits:
        rng = np.random.default_rng([seed, WORLD_SPLITS.index(split)])
        playing[split] = _twin_of(
            in_world(scenario, seed, split), task.episodes, rng, task.sizes.draws, task.phase_error
        )
    played = {split: play_all(twin, parts, players) for split, (twin, parts) in playing.items()}
    return _result(seed, playing, played)


def evaluate_given(
    scenario: Scenario,
    policies: Mapping[str, Policy],
    seed: int,
    episodes: int,
) -> WorldResult:
    """Plays given policies in the scenario's own world: with all splits of its people, or with the recorded hands.

    The bounds that need no training stand beside them.

    Args:
        scenario: see ``evaluate_world``; its people may be recordings.
        policies: by name.
        seed: of the episodes.
        episodes: per split and policy.

    Raises:
        InputError: a learned policy was trained with another phase estimate.
    """
    people = load_people(scenario)
    # All sets that the filter is in have the same estimators, and so have all others.
    for fused in (False, True):
        alike = [policy for policy in policies.values() if (policy.observation in FUSED_SETS) == fused]
        if alike:
            meant = replace(scenario, observation=alike[0].observation)
            estimators = people.estimators(meant)
            for policy in alike:
                policy.check_estimates(meant, people, estimators)
    synthetic = scenario.human.demonstrations == SYNTHETIC
    observation = "history" if any(p.observation in FUSED_SETS for p in policies.values()) else scenario.observation
    players: dict[str, Player] = {name: partial(play, policy=policy) for name, policy in policies.items()}
    players[NO_PHASE] = partial(play, policy=timed_optimum(scenario).policy)
    players[PERFECT] = play_with_perfect_phase
    splits = {}
    for number, split in enumerate(WORLD_SPLITS if synthetic else ("recorded",)):
        changed = deepcopy(scenario)
        changed.observation = observation
        if synthetic:
            changed.human.split = split
        splits[split] = _twin_of(changed, episodes, np.random.default_rng([seed, number]), Sizes().draws)
    played = {split: play_all(twin, parts, players) for split, (twin, parts) in splits.items()}
    return _result(scenario.human.seed, splits, played)


def _result(
    seed: int, splits: Mapping[str, tuple[AssemblyTwin, np.ndarray]], played: dict[str, dict[str, Played]]
) -> WorldResult:
    return WorldResult(
        seed,
        played,
        {split: clairvoyant_costs(twin, parts) for split, (twin, parts) in splits.items()},
        {split: twin.pool.person(parts) for split, (twin, parts) in splits.items()},
        {split: phase_rmse(twin) for split, (twin, _) in splits.items()},
    )


def roster(
    scenario: Scenario,
    seed: int,
    train: Train | None = None,
    observations: tuple[str, ...] = tuple(OBSERVATION_SETS),
    sizes: Sizes = Sizes(),
) -> dict[str, Player]:
    """All policies and bounds of the table, searched, fitted and trained on the training trials of one world.

    Args as ``WorldTask``.
    """
    known = in_world(scenario, seed, "train")
    rng = np.random.default_rng([seed, 100])
    # The very pool that a policy with this seed is trained on.
    pool = cached_pool(known, load_people(known), sizes.training_draws, [seed, 1])
    policies: dict[str, Policy] = {
        name.replace("_", " "): make_policy(name, known) for name in ("explicit_query", "always_assist", "never_assist")
    }
    search = AssemblyTwin(known, pool, sizes.search_episodes), pool.sample(sizes.search_episodes, rng)
    for rule in RULES:
        policies[rule.replace("_", " ")] = search_thresholds(*search, rule).policy
    policies[NO_PHASE] = timed_optimum(known).policy
    policies[FITTED] = fitted_optimum(
        AssemblyTwin(known, pool, sizes.fit_episodes), pool.sample(sizes.fit_episodes, rng)
    )
    if train is not None:
        for observation in observations:
            learner = deepcopy(known)
            learner.observation = observation
            policies[ppo_name(observation)] = train(learner, seed)
    players: dict[str, Player] = {name: partial(play, policy=policy) for name, policy in policies.items()}
    players[PERFECT] = play_with_perfect_phase
    return players


def in_world(scenario: Scenario, seed: int, split: str) -> Scenario:
    """The scenario with the people of a world, seen with everything that any observation set has."""
    changed = deepcopy(scenario)
    changed.human.seed, changed.human.split, changed.observation = seed, split, "history"
    changed.validate()
    return changed


def _twin_of(
    scenario: Scenario, episodes: int, rng: np.random.Generator, draws: int, phase_error: float = 0.0
) -> tuple[AssemblyTwin, np.ndarray]:
    """A twin with a scenario's people, and the episodes that all policies play."""
    num_people = NUM_UNSEEN if scenario.human.split == "unseen" else None
    pool = make_pool(scenario, load_people(scenario), draws, rng, num_people)
    parts = pool.sample(episodes, rng)
    return AssemblyTwin(scenario, with_phase_error(pool, phase_error, rng), episodes), parts


def with_phase_error(pool: Pool, std: float, rng: np.random.Generator) -> Pool:
    """A pool whose phases are wrong by an offset more, drawn for each action from N(0, std^2), within [0, 1].

    A model of an error, to see what it costs; the phases are no estimator's any more. The remaining time of the filter
    is left as it is.
    """
    if std == 0.0:
        return pool
    phases = pool.phases
    values = phases.values.copy()
    for j in range(len(phases.start)):
        if phases.before[j, 0] == 1.0:  # joint actions
            continue
        for start, length in zip(phases.start[j], phases.length[j], strict=True):
            part = values[start : start + length, :2]
            np.clip(part + std * rng.standard_normal(), 0.0, 1.0, out=part)
    return replace(pool, phases=replace(phases, values=values))


def phase_rmse(twin: AssemblyTwin) -> float:
    """Root mean square error of the paper's phase, over all samples of the pool, against a linear phase."""
    phases, human = twin.pool.phases, twin.pool.human
    squares, count = 0.0, 0
    for j, action in enumerate(twin.scenario.task.human_actions):
        if action.joint:
            continue
        for start, length, seconds in zip(phases.start[j], phases.length[j], human[j], strict=True):
            # The last sample is the one after the end.
            truth = np.arange(length) * twin.scenario.human.sample_period / seconds
            error = (phases.values[start : start + length, 0] - truth)[truth <= 1.0]
            squares, count = squares + float(error @ error), count + len(error)
    return float(np.sqrt(squares / max(count, 1)))
