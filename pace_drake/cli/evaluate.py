"""``pace evaluate``: how good the parts are: phase estimators, policies."""

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.tune import data_option, jobs_option, run_with_progress, seed_option, trials_option
from pace_drake.errors import InputError

if TYPE_CHECKING:
    from pace_drake.evaluate.phase_report import Table


@click.group("evaluate", short_help="Compare phase estimators, or policies.")
def command() -> None:
    """Measure how good the parts are."""


@command.command("phase", short_help="Compare phase estimators, tuned on training signals, on held-out people.")
@data_option
@seed_option
@trials_option
@jobs_option
@click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the MSE by action, estimator and part to this file; an older one is replaced.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder for scores.csv, fig7.png, errors.png, index.html.")
def phase(data: str, seed: int, trials: int, jobs: int, json_file: Path | None, out: Path | None) -> None:
    """Tune and fit phase estimators on training signals, and compare them on those and on what was held out.

    The truth is a linear phase. Remaining times in [s]; p50 and p99 are wall times of one update. Same command, same
    numbers (but the wall times), whatever --jobs.
    """
    from rich.console import Console

    if json_file is not None and not json_file.parent.is_dir():
        raise InputError(f"{json_file.parent}: no such folder")
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is not empty; choose another --out, or remove it")

    from pace_drake.evaluate.phase import evaluate, fit_all, searches
    from pace_drake.evaluate.phase_report import tables, write_report
    from pace_drake.evaluate.tuning import load_signals
    from pace_drake.files import write_whole

    signals = load_signals(data, seed)
    jobs_to_do = searches(signals, trials, seed)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{out}: cannot make the folder: {error.strerror}") from None
    console = Console()
    console.print(signals.description, markup=False, highlight=False, soft_wrap=True)
    try:
        fitted = fit_all(signals, run_with_progress(jobs_to_do, jobs, trials))
        with console.status("scoring"):
            evaluation = evaluate(signals, fitted)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("nothing was written") from None
    for table in tables(evaluation):
        console.print(_rich_table(table))
    if json_file is not None:
        text = json.dumps(evaluation.mse(), indent=1, allow_nan=False) + "\n"
        write_whole(json_file, lambda part: part.write_text(text, encoding="utf-8"))
    if out is not None:
        command_line = f"pace evaluate phase --data {shlex.quote(data)} --seed {seed} --trials {trials}"
        write_report(out, evaluation, command_line)
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)


@command.command("policy", short_help="Compare policies on the same episodes.")
@click.argument("scenario", default="ikea_chair")
@click.option(
    "--policy",
    "names",
    multiple=True,
    help="Name or .onnx file; may be given several times. Default: all rules that end, and the learned one.",
)
@click.option("--episodes", type=click.IntRange(min=2), default=2000, show_default=True, help="How many.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episodes.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario.")
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures there too."
)
def policy(
    scenario: str,
    names: tuple[str, ...],
    episodes: int,
    seed: int,
    overrides: tuple[str, ...],
    json_file: Path | None,
) -> None:
    """Play policies on the same episodes of SCENARIO, and show who waited for whom.

    Idle times [s] per joint action (robot / human), the cost with its 95 % interval, and what each saves against the
    first policy, on the same episodes. Durations only, by the compiled twin.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as RichTable

    if json_file is not None and not json_file.parent.is_dir():
        raise InputError(f"{json_file.parent}: no such folder")

    from pace_drake.evaluate.policies import evaluate_policies
    from pace_drake.files import write_whole
    from pace_drake.people import load_people
    from pace_drake.policies.factory import POLICIES, make_policy
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    chosen = names or tuple(name for name in POLICIES if name != "never_assist")
    people = load_people(loaded)
    results, limit = evaluate_policies(loaded, people, {n: make_policy(n, loaded) for n in chosen}, episodes, seed)
    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    console.print(people.description, markup=False, highlight=False, soft_wrap=True)
    title = f"{loaded.name}, {episodes} episodes, seed {seed}: seconds, robot / human; saving on {Path(chosen[0]).name}"
    shown = RichTable(title=escape(title), title_justify="left")
    joints = [f"joint {k + 1}" for k in range(len(results[0].robot_idle))]
    shown.add_column("policy", no_wrap=True)
    for head in (*joints, "robot", "human", "cost", "saving", "cut off"):
        shown.add_column(head, justify="right")
    for result in results:
        idle = [f"{r:.1f} / {h:.1f}" for r, h in zip(result.robot_idle, result.human_idle, strict=True)]
        half, half_saving = (high - low for low, high in (result.cost_interval, result.saving_interval))
        shown.add_row(
            escape(Path(result.policy).name),
            *idle,
            f"{sum(result.robot_idle):.1f}",
            f"{sum(result.human_idle):.1f}",
            f"{result.cost:.2f} ± {half / 2:.2f}",
            f"{result.saving:.2f} ± {half_saving / 2:.2f}",
            f"{100 * result.truncated:.0f} %" if result.truncated else "-",
        )
    console.print(shown)
    console.print(f"least possible cost, all durations known beforehand: {limit:.2f}", highlight=False)
    if json_file is not None:
        data = {
            "scenario": loaded.name,
            "clairvoyant_cost": limit,
            "people": people.description,
            "seed": seed,
            "policies": [result.to_json() for result in results],
        }
        text = json.dumps(data, indent=1, allow_nan=False) + "\n"
        write_whole(json_file, lambda part: part.write_text(text, encoding="utf-8"))


def _rich_table(table: "Table") -> object:
    from rich import box
    from rich.markup import escape
    from rich.table import Table as RichTable

    # Narrow enough for 80 columns.
    drawn = RichTable(
        title=f"\n{escape(table.title)}",
        box=box.SIMPLE_HEAD,
        title_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )
    for k, name in enumerate(table.columns):
        drawn.add_column(escape(name), justify="right" if k else "left", no_wrap=True)
    for row in table.rows:
        drawn.add_row(*map(escape, row))
    return drawn
