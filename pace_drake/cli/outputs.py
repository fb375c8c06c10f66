"""Where a comparison is written to: figures as JSON, a folder with a report."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pace_drake.errors import InputError
from pace_drake.files import check_file, check_folder, write_whole

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
        InputError: the file or the folder cannot be written, or the folder is not empty.
    """
    if json_file is not None:
        check_file(json_file)
    if out is not None:
        check_new_folder(out)


def check_new_folder(out: Path) -> None:
    """Refuses a folder that holds something, or that cannot be made or written to.

    Raises:
        InputError: so it is.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists and is not empty; choose another --out, or remove it")
    check_folder(out)


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
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_whole(json_file, lambda part: part.write_text(text, encoding="utf-8"))
