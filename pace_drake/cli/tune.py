"""``pace tune``: tunes phase estimators on demonstrations, and writes them to a file."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.errors import InputError
from pace_drake.files import check_file, check_folder

if TYPE_CHECKING:
    from pace_drake.demos.signals import SignalSet
    from pace_drake.dtw.tune import Tuned
    from pace_drake.evaluate.tuning import Job

#: Shared with ``pace evaluate phase``.
data_option = click.option(
    "--data",
    default="synthetic",
    show_default=True,
    metavar="synthetic|watch|FOLDER",
    help="Generated hands, real wrists in 7 exercises (needs pace_drake[data]), or a folder of .npz and .csv files.",
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the search, and of the synthetic people.",
)
trials_option = click.option(
    "--trials", type=click.IntRange(min=1), default=60, show_default=True, help="Settings to try in each search."
)
jobs_option = click.option(
    "--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="Searches at a time, each in a process."
)


@click.command("tune", short_help="Tune phase estimators on demonstrations.")
@data_option
@seed_option
@trials_option
@click.option(
    "--metric",
    type=click.Choice(["wp", "euclidean", "both"]),
    default="both",
    show_default=True,
    help="Windowed-Pearson, Euclidean, or the better one for each action.",
)
@click.option(
    "--stretch/--no-stretch",
    default=False,
    show_default=True,
    help="Also score each demonstration played in 0.75 and 1.3 of its time; takes 3 times as long.",
)
@jobs_option
@click.option(
    "--journal",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the trials so far, kept in the end; default one beside FILE, removed in the end.",
)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="Estimator file (.yaml).")
def command(
    data: str, seed: int, trials: int, metric: str, stretch: bool, jobs: int, journal: Path | None, out: Path
) -> None:
    """Tune reference, metric, smoothing and window of each action's phase estimator, and write them to a file.

    Only training signals are used. Ctrl-C loses nothing: the same command goes on where it was. Same command, same
    file, whatever --jobs.
    """
    from rich.console import Console

    if out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{out}: an estimator file must end in .yaml")
    if out.exists():
        raise InputError(f"{out}: exists; choose another file, or remove it")
    check_file(out)
    folder = journal or out.with_name(f"{out.name}.journal")
    check_folder(folder)

    from pace_drake.dtw.estimator_file import write_estimator_file
    from pace_drake.dtw.tune import EU, STRETCHES, WP
    from pace_drake.evaluate.tuning import Job, estimator_file, load_signals

    signals = load_signals(data, seed)
    actions = signals.actions
    metrics = {"wp": (WP,), "euclidean": (EU,), "both": (WP, EU)}[metric]
    stretches = STRETCHES if stretch else (1.0,)
    # Numbered, as two names may be equal in the characters that a file's name can have.
    journals = [folder / f"{k:02d}-{re.sub('[^A-Za-z0-9_]+', '-', one.action)}.jsonl" for k, one in enumerate(actions)]
    searches = [
        Job(action, metrics, trials, seed, stretches, file) for action, file in zip(actions, journals, strict=True)
    ]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot make the folder for the trials: {error.strerror}") from None
    console = Console()
    console.print(signals.description, markup=False, highlight=False, soft_wrap=True)
    try:
        tuned = run_with_progress(searches, jobs, trials)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the trials so far are in {folder}; run the same command again to go on") from None
    write_estimator_file(out, estimator_file(signals, tuned))
    if journal is None:
        for file in journals:
            file.unlink()
        folder.rmdir()
    console.print(_table(signals, tuned, stretches))
    console.print(f"estimators: {out}", markup=False, highlight=False, soft_wrap=True)


def run_with_progress(searches: "Sequence[Job]", jobs: int, trials: int) -> "list[Tuned]":
    """Runs searches with a progress bar for each action."""
    from collections import Counter

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from pace_drake.dtw.tune import OE
    from pace_drake.evaluate.tuning import run_jobs

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("best MSE {task.fields[best]:.4f}"),
        TimeElapsedColumn(),
    )
    totals = Counter(search.signals.action for search in searches if search.metrics != (OE,))
    with Progress(*columns) as bars:
        items = {name: bars.add_task(name, total=trials * num, best=math.nan) for name, num in totals.items()}
        progress = dict.fromkeys(range(len(searches)), (0, math.inf))

        def show(number: int, done: int, best: float) -> None:
            progress[number] = (done, best)
            action = searches[number].signals.action
            so_far = [progress[k] for k, search in enumerate(searches) if search.signals.action == action]
            completed, best = sum(done for done, _ in so_far), min(best for _, best in so_far)
            bars.update(items[action], completed=completed, best=best)

        return run_jobs(searches, jobs, show)


def _table(signals: "SignalSet", tuned: "Sequence[Tuned]", stretches: Sequence[float]) -> object:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from pace_drake.evaluate.tuning import left_out_time_score

    title = f"{'SYNTHETIC data: ' * signals.synthetic}mean squared errors of the phase, on training signals"
    caption = "left out: on each person, tuned without them; time only: likewise, from the others' mean duration"
    table = Table(box=box.SIMPLE_HEAD, title=title, caption=caption, pad_edge=False, collapse_padding=True)
    for name in ("action", "reference", "metric"):
        table.add_column(name)
    for name in ("gamma", "window\n\\[s]", "train", "left\nout", "time\nonly"):
        table.add_column(name, justify="right")
    for action, one in zip(signals.actions, tuned, strict=True):
        setting, reference = one.setting, action.train[one.setting.reference]
        table.add_row(
            escape(action.action),
            escape(f"{reference.subject}, {reference.trial}"),
            setting.distance,
            f"{setting.gamma:g}",
            f"{setting.window:g}" if setting.distance == "wp" else "-",
            *(
                "-" if math.isnan(score) else f"{score:.4f}"
                for score in (one.score, one.left_out_score, left_out_time_score(action, stretches))
            ),
        )
    return table
