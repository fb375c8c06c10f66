"""``pace chart check``: proves what must hold of a chart, or shows the shortest way to where it does not."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.chart import chart_path, write_text
from pace_drake.errors import InputError
from pace_drake.files import check_file

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from pace_drake.statechart.check import Report, Verdict


@click.command()
@click.argument("file")
@click.option("--checks", type=click.Path(path_type=Path), help="Properties; default FILE with .checks.yaml.")
@click.option("--set", "overrides", multiple=True, metavar="NAME=VALUE", help="Override a parameter of the check.")
@click.option("--chart", "charts", multiple=True, metavar="COMPONENT=FILE", help="Take another chart for a component.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Also write the verdicts to this file.")
@click.pass_context
def command(
    ctx: click.Context,
    file: str,
    checks: Path | None,
    overrides: tuple[str, ...],
    charts: tuple[str, ...],
    json_file: Path | None,
) -> int:
    """Prove the properties of the statechart FILE (a .scxml file or the name of one that comes with the package).

    They are data beside the chart: FILE.checks.yaml names the charts of its surroundings and what must hold. A chart
    without one is checked for determinism and dead transitions. Exits with 0 if all hold, 1 if one does not, and 2 if a
    file cannot be read.
    """
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from pace_drake.statechart.check import check, check_chart, checks_path, load_spec
    from pace_drake.statechart.loader import load_chart

    path = chart_path(file)
    if json_file is not None:
        check_file(json_file)
    found = checks if checks is not None else checks_path(path)
    console = Console()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    errors = Console(stderr=True)
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as progress:
        progress.add_task(f"checking {path.name}")
        if checks is None and not found.is_file():
            if overrides or charts:
                raise InputError(f"{path}: no {found.name} beside it, so there is nothing to --set or --chart")
            report = check_chart(load_chart(path))
        else:
            given = {name: Path(value) for name, value in map(_pair, charts)}
            spec = load_spec(found, charts=given, parameters={n: _number(n, v) for n, v in map(_pair, overrides)})
            if not any(Path(part.compiled.chart.path).resolve() == path.resolve() for part in spec.components):
                names = ", ".join(part.name for part in spec.components)
                raise InputError(
                    f"{found} does not run {path}; name the one it stands for: --chart COMPONENT={path} ({names})"
                )
            report = check(spec)
    _show(console, report)
    if json_file is not None:
        data = {**asdict(report), "holds": report.holds}
        write_text(json_file, json.dumps(data, indent=1) + "\n")
    return 0 if report.holds else 1


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name or not value:
        raise InputError(f"{text!r}: write NAME=VALUE")
    return name, value


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"parameter {name} must be a number, not {text!r}") from None


def _show(console: "Console", report: "Report") -> None:
    from rich.markup import escape
    from rich.table import Table

    title = f"{report.path}: {report.states:,} states, {report.steps:,} steps"
    table = Table(title=escape(title), title_justify="left")
    table.add_column("property")
    table.add_column("verdict")
    table.add_column("examined", justify="right")
    table.add_column("seconds", justify="right")
    for verdict in report.verdicts:
        word = "[green]holds[/]" if verdict.holds else "[bold red]VIOLATED[/]"
        table.add_row(escape(verdict.name), word, f"{verdict.examined:,} {verdict.unit}", f"{verdict.seconds:.2f}")
    console.print(table)
    for verdict in report.verdicts:
        if verdict.holds:
            continue
        console.print(f"\n[bold]{escape(verdict.name)}[/]: {escape(verdict.text)}", highlight=False, soft_wrap=True)
        if verdict.rows:
            console.print(_counterexample(verdict))
        elif verdict.reachable:
            console.print("no state is like this")


def _counterexample(verdict: "Verdict") -> "Table":
    from rich.table import Table

    length = len(verdict.rows)
    title = f"shortest counterexample: {length} ticks"
    if verdict.loop is not None:
        title = f"counterexample: from tick {verdict.loop} on, round for ever"
    table = Table(title=title, title_justify="left", show_lines=True)
    components = list(verdict.rows[0].leaves)
    for name in ("tick", "free inputs", *components, "changed"):
        table.add_column(name)
    for row in verdict.rows:
        inputs = "\n".join(f"{name} = {value:g}" for name, value in row.inputs.items())
        cells = ["\n".join([*row.fired.get(c, ()), f"[bold]{row.leaves[c]}[/]"]) for c in components]
        changed = "\n".join(f"{name} = {value:g}" for name, value in row.changed.items())
        mark = f"{row.tick} ⟲" if row.tick == verdict.loop else str(row.tick)
        table.add_row(mark, inputs, *cells, changed)
    return table
