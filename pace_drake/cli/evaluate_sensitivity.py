"""``pace evaluate sensitivity``: what the results depend on."""

import shlex
from pathlib import Path

import click

from pace_drake.cli.evaluate_policy import trainer, worlds_bar
from pace_drake.cli.options import set_option, set_words
from pace_drake.cli.outputs import check_outputs, json_option, make_folder, out_option, write_json
from pace_drake.cli.tables import rich_table, wide_console
from pace_drake.cli.tune import jobs_option


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
@set_option
@json_option
@out_option("sensitivity.csv, pictures and index.html")
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
    check_outputs(json_file, out)

    from pace_drake.evaluate.sensitivity import evaluate_cases, lambda_cases, other_cases
    from pace_drake.evaluate.sensitivity_report import Sensitivity, tables, to_json, write_report
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    train, seeds = trainer(steps), range(seed, seed + worlds)
    console = wide_console()
    lambdas = [] if only == "cases" else lambda_cases()
    others = [] if only == "lambda" else other_cases(loaded)
    with worlds_bar(console, (len(lambdas) + len(others)) * worlds) as done:
        found = evaluate_cases(loaded, [*lambdas, *others], seeds, episodes, train, jobs, done)
    result = Sensitivity(loaded.name, found[: len(lambdas)], found[len(lambdas) :])
    for table in tables(result):
        console.print(rich_table(table))
    if json_file is not None:
        write_json(json_file, to_json(result))
    if out is not None:
        make_folder(out)
        words = ["pace", "evaluate", "sensitivity", scenario, "--episodes", str(episodes), "--seed", str(seed)]
        words += ["--worlds", str(worlds), *([] if only is None else ["--only", only])]
        words += [] if steps is None else ["--steps", str(steps)]
        words += set_words(overrides)
        write_report(out, result, shlex.join(words))
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)
