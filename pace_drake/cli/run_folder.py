"""The folder that a run leaves behind."""

from datetime import datetime
from pathlib import Path

from pace_drake.cli.outputs import check_new_folder


def choose_folder(out: Path | None, name: str) -> Path:
    """A folder that is not there yet, or is empty: ``out``, or runs/<time>-<name>.

    Raises:
        InputError: ``out`` is taken, or cannot be written.
    """
    if out is None:
        stem = Path("runs") / f"{datetime.now().strftime('%Y%m%d-%H%M%S')}-{name}"
        out, again = stem, 1
        while out.exists():
            out, again = stem.with_name(f"{stem.name}-{again}"), again + 1
    check_new_folder(out)
    return out
