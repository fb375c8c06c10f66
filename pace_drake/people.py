"""Whose hands a scenario sees: the demonstrations that are played and the references they are compared with."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from pace_drake.alignments import calibrate, choose_reference, make_alignment, make_ensemble
from pace_drake.demos import Demonstration, generate_demonstrations, read_demonstrations
from pace_drake.demos.model import DemonstrationSet, Split
from pace_drake.dtw.end import EndDetector
from pace_drake.dtw.estimator import Estimator
from pace_drake.dtw.estimator_file import ActionEstimator, read_estimator_file
from pace_drake.dtw.filter import Calibration, PhaseFilter
from pace_drake.errors import InputError, require
from pace_drake.observation import FUSED_SETS
from pace_drake.scenario import SYNTHETIC, EstimatorConfig, Scenario
from pace_drake.task import Duration, Episode, HumanAction, sample_episode

#: Unseen people: how many, and by how much the seed of their generation differs from that of the known ones.
NUM_UNSEEN = 12
_UNSEEN_SEED = 1 << 20


@dataclass(frozen=True)
class Person:
    """Somebody who plays episodes.

    Attributes:
        subject: whose demonstrations.
        pace: standard normal score, above 0 is slower; see ``task.sample_episode``.
    """

    subject: str
    pace: float


@dataclass(frozen=True)
class People:
    """Demonstrations and references of a scenario's human actions.

    Attributes:
        demonstrations: per human action those that are played; empty for joint actions.
        references: per human action the reference of its estimator; None for joint actions.
        training: per human action other demonstrations, of known people, that an estimator may learn from; empty for
            joint actions and for recordings, which are all played.
        rescale: whether durations are drawn and time axes rescaled to them (paper, Sec. IV-C), or kept as recorded.
        description: one line for people: where the hands come from.
        shift: (3) [m] by which the recordings were moved to the scenario's workplace, and with them whatever stands in
            an estimator file.
    """

    demonstrations: list[list[Demonstration]]
    references: list[Demonstration | None]
    training: list[list[Demonstration]]
    rescale: bool
    description: str
    shift: NDArray = field(default_factory=lambda: np.zeros(3))

    def estimators(self, scenario: Scenario) -> list[Estimator | None]:
        """The phase estimator of each human action, None for joint actions.

        A filter stands over the alignment wherever it can be calibrated: from an estimator file, or from training
        trials. Where the scenario does not ask for its phase, it only adds rate and remaining time.

        Raises:
            InputError: the estimator file cannot be used, or an action is to be fused that nothing calibrates.
        """
        period = scenario.human.sample_period
        tuned = self._tuned(scenario)
        estimators: list[Estimator | None] = []
        for action, reference, training in zip(
            scenario.task.human_actions, self.references, self.training, strict=True
        ):
            if reference is None:
                estimators.append(None)
                continue
            config = scenario.estimator_of(action.name)
            fused = config.fused or scenario.observation in FUSED_SETS
            alignment: Estimator = make_alignment(config, reference, period)
            calibration: Calibration | None = None
            if action.name in tuned:
                alignment, calibration = tuned[action.name].alignment(period), tuned[action.name].calibration
            elif len(training) > 1:
                if fused and config.ensemble:
                    alignment = make_ensemble(config, alignment, reference, training, period)
                calibration = calibrate(action, alignment, reference, training, period, self.rescale)
            if calibration is None:
                require(
                    not fused,
                    f"estimator.{action.name}.fused" if config.fused else f"observation: {scenario.observation}",
                    "needs an estimator_file (pace tune): recorded hands that are played calibrate nothing",
                )
                estimators.append(alignment)
            else:
                estimators.append(PhaseFilter(alignment, calibration, fused=fused))
        return estimators

    def end_detectors(self, scenario: Scenario, estimators: list[Estimator | None]) -> list[EndDetector | None]:
        """The end detector of each human action; None for joint actions, and everywhere if only the button counts.

        The hand ends an action where it does in the demonstrations that its estimator was tuned on; where no file says
        so, in the training trials, or, without any, in the reference.

        Args:
            scenario: says whether the hand counts.
            estimators: those that `estimators` returned for it.

        Raises:
            InputError: an action has no calibrated filter.
        """
        if scenario.human.monitor == "button":
            return [None] * len(self.references)
        tuned = self._tuned(scenario)
        detectors: list[EndDetector | None] = []
        for action, estimator, reference, training in zip(
            scenario.task.human_actions, estimators, self.references, self.training, strict=True
        ):
            if reference is None:
                detectors.append(None)
                continue
            if not isinstance(estimator, PhaseFilter):
                raise InputError(
                    f"human.monitor: the end of {action.name} cannot be detected without a calibrated filter; name an"
                    " estimator_file (pace tune), or use the button"
                )
            if action.name in tuned:
                goal = tuned[action.name].goal
            else:
                goal = np.mean([d.p_WH[-1] for d in (reference, *training)], axis=0)
            detectors.append(EndDetector(estimator, goal))
        return detectors

    def _tuned(self, scenario: Scenario) -> Mapping[str, ActionEstimator]:
        """What the estimator file says of each action, where the recordings are."""
        found = _estimator_file(scenario)
        return {name: one.moved(self.shift) for name, one in found.items()} if self.shift.any() else found

    @property
    def subjects(self) -> tuple[str, ...]:
        """Whose demonstrations are played."""
        return tuple(dict.fromkeys(d.subject for group in self.demonstrations for d in group))

    def draw_person(self, rng: np.random.Generator) -> Person:
        """Draws one of the subjects, with any pace: how people vary in training."""
        return Person(self.subjects[int(rng.integers(len(self.subjects)))], float(rng.standard_normal()))

    def draw_group(self, num: int, rng: np.random.Generator) -> list[Person]:
        """Draws ``num`` people, among whom every subject and every pace has its share.

        Subjects take turns. Paces are the quantiles of their distribution in random order, so that a small group has
        slow and fast people as they exist.
        """
        paces = ndtri((rng.permutation(num) + 0.5) / num)
        subjects = self.subjects
        return [Person(subjects[k % len(subjects)], float(pace)) for k, pace in enumerate(paces)]

    def sample(self, scenario: Scenario, rng: np.random.Generator, person: Person | None = None) -> Episode:
        """Draws one episode; with recorded hands as recorded, their durations are the recordings'.

        Args:
            scenario: gives the task and ``human.pace_correlation``.
            rng: the only source of randomness.
            person: who plays it; None draws somebody. Where the correlation is 0 nobody in particular plays: every
                action is drawn by itself.
        """
        counts = [len(group) for group in self.demonstrations]
        correlation = scenario.human.pace_correlation if self.rescale else 0.0
        if correlation == 0.0:
            episode = sample_episode(scenario.task, rng, counts)
            if self.rescale:
                return episode
        else:
            person = person or self.draw_person(rng)
            own = [[k for k, d in enumerate(g) if d.subject == person.subject] for g in self.demonstrations]
            episode = sample_episode(scenario.task, rng, [len(g) for g in own], person.pace, correlation)
            chosen = [g[k] if g else -1 for g, k in zip(own, episode.demonstration, strict=True)]
            return replace(episode, demonstration=np.array(chosen))
        human = episode.human.copy()
        for k, group in enumerate(self.demonstrations):
            if group:
                human[k] = group[episode.demonstration[k]].duration
        return replace(episode, human=human)


def load_people(scenario: Scenario, *, tracked: bool = False) -> People:
    """Makes or reads the demonstrations that a scenario names.

    A recording is matched to human actions by its ``action`` labels; a file without a matching label is played in
    every non-joint action. With recordings of two people or more, the reference is the first person's recording of
    median length and the others' are played; with one person, their recording of median length is the reference and
    the rest are played; a single recording is compared with the scenario's synthetic reference, and says so. All are
    moved to the scenario's workplace by one vector, unless the hand that they are compared with is a real one.

    Args:
        scenario: names them.
        tracked: whether they are for a real, tracked person. Their hand is in the world frame and is not moved, so
            neither are recordings: they must be in the world frame, too.

    Raises:
        InputError: a file that cannot be used.
    """
    config = scenario.human
    names = [None if action.joint else action.name for action in scenario.task.human_actions]
    if config.demonstrations == SYNTHETIC:
        return _synthetic(scenario, names)
    recorded = read_demonstrations(scenario.resolve(config.demonstrations))
    shift = np.zeros(3) if tracked else _to_workplace(recorded, config.workplace)
    if shift.any():
        recorded = [replace(d, p_WH=d.p_WH + shift) for d in recorded]
    demonstrations: list[list[Demonstration]] = []
    references: list[Demonstration | None] = []
    notes: set[str] = set()
    for name, action in zip(names, scenario.task.human_actions, strict=True):
        if name is None:
            demonstrations.append([])
            references.append(None)
            continue
        of_action = [d for d in recorded if d.action == name] or recorded
        reference, played = _reference_and_rest(of_action)
        if reference is None:
            reference = _reference_of(scenario, action) if name in _known(config.seed).actions else played[0]
            notes.add("compared with a SYNTHETIC reference, as the file holds one recording only")
        else:
            notes.add(f"reference of {reference.subject}, played: {', '.join(sorted({d.subject for d in played}))}")
        demonstrations.append(played)
        references.append(reference)
    kind = "SYNTHETIC" if any(d.synthetic for d in recorded) else "recorded"
    return People(
        demonstrations,
        references,
        [[] for _ in names],
        False,
        f"{kind} hands from {config.demonstrations} ({'; '.join(sorted(notes))})",
        shift,
    )


def _synthetic(scenario: Scenario, names: list[str | None]) -> People:
    config = scenario.human
    synthetic = _known(config.seed)
    demonstrations: list[list[Demonstration]] = []
    references: list[Demonstration | None] = []
    training: list[list[Demonstration]] = []
    known = synthetic.split("train")
    if config.split == "unseen":
        chosen = generate_demonstrations(
            seed=config.seed + _UNSEEN_SEED, num_subjects=NUM_UNSEEN, variety=config.unseen_variety
        )
        who = f"{NUM_UNSEEN} unseen people"
    else:
        who = f"{config.split} trials"
        chosen = synthetic.split(cast(Split, config.split))
    for name, action in zip(names, scenario.task.human_actions, strict=True):
        if name is None:
            demonstrations.append([])
            references.append(None)
            training.append([])
        elif name in synthetic.actions:
            trials = list(known.of(name))
            reference = _reference_of(scenario, action)
            references.append(reference)
            # One that all are compared with says nothing of how others fare.
            demonstrations.append([d for d in chosen.of(name) if d is not reference])
            training.append([d for d in trials if d is not reference])
        else:
            raise InputError(
                f"human.demonstrations: the synthetic set has no action {name!r}; it has "
                f"{', '.join(synthetic.actions)}; name a file of recorded demonstrations instead"
            )
    return People(
        demonstrations,
        references,
        training,
        True,
        f"SYNTHETIC people (seed {config.seed}, {who}), not recordings",
    )


@lru_cache(maxsize=8)
def _known(seed: int) -> DemonstrationSet:
    return generate_demonstrations(seed=seed)


def _reference_of(scenario: Scenario, action: HumanAction) -> Demonstration:
    """The synthetic people's reference of an action that they know."""
    human, estimator = scenario.human, scenario.estimator_of(action.name)
    settings = (tuple(asdict(one).items()) for one in (action.duration, estimator))
    return _chosen_reference(human.seed, action.name, *settings, period=human.sample_period)


@lru_cache(maxsize=64)
def _chosen_reference(
    seed: int, action: str, duration: tuple[tuple[str, Any], ...], estimator: tuple[tuple[str, Any], ...], period: float
) -> Demonstration:
    """Found once: for the actions of a task that takes half a second."""
    synthetic = _known(seed)
    training = synthetic.split("train").of(action)
    candidates = (synthetic.reference(action), *training)
    return choose_reference(
        Duration(**dict(duration)), EstimatorConfig(**dict(estimator)), candidates, training, period
    )


def _estimator_file(scenario: Scenario) -> Mapping[str, ActionEstimator]:
    if not scenario.estimator_file:
        return {}
    path = scenario.resolve(scenario.estimator_file)
    found = read_estimator_file(path)
    require(
        abs(found.sample_period - scenario.human.sample_period) < 1e-9,
        f"{path}",
        f"was tuned for samples every {found.sample_period:g} s, not {scenario.human.sample_period:g} s: set"
        " human.sample_period, or tune anew",
    )
    names = [action.name for action in scenario.task.human_actions if not action.joint]
    require(
        any(name in names for name in found.actions),
        f"{path}",
        f"holds no action of the task; it has {', '.join(found.actions)}, the task {', '.join(names)}",
    )
    for name, one in found.actions.items():
        axes = one.reference.shape[1]
        require(axes == 3, f"{path}: actions.{name}", f"has a reference of {axes} axes, a hand's position has 3")
    return found.actions


def _to_workplace(recorded: list[Demonstration], workplace: list[float]) -> NDArray:
    """The vector from the mean of the recordings to the workplace; zero without one."""
    if not workplace:
        return np.zeros(3)
    return np.array(workplace) - np.mean(np.concatenate([d.p_WH for d in recorded]), axis=0)


def _reference_and_rest(recorded: list[Demonstration]) -> tuple[Demonstration | None, list[Demonstration]]:
    subjects = list(dict.fromkeys(d.subject for d in recorded))
    if len(recorded) == 1:
        return None, recorded
    first = [d for d in recorded if d.subject == subjects[0]]
    by_length = sorted(first, key=lambda d: d.duration)
    reference = by_length[(len(by_length) - 1) // 2]
    rest = [d for d in recorded if (d.subject != subjects[0] if len(subjects) > 1 else d is not reference)]
    return reference, rest
