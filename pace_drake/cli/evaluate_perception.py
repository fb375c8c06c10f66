"""``pace evaluate perception``: how well cameras find the components."""

from pathlib import Path

import click

from pace_drake.cli.options import set_option
from pace_drake.cli.outputs import check_outputs, json_option, make_folder, out_option, write_json
from pace_drake.cli.tables import rich_table, wide_console


@click.command("perception", short_help="How well cameras find the components by their tags.")
@click.argument("scenario", default="ikea_chair")
@click.option("--poses", type=click.IntRange(min=1), default=100, show_default=True, help="Placements of everything.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of places, noise, plates.")
@set_option
@json_option
@out_option("errors.csv and a picture of each camera")
def perception(
    scenario: str, poses: int, seed: int, overrides: tuple[str, ...], json_file: Path | None, out: Path | None
) -> None:
    """Put the components of SCENARIO on their tables at random, render what the cameras see, find the tags, and compare
    with the truth: at the cameras' own heights, every fourth placement at others too; with pictures as rendered, with
    noise, and without depth; and with a plate over one component of each table. Needs OpenCV and OpenGL.

    Same command, same figures (but the wall times).
    """
    check_outputs(json_file, out)

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    from pace_drake.evaluate.perception import evaluate
    from pace_drake.evaluate.perception_report import tables, to_json, write_report
    from pace_drake.scenario import load_scenario

    workcell = load_scenario(scenario, overrides).workcell
    console = wide_console()
    columns = (SpinnerColumn(), TextColumn("placements"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        item = bar.add_task("", total=poses)
        result = evaluate(workcell, poses, seed, lambda: bar.advance(item))
    for table in tables(result):
        console.print(rich_table(table))
    figures = to_json(result)
    if figures["render_ms"] is not None:
        console.print(
            f"one look: rendering {figures['render_ms']:.0f} ms, finding {figures['detect_ms']:.0f} ms (medians here)",
            highlight=False,
        )
    if json_file is not None:
        write_json(json_file, figures)
    if out is not None:
        make_folder(out)
        write_report(out, result)
        console.print(f"report: {out}", markup=False, highlight=False, soft_wrap=True)
