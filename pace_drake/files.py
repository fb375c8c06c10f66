"""Writing files that are either whole or not there."""

import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import platformdirs


@cache
def cache_folder(name: str) -> Path:
    """A folder in the user's cache, for what can be made again; a temporary one where that cannot be written.

    ``XDG_CACHE_HOME`` moves it, as everywhere.
    """
    folder = platformdirs.user_cache_path("pace_drake") / name
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return Path(tempfile.mkdtemp(prefix=f"pace_drake-{name}-"))


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Lets ``write`` make a file beside its place, then renames it there.

    Args:
        path: where the file ends up; its suffix is kept, as some writers choose the format by it.
        write: called with the temporary path.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
