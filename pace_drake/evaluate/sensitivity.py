"""What the results depend on: lambda, how people vary, the phase, the robot's tasks, the people's style.

Every case is a change of the scenario; worlds are evaluated in it as in ``worlds``, policies trained in it, but for
phase errors and unusual styles, of which training knows nothing.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property

from pace_drake.evaluate.policy_table import Row, rows_of
from pace_drake.evaluate.worlds import Sizes, Train, WorldResult, WorldTask, evaluate_worlds
from pace_drake.scenario import Scenario

LAMBDAS = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)
#: The policies that are trained in each case.
OBSERVATIONS = ("none", "paper", "history")


@dataclass(frozen=True)
class Case:
    """One change of the scenario.

    Attributes:
        group: what is varied.
        value: of it.
        label: for people.
        change: makes the changed scenario from a copy.
        phase_error: see ``worlds.with_phase_error``.
    """

    group: str
    value: float
    label: str
    change: Callable[[Scenario], None]
    phase_error: float = 0.0

    def scenario(self, scenario: Scenario) -> Scenario:
        """The changed scenario."""
        changed = deepcopy(scenario)
        self.change(changed)
        changed.validate()
        return changed


@dataclass(frozen=True)
class CaseResult:
    """What came of a case: its worlds, with unseen people."""

    case: Case
    results: Sequence[WorldResult]

    @cached_property
    def _rows(self) -> dict[str, Row]:
        return {row.policy: row for row in rows_of(self.results, "unseen")}

    def row(self, policy: str) -> Row:
        """The figures of one policy."""
        return self._rows[policy]


def _nothing(_: Scenario) -> None:
    """The scenario as it is."""


def _lambda(value: float) -> Callable[[Scenario], None]:
    def change(scenario: Scenario) -> None:
        scenario.task.human_idle_weight = value

    return change


def _durations(cv: float | None = None, distribution: str | None = None) -> Callable[[Scenario], None]:
    def change(scenario: Scenario) -> None:
        for action in scenario.task.human_actions:
            if not action.joint:
                action.duration.cv = action.duration.cv if cv is None else cv
                action.duration.distribution = distribution or action.duration.distribution

    return change


def _granularity(factor: float) -> Callable[[Scenario], None]:
    def change(scenario: Scenario) -> None:
        for one in scenario.task.robot_tasks:
            one.duration.mean *= factor
            one.duration.minimum *= factor

    return change


def _variety(value: float) -> Callable[[Scenario], None]:
    def change(scenario: Scenario) -> None:
        scenario.human.unseen_variety = value

    return change


def lambda_cases() -> list[Case]:
    """The weights of human idle time."""
    return [Case("lambda", value, f"lambda {value:g}", _lambda(value)) for value in LAMBDAS]


def other_cases(scenario: Scenario) -> list[Case]:
    """Everything else that is varied, one at a time."""
    mean = sum(one.duration.mean for one in scenario.task.robot_tasks) / scenario.task.num_robot_tasks
    return [
        Case("as it is", 0.0, "as it is", _nothing),
        *(Case("human cv", cv, f"human cv {cv:.2f}", _durations(cv)) for cv in (0.10, 0.15, 0.19, 0.26, 0.35)),
        Case("distribution", 1.0, "log-normal durations", _durations(distribution="log_normal")),
        *(
            Case("phase error", e, f"phase offset {e:.2f} rms more", _nothing, phase_error=e)
            for e in (0.05, 0.10, 0.15)
        ),
        *(
            Case("robot task", factor * mean, f"robot tasks of {factor * mean:g} s", _granularity(factor))
            for factor in (0.25, 0.5, 2.0)
        ),
        Case("style", 2.0, "unusual people (styles vary twice as much)", _variety(2.0)),
    ]


def evaluate_cases(
    scenario: Scenario,
    cases: Sequence[Case],
    worlds: Sequence[int],
    episodes: int,
    train: Train,
    jobs: int = 1,
    done: Callable[[int], None] = lambda _number: None,
    sizes: Sizes = Sizes(),  # noqa: B008 - it is frozen
) -> list[CaseResult]:
    """Evaluates worlds in every case, with unseen people.

    Args:
        scenario: what is changed.
        cases: which changes.
        worlds: their seeds.
        episodes: per world and policy.
        train, jobs, done, sizes: see ``worlds``; ``done`` counts worlds of all cases.
    """
    tasks = [
        WorldTask(
            case.scenario(scenario),
            seed,
            episodes,
            train,
            OBSERVATIONS,
            splits=("unseen",),
            phase_error=case.phase_error,
            sizes=sizes,
        )
        for case in cases
        for seed in worlds
    ]
    results = evaluate_worlds(tasks, jobs, done)
    each = len(worlds)
    return [CaseResult(case, results[k * each : (k + 1) * each]) for k, case in enumerate(cases)]
