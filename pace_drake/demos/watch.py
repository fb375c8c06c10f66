"""Wrist motions of ten people in seven shoulder exercises, as the package ``seglearn`` 1.2.5 brings them.

Real recordings (Burns et al. 2018, arXiv:1802.01489; BSD licence): each person did each exercise 20 times in a
row with either arm, and wore a smartwatch that recorded accelerations and turning rates at 50 Hz.

The file is a pickle, and a pickle can run any program. So three things stand before it: only the file of that
one release is read, known by its SHA-256; its unpickler knows the four names that stand in the file and refuses
all others; and these four mean plain stand-ins of this module rather than functions of numpy. `seglearn` itself
is not imported.
"""

import hashlib
import io
import pickle
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pace_drake.errors import InputError

#: [s] between samples.
SAMPLE_PERIOD = 0.02
#: Of a recording's values: accelerations along three axes of the watch, then turning rates about them.
COLUMNS = ("ax", "ay", "az", "wx", "wy", "wz")

_FILE = "seglearn/data/watch_dataset.npy"
_SHA256 = "eb122f23cdf06ef6bd6c6c5312958ec5cf9d038e2e6d457b8081662c75a42537"
_SIDES = {0.0: "left", 1.0: "right"}


@dataclass(frozen=True, eq=False)
class WatchRecording:
    """One set of 20 repetitions.

    Attributes:
        exercise: PEN, ABD, FEL, IR, ER, TRAP or ROW.
        person: from 1 to 10.
        side: the arm with the watch, "left" or "right".
        values: (num_samples, 6) as recorded, of the `COLUMNS`; read-only. The source names no units: the
            accelerations of a resting wrist have a length near 1, so they are in multiples of gravity [g].
    """

    exercise: str
    person: int
    side: str
    values: NDArray


def read_watch() -> tuple[WatchRecording, ...]:
    """Reads all 140 recordings, sorted by exercise, person and side.

    Raises:
        InputError: the package with the recordings is not installed, or its file is not the known one.
    """
    path = _installed_file()
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}), run: pip install --force-reinstall --no-deps seglearn==1.2.5"
        ) from None
    # What is parsed below are the bytes that were checked here: the file could change in between.
    if hashlib.sha256(content).hexdigest() != _SHA256:
        raise InputError(
            f"{path}: is not the file of seglearn 1.2.5 (another SHA-256) and is not opened,"
            " run: pip install --force-reinstall --no-deps seglearn==1.2.5"
        )
    return _recordings(_unpickled(content))


def _installed_file() -> Path:
    try:
        return Path(str(distribution("seglearn").locate_file(_FILE)))
    except PackageNotFoundError:
        raise InputError("the watch recordings are not installed, run: pip install 'pace_drake[data]'") from None


def _recordings(data: dict[str, Any]) -> tuple[WatchRecording, ...]:
    recordings = [
        WatchRecording(data["y_labels"][exercise], int(person), _SIDES[side], array.values)
        for exercise, person, side, array in zip(
            data["y"].values, data["subject"].values, data["side"].values, data["X"], strict=True
        )
    ]
    return tuple(sorted(recordings, key=lambda r: (r.exercise, r.person, r.side)))


# --- the restricted unpickler ---


def _unpickled(content: bytes) -> dict[str, Any]:
    """Returns the dictionary in a .npy file of one object, with `_Array` in the place of numpy's arrays."""
    file = io.BytesIO(content)
    npy.read_magic(file)
    npy.read_array_header_1_0(file)
    return _Unpickler(file).load().values.item()


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str, /) -> Any:
        name = f"{module_name}.{global_name}"
        if name not in _STAND_INS:
            raise InputError(f"the watch recordings ask for {name!r}, which is not allowed: nothing was read")
        return _STAND_INS[name]


class _Array:
    """Stands for numpy.ndarray, and for the function that makes an empty one to be filled."""

    values: NDArray

    def __init__(self, *_: object) -> None:  # class, shape and type of the empty array: of no use here
        pass

    def __setstate__(self, state: tuple[int, tuple[int, ...], "_Dtype", bool, bytes | list[object]]) -> None:
        _, shape, dtype, column_major, data = state
        if isinstance(data, list):
            self.values = np.array(data, dtype=object).reshape(shape)
        else:  # a view of the bytes, hence read-only
            self.values = np.frombuffer(data, dtype.name).reshape(shape, order="F" if column_major else "C")


class _Dtype:
    """Stands for numpy.dtype."""

    def __init__(self, code: str, *_: object) -> None:
        self._code = code

    def __setstate__(self, state: tuple[object, ...]) -> None:
        self.name = f"{state[1]}{self._code}"
        if self.name not in ("<f8", "<i8", "|O8"):
            raise InputError(f"the watch recordings hold values of type {self.name!r}, which is not allowed")


def _encode(text: str, encoding: str) -> bytes:
    """Stands for _codecs.encode, which would look up any encoding by its name."""
    if encoding != "latin1":
        raise InputError(f"the watch recordings ask for the encoding {encoding!r}, which is not allowed")
    return text.encode("latin1")


_STAND_INS: dict[str, object] = {
    "numpy.core.multiarray._reconstruct": _Array,
    "numpy.ndarray": _Array,
    "numpy.dtype": _Dtype,
    "_codecs.encode": _encode,
}
