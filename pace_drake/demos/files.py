"""Demonstration files: NPZ and CSV. Files are parsed, never executed: a pickle inside is refused.

NPZ holds the arrays

=============  ==================  ======================================================================
array          shape               meaning
=============  ==================  ======================================================================
``x``          (sum T, 3)          [units] positions of all demonstrations, one after the other
``length``     (num,)              T, samples of each demonstration
``dt``         ()                  [s] sample period
``subject``    (num,) text         who showed it; optional
``trial``      (num,) text         which trial; optional
``units``      () text             "m", "cm" or "mm"; optional, metres by default
``columns``    (3,) text           "x", "y", "z"; optional
``action``     (num,) or () text   the action; optional, the file's name by default
``synthetic``  (num,) or () bool   made by a generator; optional, false by default
=============  ==================  ======================================================================

CSV has the header ``time,x,y,z`` [s, m] and optionally the columns ``action``, ``subject``, ``trial`` and
``synthetic`` (0 or 1), in any order; rows that agree in them form one demonstration.
"""

import csv
import math
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pace_drake.demos.model import FARTHEST, Demonstration, interpolate
from pace_drake.errors import InputError
from pace_drake.files import write_whole

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_NUMBER_COLUMNS = ("time", "x", "y", "z")
_LABEL_COLUMNS = ("action", "subject", "trial", "synthetic")
_NO_SUBJECT, _NO_TRIAL = "unknown", "1"  # labels of a file that names none

# Times may stray this fraction of a period from a uniform grid before positions are interpolated.
_TIME_TOLERANCE = 1e-6
# More interpolated samples per recorded one than this is a broken time stamp rather than a pause.
_LARGEST_GROWTH = 100


def read_demonstrations(path: str | os.PathLike[str], *, require_positions: bool = True) -> list[Demonstration]:
    """Reads the demonstrations in an NPZ or CSV file, in the order in which they stand in it.

    CSV times that are not uniform are resampled by linear interpolation, at about their median period.

    Args:
        path: a file whose name ends in .npz or .csv.
        require_positions: refuse an NPZ whose units are not those of a length, such as accelerations, and a hand
            that is farther than ``FARTHEST`` from the origin; where False, such values are returned as they are.

    Returns:
        At least one demonstration.

    Raises:
        InputError: the file cannot be used; the message is one line that names it and says what to do.
    """
    path = Path(path)
    readers = {".npz": _read_npz, ".csv": _read_csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: is neither .npz nor .csv, convert it to one of them")
    if not path.exists():
        raise InputError(f"{path}: no such file, check the path")
    if not path.is_file():
        raise InputError(f"{path}: is not a file, name the .npz or .csv itself")
    try:
        return reader(path, require_positions)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}), check its permissions") from None


def write_demonstrations(path: str | os.PathLike[str], demonstrations: Sequence[Demonstration]) -> None:
    """Writes demonstrations to an NPZ or CSV file; an older file stays until the new one is whole.

    Args:
        path: a file name ending in .npz or .csv.
        demonstrations: at least one; for NPZ all of the same sample period.

    Raises:
        InputError: nothing was written; the message says why in one line.
    """
    path = Path(path)
    if path.suffix.lower() not in (".npz", ".csv"):
        raise InputError(f"{path}: is neither .npz nor .csv, choose one of them")
    if not demonstrations:
        raise InputError(f"{path}: there is no demonstration to write")
    periods = {d.sample_period for d in demonstrations}
    if path.suffix.lower() == ".csv":
        labels = [(d.action, d.subject, d.trial, d.synthetic) for d in demonstrations]
        if len(set(labels)) < len(labels):
            raise InputError(f"{path}: two demonstrations share action, subject and trial, rename one or write .npz")
        write_whole(path, lambda temporary: _write_csv(temporary, demonstrations))
    else:
        if len(periods) > 1:
            raise InputError(f"{path}: sample periods differ ({sorted(periods)} s), resample to one of them")
        write_whole(path, lambda temporary: _write_npz(temporary, demonstrations))


# --- NPZ ---


def _write_npz(path: Path, demonstrations: Sequence[Demonstration]) -> None:
    np.savez_compressed(
        path,
        x=np.concatenate([d.p_WH for d in demonstrations]),
        length=np.array([d.num_samples for d in demonstrations]),
        dt=np.array(demonstrations[0].sample_period),
        subject=np.array([d.subject for d in demonstrations]),
        trial=np.array([d.trial for d in demonstrations]),
        units=np.array("m"),
        columns=np.array(_NUMBER_COLUMNS[1:]),
        action=np.array([d.action for d in demonstrations]),
        synthetic=np.array([d.synthetic for d in demonstrations]),
    )


def _read_npz(path: Path, require_positions: bool) -> list[Demonstration]:
    arrays = _npz_arrays(path)
    missing = [name for name in ("x", "length", "dt") if name not in arrays]
    if missing:
        raise InputError(f"{path}: has no array {missing[0]!r}, it must hold x, length and dt")
    x = _numbers(path, arrays, "x")
    length = _numbers(path, arrays, "length")
    dt = _numbers(path, arrays, "dt")
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"{path}: x must have 3 columns (x, y, z), got shape {x.shape}")
    if len(x) == 0 or length.size == 0:
        raise InputError(f"{path}: is empty, it must hold at least one demonstration")
    if dt.size != 1 or not (np.isfinite(dt).all() and dt.item() > 0.0):
        raise InputError(f"{path}: dt must be one number of seconds > 0, got {_short(dt)}")
    if length.ndim != 1 or (length != np.floor(length)).any():
        raise InputError(f"{path}: length must be a list of whole numbers, got {_short(length)}")
    if (length < 2).any():
        short = int(np.argmax(length < 2))
        raise InputError(f"{path}: demonstration {short} has {length[short]:g} samples, each must have at least 2")
    if length.sum() != len(x):
        raise InputError(f"{path}: the lengths sum to {length.sum():g} but x has {len(x)} rows, one of them is wrong")
    if not np.isfinite(x).all():
        row = int(np.argmin(np.isfinite(x).all(axis=1)))
        raise InputError(f"{path}: x has NaN or inf in row {row} (from 0), interpolate or cut it")

    num = length.size
    units = _labels(path, arrays, "units", 1, "m")[0]
    if units not in _METRES and require_positions:
        raise InputError(f"{path}: units are {units!r}, positions must be in {', '.join(_METRES)}")
    actions = _labels(path, arrays, "action", num, path.stem)
    subjects = _labels(path, arrays, "subject", num, _NO_SUBJECT)
    trials = _labels(path, arrays, "trial", num, _NO_TRIAL if num == 1 else None)
    synthetic = _labels(path, arrays, "synthetic", num, "False")
    x = x * _METRES.get(units, 1.0)
    if units in _METRES and (far := _first_far(x)) is not None:
        raise InputError(
            f"{path}: row {far} (from 0) of x is farther than {FARTHEST:g} m from the origin, its units are {units}:"
            " correct it, or, if these are millimetres, set units to 'mm'"
        )
    paths = np.split(x, np.cumsum(length.astype(int))[:-1])
    try:
        return [
            Demonstration(actions[k], subjects[k], trials[k], dt.item(), paths[k], synthetic[k] == "True")
            for k in range(num)
        ]
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _npz_arrays(path: Path) -> dict[str, NDArray]:
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: is not an NPZ file (or a broken one), write it with numpy.savez")
    arrays: dict[str, NDArray] = {}
    name = ""
    try:
        with np.load(path, allow_pickle=False) as archive:
            for name in archive.files:
                arrays[name] = archive[name]
    except (ValueError, zipfile.BadZipFile, EOFError, KeyError, MemoryError, NotImplementedError) as error:
        if "allow_pickle" in str(error):
            raise InputError(
                f"{path}: array {name!r} is a pickle, which is never opened, save it as numbers or text"
            ) from None
        raise InputError(f"{path}: array {name!r} cannot be read, write the file again") from None
    return {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}


def _numbers(path: Path, arrays: dict[str, NDArray], name: str) -> NDArray:
    if arrays[name].dtype.kind not in "iuf":
        raise InputError(f"{path}: {name} must hold numbers, got {arrays[name].dtype}")
    return arrays[name].astype(np.float64)


def _labels(path: Path, arrays: dict[str, NDArray], name: str, num: int, default: str | None) -> list[str]:
    """Returns `num` texts: an array's, one text repeated, or the default (None: counted from 1)."""
    if name not in arrays:
        return [default] * num if default is not None else [str(k + 1) for k in range(num)]
    array = arrays[name]
    kinds = "b" if name == "synthetic" else "Uiu"
    if array.dtype.kind not in kinds or array.size not in (1, num):
        raise InputError(
            f"{path}: {name} must hold one {'truth value' if kinds == 'b' else 'text'} for each of the {num}"
            f" demonstrations, got {array.dtype} {array.shape}"
        )
    return [str(label) for label in np.broadcast_to(array.reshape(-1), (num,))]


def _first_far(positions: NDArray) -> int | None:
    """Returns the first row that no hand in the world can have, or None."""
    with np.errstate(over="ignore"):
        far = np.linalg.norm(positions, axis=1) > FARTHEST
    return int(np.argmax(far)) if far.any() else None


def _short(array: NDArray) -> str:
    return np.array2string(array, threshold=5, edgeitems=2).replace("\n", "")


# --- CSV ---


def _write_csv(path: Path, demonstrations: Sequence[Demonstration]) -> None:
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow((*_NUMBER_COLUMNS, *_LABEL_COLUMNS))
        for d in demonstrations:
            labels = (d.action, d.subject, d.trial, int(d.synthetic))
            for time, position in zip(d.times.tolist(), d.p_WH.tolist(), strict=True):
                writer.writerow((time, *position, *labels))


def _read_csv(path: Path, require_positions: bool) -> list[Demonstration]:
    # Rows of one demonstration: (line number, time, x, y, z).
    groups: dict[tuple[str, ...], list[tuple[float, ...]]] = {}
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, [])]
            _check_header(path, header)
            at = [header.index(name) for name in _NUMBER_COLUMNS]
            labels_at = [(header.index(name) if name in header else None) for name in _LABEL_COLUMNS]
            defaults = (path.stem, _NO_SUBJECT, _NO_TRIAL, "0")
            for row in reader:
                if not row:
                    continue
                line = reader.line_num
                if len(row) != len(header):
                    raise InputError(f"{path}: line {line} has {len(row)} columns, the header {len(header)}")
                labels = tuple(
                    default if column is None else row[column].strip()
                    for column, default in zip(labels_at, defaults, strict=True)
                )
                groups.setdefault(labels, []).append((line, *(_number(path, line, header[k], row[k]) for k in at)))
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path}: is not a CSV text file, write it as UTF-8 with the header time,x,y,z") from None
    if not groups:
        raise InputError(f"{path}: is empty, it must hold at least one demonstration below its header")
    return [_demonstration(path, labels, np.array(rows), require_positions) for labels, rows in groups.items()]


def _check_header(path: Path, header: list[str]) -> None:
    if not any(header):
        raise InputError(f"{path}: is empty, its first line must be the header time,x,y,z")
    missing = [name for name in _NUMBER_COLUMNS if name not in header]
    if missing:
        raise InputError(f"{path}: wrong columns: there is no {missing[0]!r}, line 1 must be the header time,x,y,z")
    for name in header:
        if name not in _NUMBER_COLUMNS + _LABEL_COLUMNS:
            raise InputError(
                f"{path}: wrong columns: {name!r} is unknown, beside time,x,y,z only"
                f" {','.join(_LABEL_COLUMNS)} may stand"
            )
        if header.count(name) > 1:
            raise InputError(f"{path}: wrong columns: {name!r} stands {header.count(name)} times, keep one")


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise InputError(f"{path}: line {line}, column {column}: {text!r} is not a number, correct it") from None
    if not math.isfinite(number):
        raise InputError(f"{path}: line {line}, column {column} is {number} (NaN or inf), interpolate or cut the row")
    return number


def _demonstration(path: Path, labels: tuple[str, ...], rows: NDArray, require_positions: bool) -> Demonstration:
    lines, times, positions = rows[:, 0].astype(int), rows[:, 1], rows[:, 2:]
    action, subject, trial, synthetic = labels
    if len(rows) < 2:
        raise InputError(f"{path}: line {lines[0]} stands alone, a demonstration must have at least 2 samples")
    steps = np.diff(times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0)) + 1
        raise InputError(
            f"{path}: time does not increase at line {lines[k]} ({times[k]:g} s after {times[k - 1]:g} s),"
            " sort the rows and remove repeated ones"
        )
    if synthetic not in ("0", "1"):
        raise InputError(f"{path}: line {lines[0]}: synthetic must be 0 or 1, got {synthetic!r}")
    if require_positions and (row := _first_far(positions)) is not None:
        raise InputError(
            f"{path}: line {lines[row]} is farther than {FARTHEST:g} m from the origin: correct it, or, if these are"
            " millimetres, divide them by 1000"
        )
    times = times - times[0]
    num_samples = len(times)
    period = times[-1] / (num_samples - 1)
    if np.abs(times - np.arange(num_samples) * period).max() > _TIME_TOLERANCE * period:
        num_samples = round(min(times[-1] / np.median(steps), 1e15)) + 1
        if num_samples > _LARGEST_GROWTH * len(times):
            k = int(np.argmax(steps)) + 1
            raise InputError(f"{path}: time jumps by {steps[k - 1]:g} s at line {lines[k]}, correct or cut it")
        period = times[-1] / (num_samples - 1)
        positions = interpolate(np.arange(num_samples) * period, times, positions)
    try:
        return Demonstration(action, subject, trial, period, positions, synthetic == "1")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
