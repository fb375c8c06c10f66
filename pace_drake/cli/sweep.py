"""``pace sweep``: a grid of trainings and evaluations, through Ray."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pace_drake.errors import InputError
from pace_drake.files import check_file

if TYPE_CHECKING:
    from rich.console import Console

    from pace_drake.learning.sweep import Failure, SweepTask
    from pace_drake.learning.sweep_runner import SweepLog


@click.command("sweep", short_help="Train and evaluate over a grid, on all cores or a Ray cluster.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Table of the results; default <FILE>.parquet here. The rows so far (.jsonl) are kept beside it.",
)
@click.option("--jobs", type=click.IntRange(min=1), help="Tasks at a time; default one for each core.")
@click.option("--address", help="Of a Ray cluster that runs (host:port, or auto); default this machine alone.")
def command(file: Path, out: Path | None, jobs: int | None, address: str | None) -> int:
    """Train and evaluate for every cell of the grid in FILE (examples/sweep.yaml): one row each, in a Parquet table.

    Ctrl-C or a crash loses the tasks that were running: the same command does only what is missing. The exit code is
    1 if tasks failed.
    """
    import sys
    from importlib.util import find_spec

    from rich.console import Console

    path = out or Path(f"{file.stem}.parquet")
    log_path = path.with_suffix(".jsonl")
    if path.suffix != ".parquet":
        raise InputError(f"{path}: a table of results must end in .parquet")
    check_file(path)
    if path.exists() and not log_path.exists():
        raise InputError(f"{path}: exists, and its rows ({log_path.name}) do not; choose another --out, or remove it")
    if find_spec("stable_baselines3") is None:
        raise InputError("a sweep trains: install what it needs with pip install 'pace_drake[train,ray]'")

    from pace_drake.learning.sweep_runner import SweepLog, import_ray

    import_ray(local=address is None)

    from pace_drake.learning.sweep import load_sweep

    sweep = load_sweep(file)
    tasks, failures = sweep.tasks()
    # Bound to today's stdout: it is turned away from Ray below.
    console = Console(file=sys.stdout)
    if not console.is_terminal:
        console = Console(file=sys.stdout, width=120)
    with SweepLog(log_path) as log:
        missing = [task for task in tasks if task.key not in log.rows]
        done_before = len(tasks) - len(missing)
        text = f"{len(tasks) + len(failures)} tasks, {done_before} of them done before and skipped"
        console.print(text, highlight=False)
        try:
            if missing:
                failures += _run(missing, log, console, (done_before, len(tasks)), jobs, address, sweep.retries)
        except KeyboardInterrupt:
            done = sum(task.key in log.rows for task in tasks)
            where = f"{done} of {len(tasks)} rows are in {log_path}" if done else f"none of {len(tasks)} is finished"
            raise KeyboardInterrupt(f"{where}; run the same command again to go on") from None
        finally:
            _write(path, tasks, log)
        rows = [log.rows[task.key] for task in tasks if task.key in log.rows]
    if rows:
        console.print(_table(rows))
        console.print(f"table: {path}, rows: {log_path}", markup=False, highlight=False, soft_wrap=True)
    for failure in failures:
        console.print(f"failed: {failure.cell}: {failure.reason}", markup=False, highlight=False, soft_wrap=True)
    return 1 if failures else 0


def _run(
    tasks: "Sequence[SweepTask]",
    log: "SweepLog",
    console: "Console",
    progress: tuple[int, int],
    jobs: int | None,
    address: str | None,
    retries: int,
) -> "list[Failure]":
    import io
    from contextlib import redirect_stdout

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from pace_drake.learning.sweep_runner import cluster, run_tasks

    columns = (
        TextColumn("sweep, tasks"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    # Ray prints a paragraph for every worker that dies, and cannot be told not to; the reason is in the report.
    with redirect_stdout(io.StringIO()), cluster(jobs, address), Progress(*columns, console=console) as bar:
        item = bar.add_task("", completed=progress[0], total=progress[1])

        def on_row(task: "SweepTask", row: dict[str, Any]) -> None:
            log.append(task, row)
            bar.update(item, advance=1, description=str(task.cell))

        return run_tasks(tasks, on_row, lambda _: bar.advance(item), jobs=jobs, retries=retries)


def _write(path: Path, tasks: "Sequence[SweepTask]", log: "SweepLog") -> None:
    from pace_drake.learning.sweep_runner import write_table

    rows = [log.rows[task.key] for task in tasks if task.key in log.rows]
    if rows:
        write_table(path, rows)


def _table(rows: Sequence[Mapping[str, Any]]) -> object:
    import numpy as np
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    title = "means over seeds, held-out people: seconds, cost ± standard deviation over seeds, robot / human idle"
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False, collapse_padding=True)
    for name in ("scenario", "estimator", "observation"):
        table.add_column(name)
    for name in (
        "lambda",
        "seeds",
        "validation\ncost",
        "\nidle",
        "unseen\ncost",
        "\nidle",
        "training",
        "memory\n\\[MB]",
    ):
        table.add_column(name, justify="right")
    axes = ("scenario", "estimator", "observation", "human_idle_weight")
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in axes), []).append(row)
    for (scenario, estimator, observation, weight), group in groups.items():
        cells = [f"{weight:g}", str(len(group))]
        for split in ("validation", "unseen"):
            costs = [row[f"{split}_cost"] for row in group]
            spread = f" ± {np.std(costs, ddof=1):.2f}" if len(costs) > 1 else ""
            robot, human = (np.mean([row[f"{split}_{who}_idle_total"] for row in group]) for who in ("robot", "human"))
            cells += [f"{np.mean(costs):.2f}{spread}", f"{robot:.1f} / {human:.1f}"]
        cells.append(f"{np.mean([row['training_time'] for row in group]):.0f}")
        cells.append(f"{max(row['peak_memory'] for row in group) / 1e6:.0f}")
        table.add_row(escape(scenario), escape(estimator), observation, *cells)
    return table
