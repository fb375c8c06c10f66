"""Writing files that are either whole or not there."""

import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import platformdirs

from pace_drake.errors import InputError


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

    Raises:
        InputError: it cannot be written there.
    """
    temporary = _beside(path)
    try:
        try:
            write(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from error


def check_file(path: Path) -> None:
    """Refuses a place that ``write_whole`` could not write to; called before the work, it leaves nothing behind.

    Raises:
        InputError: no such folder, a folder of that name, or no file can be made there.
    """
    temporary = _beside(path)
    try:
        if not path.parent.is_dir():
            raise InputError(f"{path.parent}: no such folder for {path.name}; make it, or choose another")
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name a file")
        try:
            temporary.touch()
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from error


def check_folder(path: Path) -> None:
    """Refuses a folder that cannot be made, or written to if it is there; leaves nothing behind.

    Raises:
        InputError: a file of that name, or no file can be made in what is there of the path.
    """
    try:
        existing = next(one for one in (path, *path.absolute().parents) if one.exists())
        if not existing.is_dir():
            raise InputError(f"{existing}: is a file, no folder; choose another")
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise _unwritable(path, error) from error


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error}), check the folder and its permissions")
