"""Whose hands a scenario sees: the demonstrations that are played and the references they are compared with."""

from dataclasses import dataclass, replace
from functools import cache
from typing import cast

import numpy as np

from pace_drake.demos import Demonstration, generate_demonstrations, read_demonstrations
from pace_drake.demos.model import Split
from pace_drake.dtw import Distance, OpenEndKernel
from pace_drake.errors import InputError
from pace_drake.scenario import SYNTHETIC, HumanConfig, Scenario
from pace_drake.task import Episode, sample_episode


@dataclass(frozen=True)
class People:
    """Demonstrations and references of a scenario's human actions.

    Attributes:
        demonstrations: per human action those that are played; empty for joint actions.
        references: per human action the reference of its estimator; None for joint actions.
        rescale: whether durations are drawn and time axes rescaled to them (paper, Sec. IV-C), or kept as recorded.
        description: one line for people: where the hands come from.
    """

    demonstrations: list[list[Demonstration]]
    references: list[Demonstration | None]
    rescale: bool
    description: str

    def kernels(self, scenario: Scenario) -> list[OpenEndKernel | None]:
        """The phase estimator of each human action, None for joint actions."""
        period = scenario.human.sample_period
        kernels: list[OpenEndKernel | None] = []
        for action, reference in zip(scenario.task.human_actions, self.references, strict=True):
            if reference is None:
                kernels.append(None)
                continue
            config = scenario.estimator_of(action.name)
            kernels.append(
                OpenEndKernel(
                    reference.resample(period).p_WH,
                    gamma=config.gamma,
                    distance=cast(Distance, config.distance),
                    window=round(config.window / period),
                )
            )
        return kernels

    def sample(self, scenario: Scenario, rng: np.random.Generator) -> Episode:
        """Draws one episode; with recorded hands as recorded, their durations are the recordings'."""
        episode = sample_episode(scenario.task, rng, [len(group) for group in self.demonstrations])
        if self.rescale:
            return episode
        human = episode.human.copy()
        for k, group in enumerate(self.demonstrations):
            if group:
                human[k] = group[episode.demonstration[k]].duration
        return replace(episode, human=human)


def load_people(scenario: Scenario) -> People:
    """Makes or reads the demonstrations that a scenario names.

    A recording is matched to human actions by its ``action`` labels; a file without a matching label is played in
    every non-joint action. With recordings of two people or more, the reference is the first person's recording of
    median length and the others' are played; with one person, their recording of median length is the reference and
    the rest are played; a single recording is compared with the scenario's synthetic reference, and says so. All are
    moved to the scenario's workplace by one vector.

    Raises:
        InputError: a file that cannot be used.
    """
    config = scenario.human
    names = [None if action.joint else action.name for action in scenario.task.human_actions]
    if config.demonstrations == SYNTHETIC:
        return _synthetic(config, names)
    recorded = _at_workplace(read_demonstrations(scenario.resolve(config.demonstrations)), config.workplace)
    demonstrations: list[list[Demonstration]] = []
    references: list[Demonstration | None] = []
    notes: set[str] = set()
    # Made only where a single recording has nothing else to be compared with, and then once.
    synthetic = cache(lambda: generate_demonstrations(seed=config.seed))
    for name in names:
        if name is None:
            demonstrations.append([])
            references.append(None)
            continue
        of_action = [d for d in recorded if d.action == name] or recorded
        reference, played = _reference_and_rest(of_action)
        if reference is None:
            known = synthetic()
            reference = known.reference(name) if name in known.actions else played[0]
            notes.add("compared with a SYNTHETIC reference, as the file holds one recording only")
        else:
            notes.add(f"reference of {reference.subject}, played: {', '.join(sorted({d.subject for d in played}))}")
        demonstrations.append(played)
        references.append(reference)
    kind = "SYNTHETIC" if any(d.synthetic for d in recorded) else "recorded"
    return People(
        demonstrations,
        references,
        False,
        f"{kind} hands from {config.demonstrations} ({'; '.join(sorted(notes))})",
    )


def _synthetic(config: HumanConfig, names: list[str | None]) -> People:
    synthetic = generate_demonstrations(seed=config.seed)
    demonstrations: list[list[Demonstration]] = []
    references: list[Demonstration | None] = []
    chosen = synthetic.split(cast(Split, config.split))
    for name in names:
        if name is None:
            demonstrations.append([])
            references.append(None)
        elif name in synthetic.actions:
            demonstrations.append(list(chosen.of(name)))
            references.append(chosen.reference(name))
        else:
            raise InputError(
                f"human.demonstrations: the synthetic set has no action {name!r}; it has "
                f"{', '.join(synthetic.actions)}; name a file of recorded demonstrations instead"
            )
    return People(
        demonstrations,
        references,
        True,
        f"SYNTHETIC people (seed {config.seed}, {config.split} trials), not recordings",
    )


def _at_workplace(recorded: list[Demonstration], workplace: list[float]) -> list[Demonstration]:
    if not workplace:
        return recorded
    shift = np.array(workplace) - np.mean(np.concatenate([d.p_WH for d in recorded]), axis=0)
    return [replace(d, p_WH=d.p_WH + shift) for d in recorded]


def _reference_and_rest(recorded: list[Demonstration]) -> tuple[Demonstration | None, list[Demonstration]]:
    subjects = list(dict.fromkeys(d.subject for d in recorded))
    if len(recorded) == 1:
        return None, recorded
    first = [d for d in recorded if d.subject == subjects[0]]
    by_length = sorted(first, key=lambda d: d.duration)
    reference = by_length[(len(by_length) - 1) // 2]
    rest = [d for d in recorded if (d.subject != subjects[0] if len(subjects) > 1 else d is not reference)]
    return reference, rest
