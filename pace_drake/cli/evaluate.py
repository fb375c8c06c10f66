"""``pace evaluate``: how good the parts are: phase estimators, policies, perception, safety, the workcell."""

import shlex
from pathlib import Path

import click

from pace_drake.cli.evaluate_perception import perception
from pace_drake.cli.evaluate_policy import policy
from pace_drake.cli.evaluate_safety import safety
from pace_drake.cli.evaluate_sensitivity import sensitivity
from pace_drake.cli.evaluate_workcell import workcell
from pace_drake.cli.outputs import check_outputs, json_option, make_folder, out_option, write_json
from pace_drake.cli.tables import rich_table
from pace_drake.cli.tune import data_option, jobs_option, run_with_progress, seed_option, trials_option


@click.group("evaluate", short_help="Compare phase estimators, or policies; measure perception, safety, workcell.")
def command() -> None:
    """Measure how good the parts are."""


@command.command("phase", short_help="Compare phase estimators, tuned on training signals, on held-out people.")
@data_option
@seed_option
@trials_option
@jobs_option
@json_option
@out_option("scores.csv, fig7.png, errors.png, index.html")
def phase(data: str, seed: int, trials: int, jobs: int, json_file: Path | None, out: Path | None) -> None:
    """Tune and fit phase estimators on training signals, and compare them on those and on what was held out.

    The truth is a linear phase. Remaining times in [s]; p50 and p99 are wall times of one update. Same command, same
    numbers (but the wall times), whatever --jobs.
    """
    from rich.console import Console

    check_outputs(json_file, out)

    from pace_drake.evaluate.phase import evaluate, fit_all, searches
    from pace_drake.evaluate.phase_report import tables, write_report
    from pace_drake.evaluate.tuning import load_signals

    signals = load_signals(data, seed)
    jobs_to_do = searches(signals, trials, seed)
    if out is not None:
        make_folder(out)
    console = Console()
    console.print(signals.description, markup=False, highlight=False, soft_wrap=True)
    try:
        fitted = fit_all(signals, run_with_progress(jobs_to_do, jobs, trials))
        with console.status("scoring"):
            evaluation = evaluate(signals, fitted)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("nothing was written") from None
    for table in tables(evaluation):
        console.print(rich_table(table))
    if json_file is not None:
        write_json(json_file, evaluation.mse())
    if out is not None:
        command_line = f"pace evaluate phase --data {shlex.quote(data)} --seed {seed} --trials {trials}"
        write_report(out, evaluation, command_line)
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)


command.add_command(perception)
command.add_command(policy)
command.add_command(safety)
command.add_command(sensitivity)
command.add_command(workcell)
