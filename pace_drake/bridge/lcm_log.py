"""LCM logs: written so that a killed process leaves every message so far, read one message after the other."""

import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from pace_drake.errors import InputError

#: Head of an event: sync word, number, time [us], lengths of channel and data (LCM's log format).
_HEAD = struct.Struct(">IqqII")
_SYNC = 0xEDA1DA01


class LoggedMessage(NamedTuple):
    """A message in a log."""

    time: float
    """[s since the Unix epoch] at which it was logged."""
    channel: str
    data: bytes


class LcmLog:
    """Appends messages to a file that ``lcm.EventLog``, ``lcm-logplayer`` and ``pace replay`` read.

    ``lcm.EventLog`` keeps the last 4 kB in memory, ten messages of status, which a kill would lose; this writes each
    message at once.

    Args:
        path: created; it must not exist.
        clock: wall clock [s since the Unix epoch].
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self._file = path.open("xb", buffering=0)
        self._clock, self._number = clock, 0

    def write(self, channel: str, data: bytes) -> None:
        """Appends a message."""
        name = channel.encode()
        head = _HEAD.pack(_SYNC, self._number, round(1e6 * self._clock()), len(name), len(data))
        self._file.write(head + name + data)
        self._number += 1

    def close(self) -> None:
        """Ends the log."""
        self._file.close()

    def __enter__(self) -> "LcmLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def log_file(path: Path) -> Path:
    """The log where a run folder of `pace bridge` is named; a file stays as it is."""
    return path / "lcm.log" if path.is_dir() else path


def read_log(path: Path) -> Iterator[LoggedMessage]:
    """The messages of a log, in the order in which they were logged.

    A log that ends in the middle of a message, as after a kill, ends before it.

    Raises:
        InputError: the file cannot be read, or is no LCM log.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot read the log: {error.strerror}") from error
    with file:
        size = path.stat().st_size
        first = True
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            sync, _, stamp, len_channel, len_data = _HEAD.unpack(head)
            if sync != _SYNC:
                what = "is no LCM log" if first else f"is damaged at byte {file.tell() - _HEAD.size}"
                raise InputError(f"{path}: {what}")
            first = False
            if file.tell() + len_channel + len_data > size:
                return
            channel = file.read(len_channel).decode(errors="replace")
            yield LoggedMessage(1e-6 * stamp, channel, file.read(len_data))
        if first and size:
            raise InputError(f"{path}: is no LCM log")
