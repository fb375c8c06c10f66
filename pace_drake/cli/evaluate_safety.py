"""``pace evaluate safety``: whether the robot keeps its distance from hands."""

import shlex
from pathlib import Path

import click

from pace_drake.cli.options import set_option, set_words
from pace_drake.cli.outputs import check_outputs, json_option, make_folder, out_option, write_json
from pace_drake.cli.tables import rich_table, wide_console


@click.command("safety", short_help="Speed and separation monitoring against random hand motions.")
@click.argument("scenario", default="ikea_chair")
@set_option
@click.option("--motions", type=click.IntRange(1), default=1000, show_default=True, help="Hand motions in each mode.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the hand motions.")
@json_option
@out_option("separation.png, index.html")
def safety(
    scenario: str, overrides: tuple[str, ...], motions: int, seed: int, json_file: Path | None, out: Path | None
) -> None:
    """Random hands reach for the moving robot; an independent check counts whether it ever closes in faster than
    allowed, once with strict monitoring (safety.contact_speed 0), once as the scenario says.

    Kinematic: RobotAction and SafetyMonitor as in the diagram, an arm that follows exactly.
    """
    check_outputs(json_file, out)

    from dataclasses import replace

    from rich.progress import Progress

    from pace_drake.evaluate.separation import SeparationBench, measure_separation, time_to_standstill
    from pace_drake.evaluate.separation_report import SeparationReport, tables, to_json, write_report
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    console = wide_console()
    if out is not None:
        make_folder(out)
    strict = replace(loaded, safety=replace(loaded.safety, contact_speed=0.0))
    with console.status("planning"):
        bench = SeparationBench(loaded)
        benches = {"strict": SeparationBench(strict, bench.motions), "scenario": bench}
    results = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("hand motions", total=len(benches) * motions)
        for name, each in benches.items():
            results.append(measure_separation(each, name, motions, seed, lambda: progress.advance(bar)))
    report = SeparationReport(loaded.name, results, time_to_standstill(bench, seed), loaded.safety.hand_timeout)
    for table in tables(report):
        console.print(rich_table(table))
    if json_file is not None:
        write_json(json_file, to_json(report))
    if out is not None:
        words = ["pace", "evaluate", "safety", scenario, "--motions", str(motions), "--seed", str(seed)]
        words += set_words(overrides)
        write_report(out, report, shlex.join(words))
        console.print(f"report: {out / 'index.html'}", markup=False, highlight=False, soft_wrap=True)
