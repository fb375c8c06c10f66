"""``pace evaluate policy``: who waited for whom, policy by policy."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import set_option, set_words
from pace_drake.cli.outputs import check_outputs, json_option, make_folder, out_option, write_json
from pace_drake.cli.tables import rich_table, wide_console
from pace_drake.cli.tune import jobs_option
from pace_drake.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from pace_drake.evaluate.policy_report import Comparison
    from pace_drake.evaluate.worlds import Train, WorldResult
    from pace_drake.scenario import Scenario


@click.command("policy", short_help="Compare policies on the same episodes.")
@click.argument("scenario", default="ikea_chair")
@click.option(
    "--policy",
    "names",
    multiple=True,
    help="Name or .onnx file; may be given several times. Default: all rules that end, and the learned one.",
)
@click.option("--episodes", type=click.IntRange(min=2), default=2000, show_default=True, help="Per split of people.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of everything random.")
@click.option(
    "--worlds",
    type=click.IntRange(min=1),
    help="Redraw the people so often, and search, fit and train everything anew: Table I with its bounds.",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    help="With --worlds: decisions that each policy is trained on; default as pace train.",
)
@jobs_option
@set_option
@json_option
@out_option("policies.csv, pictures and index.html")
def policy(
    scenario: str,
    names: tuple[str, ...],
    episodes: int,
    seed: int,
    worlds: int | None,
    steps: int | None,
    jobs: int,
    overrides: tuple[str, ...],
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Play policies on the same episodes of SCENARIO, and show who waited for whom.

    The people are those whom the estimators know, with training and with validation trials, and people whom nothing
    was learnt from. Durations only, by the compiled twin. Without --worlds: given policies, in the scenario's world.
    """
    check_outputs(json_file, out)
    if steps is not None and worlds is None:
        raise InputError("--steps: policies are trained with --worlds only")

    from pace_drake.evaluate.policy_report import studies, tables, to_json, write_report
    from pace_drake.evaluate.worlds import WorldTask, evaluate_worlds
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    console = wide_console()
    if worlds is None:
        with console.status("playing"):
            comparison = _given(loaded, names, episodes, seed)
    else:
        train = trainer(steps)
        with worlds_bar(console, worlds) as done:
            tasks = [WorldTask(loaded, world, episodes, train, given=names) for world in range(seed, seed + worlds)]
            comparison = _comparison(loaded, evaluate_worlds(tasks, jobs, done), seed)
    with console.status("simulating studies with participants"):
        study, powers = studies(comparison)
    console.print(comparison.people, markup=False, highlight=False, soft_wrap=True)
    for table in tables(comparison, study, powers):
        console.print(rich_table(table))
    if json_file is not None:
        write_json(json_file, to_json(comparison, study, powers))
    if out is not None:
        make_folder(out)
        made_by = _command_line(scenario, names, episodes, seed, worlds, steps, overrides)
        write_report(out, comparison, study, powers, made_by)
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)


def _given(scenario: "Scenario", names: tuple[str, ...], episodes: int, seed: int) -> "Comparison":
    from pace_drake.evaluate.worlds import evaluate_given
    from pace_drake.policies.factory import POLICIES, make_policy

    chosen = names or tuple(name for name in POLICIES if name != "never_assist")
    policies = {Path(n).name.replace("_", " "): make_policy(n, scenario, any_observation=True) for n in chosen}
    return _comparison(scenario, [evaluate_given(scenario, policies, seed, episodes)], seed)


def _comparison(scenario: "Scenario", results: "list[WorldResult]", seed: int) -> "Comparison":
    from pace_drake.evaluate.policy_report import Comparison
    from pace_drake.people import load_people
    from pace_drake.scenario import SYNTHETIC

    synthetic = scenario.human.demonstrations == SYNTHETIC
    if synthetic:
        seeds = ", ".join(str(result.seed) for result in results)
        people = f"SYNTHETIC people, not recordings; worlds: {seeds}. Each: five who are known, and twelve unseen."
    else:
        people = load_people(scenario).description
    cv = tuple(action.duration.cv for action in scenario.task.human_actions if not action.joint)
    title = f"{scenario.name}, lambda {scenario.task.human_idle_weight:g}"
    return Comparison(title, people, synthetic, results, seed, cv)


def trainer(steps: int | None) -> "Train":
    """Trains policies as ``pace train`` does, for so many decisions.

    Raises:
        InputError: the extra ``train`` is not installed.
    """
    from dataclasses import replace

    try:
        from pace_drake.learning.ppo import TWIN_SETTINGS, Trainer
    except ModuleNotFoundError as error:
        raise InputError(f"this trains policies and needs {error.name}: pip install 'pace_drake[train]'") from error
    return Trainer(TWIN_SETTINGS if steps is None else replace(TWIN_SETTINGS, steps=steps))


@contextmanager
def worlds_bar(console: "Console", total: int) -> "Iterator[Callable[[int], None]]":
    """A progress bar over worlds."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("worlds of people"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        item = bar.add_task("", total=total)
        yield lambda done: bar.update(item, completed=done)


def _command_line(
    scenario: str,
    names: tuple[str, ...],
    episodes: int,
    seed: int,
    worlds: int | None,
    steps: int | None,
    overrides: tuple[str, ...],
) -> str:
    words = ["pace", "evaluate", "policy", scenario, "--episodes", str(episodes), "--seed", str(seed)]
    for name in names:
        words += ["--policy", name]
    if worlds is not None:
        words += ["--worlds", str(worlds)]
    if steps is not None:
        words += ["--steps", str(steps)]
    words += set_words(overrides)
    return shlex.join(words)
