"""``pace view``: a run folder, in the browser."""

import json
from pathlib import Path

import click

from pace_drake.cli.tables import idle_table
from pace_drake.errors import InputError
from pace_drake.files import check_file

#: What can be opened, the best first.
_SHOWN = ("replay.html", "timeline.png")


@click.command("view", short_help="Show a run folder: its figures, and its replay in the browser.")
@click.argument("run", required=False, type=click.Path(path_type=Path))
@click.option("--no-open", is_flag=True, help="Only print the addresses; open no browser.")
@click.option(
    "--screenshot", type=click.Path(path_type=Path, dir_okay=False), help="Write a PNG of the replay instead."
)
@click.option(
    "--at",
    type=click.FloatRange(min=0),
    default=0.0,
    show_default=True,
    help="Simulated time of the screenshot [s].",
)
def command(run: Path | None, no_open: bool, screenshot: Path | None, at: float) -> None:
    """Show the run folder RUN; by default the newest in runs/.

    Prints its figures and the addresses of its files, and opens replay.html, or else timeline.png, in the browser; no
    server is needed. A screenshot needs Chromium, and no display.
    """
    from rich.console import Console

    folder = run if run is not None else _newest(Path("runs"))
    if not (folder / "events.csv").is_file():
        raise InputError(f"{folder}: not a run folder, it has no events.csv")
    if screenshot is not None:
        _take(folder / "replay.html", screenshot, at)
        return
    console = Console()
    _print_summary(console, folder)
    for path in sorted(folder.iterdir()):
        console.print(path.resolve().as_uri(), highlight=False, soft_wrap=True, markup=False)
    if not no_open:
        _open(folder)


def _newest(runs: Path) -> Path:
    logs = sorted(runs.glob("*/events.csv"), key=lambda path: path.stat().st_mtime)
    if not logs:
        raise InputError(f"{runs}/ here holds no run; name a run folder, or make one with pace run")
    return logs[-1].parent


def _take(page: Path, screenshot: Path, at: float) -> None:
    from pace_drake.evaluate.screenshot import screenshot as take
    from pace_drake.evaluate.timeline import read_events

    if not page.is_file():
        raise InputError(f"{page.parent}: has no replay.html; only pace run --level plant writes one")
    if screenshot.suffix != ".png":
        raise InputError(f"{screenshot}: must be a .png")
    check_file(screenshot)
    # It shows the first episode.
    end = max((float(row["time"]) for row in read_events(page.with_name("events.csv"))), default=0.0)
    if not 0.0 <= at <= end:
        raise InputError(f"--at {at:g}: the episode of the replay goes from 0 to {end:.1f} s")
    take(page, screenshot, at)
    click.echo(screenshot)


def _print_summary(console, folder: Path) -> None:
    from rich.markup import escape

    path = folder / "summary.json"
    if not path.is_file():
        console.print(f"{escape(str(folder))}: no summary.json; the run has not ended, or was interrupted")
        return
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        mean = summary["mean"]
        table = idle_table(mean, {}, rf"mean idle time \[s], {folder.name}")
        console.print(
            f"[bold]{escape(summary['scenario'])}[/bold], policy {escape(summary['policy'])}, "
            f"{summary['level']} level, seed {summary['seed']}, {len(summary['episodes'])} episodes: "
            f"{escape(summary['people'])}",
            highlight=False,
        )
        console.print(table)
        truncated = sum(not episode["finished"] for episode in summary["episodes"])
        console.print(
            f"cost (lambda = {summary['human_idle_weight']:g}): [bold]{mean['cost']:.2f} s[/bold]; "
            f"{mean['decisions']:.1f} decisions; {mean['duration']:.1f} s simulated"
            + (f"; {truncated} episodes truncated" if truncated else ""),
            highlight=False,
        )
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: not a summary that pace run wrote ({type(error).__name__}: {error})") from error


def _open(folder: Path) -> None:
    import webbrowser

    shown = next((folder / name for name in _SHOWN if (folder / name).is_file()), None)
    if shown is None:
        raise InputError(f"{folder}: has nothing to open; pace timeline {folder} draws what there is")
    if not webbrowser.open(shown.resolve().as_uri()):
        raise InputError(f"found no browser to open {shown} in; open it yourself, or use --no-open")
