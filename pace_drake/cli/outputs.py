"""Where a comparison is written to: figures as JSON, a folder with a report."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pace_drake.errors import InputError

json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write all figures to this file; an older one is replaced.",
)


def out_option(content: str) -> Callable:
    """The option for the folder of a report.

    Args:
        content: names what will be in it.
    """
    return click.option("--out", type=click.Path(path_type=Path), help=f"Folder for {content}.")


def check_outputs(json_file: Path | None, out: Path | None) -> None:
    """Refuses what cannot be written to, before anything is computed.

    Raises:
        InputError: no such folder for the file, or a folder that is not empty.
    """
    if json_file is not None and not json_file.parent.is_dir():
        raise InputError(f"{json_file.parent}: no such folder")
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is not empty; choose another --out, or remove it")


def make_folder(out: Path) -> None:
    """Makes the folder of a report or a run; last, so that bad input leaves nothing behind.

    Raises:
        InputError: it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot make the folder: {error.strerror}") from None


def write_json(json_file: Path, data: Any) -> None:
    """Writes figures whole; NaN is refused."""
    from pace_drake.files import write_whole

    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_whole(json_file, lambda part: part.write_text(text, encoding="utf-8"))
