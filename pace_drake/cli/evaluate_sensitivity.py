"""``pace evaluate sensitivity``: what the results depend on."""

import json
import shlex
from pathlib import Path

import click

from pace_drake.cli.evaluate_policy import trainer, worlds_bar
from pace_drake.cli.tables import rich_table
from pace_drake.cli.tune import jobs_option
from pace_drake.errors import InputError


@click.command("sensitivity", short_help="What the results depend on: lambda, people, phase, tasks.")
@click.argument("scenario", default="ikea_chair")
@click.option(
    "--only",
    type=click.Choice(["lambda", "cases"]),
    help="Only the sweep over lambda, or only the other cases; default both.",
)
@click.option("--episodes", type=click.IntRange(min=2), default=2000, show_default=True, help="Per world and policy.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the first world.")
@click.option("--worlds", type=click.IntRange(min=1), default=1, show_default=True, help="How many worlds of people.")
@click.option("--steps", type=click.IntRange(min=1), help="Decisions to train on; default as pace train.")
@jobs_option
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario.")
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path, dir_okay=False), help="Write all figures there too."
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder for sensitivity.csv, pictures and index.html.")
def sensitivity(
    scenario: str,
    only: str | None,
    episodes: int,
    seed: int,
    worlds: int,
    steps: int | None,
    jobs: int,
    overrides: tuple[str, ...],
    json_file: Path | None,
    out: Path | None,
) -> None:
    """Vary lambda, the spread and distribution of human durations, the phase's error, the length of the robot's
    tasks, and the style of people; search, fit and train in each case anew, and play with unseen people.
    """
    from rich.console import Console

    if json_file is not None and not json_file.parent.is_dir():
        raise InputError(f"{json_file.parent}: no such folder")
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is not empty; choose another --out, or remove it")

    from pace_drake.evaluate.sensitivity import evaluate_cases, lambda_cases, other_cases
    from pace_drake.evaluate.sensitivity_report import Sensitivity, tables, to_json, write_report
    from pace_drake.files import write_whole
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    train, seeds = trainer(steps), range(seed, seed + worlds)
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    lambdas = [] if only == "cases" else lambda_cases()
    others = [] if only == "lambda" else other_cases(loaded)
    with worlds_bar(console, (len(lambdas) + len(others)) * worlds) as done:
        found = evaluate_cases(loaded, [*lambdas, *others], seeds, episodes, train, jobs, done)
    result = Sensitivity(loaded.name, found[: len(lambdas)], found[len(lambdas) :])
    for table in tables(result):
        console.print(rich_table(table))
    if json_file is not None:
        text = json.dumps(to_json(result), indent=1, allow_nan=False) + "\n"
        write_whole(json_file, lambda part: part.write_text(text, encoding="utf-8"))
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{out}: cannot make the folder: {error.strerror}") from None
        words = ["pace", "evaluate", "sensitivity", scenario, "--episodes", str(episodes), "--seed", str(seed)]
        words += ["--worlds", str(worlds), *([] if only is None else ["--only", only])]
        words += [] if steps is None else ["--steps", str(steps)]
        for override in overrides:
            words += ["--set", override]
        write_report(out, result, shlex.join(words))
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)
