import csv
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pace_drake.demos import Demonstration, read_demonstrations, write_demonstrations
from pace_drake.errors import InputError

LEGO = Path(__file__).parents[2] / "../shared/data/hand/lego_task1.npz"
WATCH = LEGO.with_name("watch_ABD.npz")
needs_shared_data = pytest.mark.skipif(not LEGO.exists(), reason="../shared/data is not beside this checkout")

RNG = np.random.default_rng(0)
DEMOS = [
    Demonstration("rails", "S1", "T1", 0.1, RNG.normal(size=(7, 3)), synthetic=True),
    Demonstration("rails", "S2, left-handed", "T1", 0.1, RNG.normal(size=(5, 3)), synthetic=False),
    Demonstration("screws", "S1", "T2", 0.1, RNG.normal(size=(2, 3)), synthetic=False),
]


def npz(path, **changes):
    """Writes a good NPZ of two demonstrations with some arrays changed, or left out where None."""
    arrays = {
        "x": np.arange(30.0).reshape(10, 3) / 10,
        "length": np.array([6, 4]),
        "dt": np.array(0.1),
        "subject": np.array(["H1", "H2"]),
        "trial": np.array(["a", "a"]),
        "units": np.array("m"),
        "columns": np.array(["x", "y", "z"]),
    }
    arrays |= changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def refused(path, message):
    """Asserts that reading ends in an InputError of one line that names the file."""
    with pytest.raises(InputError, match=message) as error:
        read_demonstrations(path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".CSV"])
def test_round_trip(tmp_path, suffix):
    path = tmp_path / f"demos{suffix}"
    write_demonstrations(path, DEMOS)
    read = read_demonstrations(path)
    assert len(read) == len(DEMOS)
    for a, b in zip(read, DEMOS, strict=True):
        assert (a.name, a.synthetic) == (b.name, b.synthetic)
        assert a.sample_period == pytest.approx(b.sample_period, rel=1e-14)
        np.testing.assert_array_equal(a.p_WH, b.p_WH)
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "demos.npz"
    write_demonstrations(path, DEMOS)
    before = path.read_bytes()

    def fail(temporary, **_):
        assert temporary.parent == tmp_path  # a rename within one file system is atomic
        temporary.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(InputError, match=r"cannot be written .No space left on device"):
        write_demonstrations(path, DEMOS[:1])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_writing_refuses_what_it_could_not_read_back(tmp_path):
    slow = Demonstration("rails", "S3", "T1", 0.2, np.zeros((2, 3)), synthetic=False)
    for name, demos, message in [
        ("demos.txt", DEMOS, "neither .npz nor .csv"),
        ("demos.npz", [], "no demonstration to write"),
        ("demos.npz", [*DEMOS, slow], "sample periods differ"),
        ("demos.csv", [*DEMOS, DEMOS[0]], "two demonstrations share action, subject and trial"),
        ("absent/demos.csv", DEMOS, "cannot be written"),
    ]:
        with pytest.raises(InputError, match=message):
            write_demonstrations(tmp_path / name, demos)
    assert not list(tmp_path.iterdir())


@needs_shared_data
def test_real_recording_is_read():
    demos = read_demonstrations(LEGO)
    assert [(d.action, d.subject, d.trial) for d in demos] == [
        ("lego_task1", person, trial) for person in ("H1", "H2") for trial in ("trial1", "trial2")
    ]
    assert [d.num_samples for d in demos] == [925, 1045, 1544, 855]
    assert demos[0].sample_period == pytest.approx(1 / 30)
    assert demos[0].resample(0.1).duration == pytest.approx(30.8)
    assert not any(d.synthetic for d in demos)


@needs_shared_data
def test_accelerations_are_not_taken_for_positions():
    refused(WATCH, "units are 'as recorded', positions must be in m, cm, mm")
    assert len(read_demonstrations(WATCH, require_positions=False)) == 7


# --- errors of any file ---


def test_file_that_is_not_there_or_no_file(tmp_path):
    refused(tmp_path / "absent.npz", "no such file")
    refused(tmp_path / "demos.mat", "neither .npz nor .csv")
    (tmp_path / "folder.csv").mkdir()
    refused(tmp_path / "folder.csv", "is not a file")


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_unreadable_file(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"demos{suffix}"
    write_demonstrations(path, DEMOS)

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    # Permissions don't bind root, who may run the tests.
    monkeypatch.setattr("builtins.open", refuse)
    monkeypatch.setattr("io.open", refuse)
    monkeypatch.setattr(zipfile, "is_zipfile", refuse)
    refused(path, "cannot be read .Permission denied., check its permissions")


# --- NPZ ---


def test_npz_without_the_optional_arrays(tmp_path):
    path = npz(tmp_path / "rails.npz", subject=None, trial=None, units=None, columns=None)
    first, second = read_demonstrations(path)
    assert (first.name, second.name) == ("rails/unknown/1", "rails/unknown/2")
    np.testing.assert_array_equal(second.p_WH, np.arange(18.0, 30.0).reshape(4, 3) / 10)


def test_npz_labels_and_units(tmp_path):
    path = npz(tmp_path / "a.npz", action=np.array("place_rails"), units=np.array("mm"), trial=np.array([3, 4]))
    first, second = read_demonstrations(path)
    assert (first.name, second.name) == ("place_rails/H1/3", "place_rails/H2/4")
    np.testing.assert_allclose(first.p_WH[1], [0.0003, 0.0004, 0.0005])


X = np.arange(30.0).reshape(10, 3) / 10


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": None}, "has no array 'x'"),
        ({"dt": None}, "has no array 'dt'"),
        ({"x": X[:, :2]}, r"x must have 3 columns \(x, y, z\), got shape \(10, 2\)"),
        ({"x": X.ravel()}, "x must have 3 columns"),
        ({"x": X.astype(str)}, "x must hold numbers"),
        ({"x": X[:0], "length": np.array([], int)}, "is empty"),
        ({"x": np.where(X == 1.3, np.nan, X)}, "x has NaN or inf in row 4"),
        ({"x": np.where(X == 2.9, -np.inf, X)}, "x has NaN or inf in row 9"),
        (
            {"x": 1000 * X},
            r"row 0 .from 0. of x is farther than 10 m from the origin, its units are m: .* units to 'mm'",
        ),
        ({"x": np.where(X == 2.9, 1e200, X)}, "row 9 .from 0. of x is farther than 10 m"),
        ({"x": 1e6 * X, "units": np.array("mm")}, "row 0 .from 0. of x is farther than 10 m .* its units are mm"),
        ({"length": np.array([6, 5])}, "the lengths sum to 11 but x has 10 rows"),
        ({"length": np.array([9, 1])}, "demonstration 1 has 1 samples, each must have at least 2"),
        ({"length": np.array([12, -2])}, "demonstration 1 has -2 samples"),
        ({"length": np.array([6.5, 3.5])}, "length must be a list of whole numbers"),
        ({"length": np.array([6.0, np.nan])}, "length must be a list of whole numbers"),
        ({"dt": np.array(0.0)}, "dt must be one number of seconds > 0"),
        ({"dt": np.array(np.nan)}, "dt must be one number of seconds > 0"),
        ({"dt": np.array(np.inf)}, "dt must be one number of seconds > 0"),
        ({"dt": np.array([0.1, 0.2])}, "dt must be one number of seconds > 0"),
        ({"dt": np.array("0.1")}, "dt must hold numbers"),
        ({"units": np.array("inch")}, "units are 'inch'"),
        ({"subject": np.array(["H1", "H2", "H3"])}, "subject must hold one text for each of the 2"),
        ({"trial": np.array([0.5, 1.5])}, "trial must hold one text"),
        ({"synthetic": np.array(["no", "no"])}, "synthetic must hold one truth value"),
        ({"subject": np.array(["H1", "H\n2"])}, "subject of a demonstration must be a printable"),
    ],
)
def test_bad_npz(tmp_path, changes, message):
    refused(npz(tmp_path / "demos.npz", **changes), message)


class Bomb:
    def __reduce__(self):
        return Path.touch, (Path(Bomb.path),)


@pytest.mark.parametrize("name", ["x", "subject", "columns", "other"])
def test_a_pickle_inside_is_refused_and_not_run(tmp_path, name):
    Bomb.path = str(tmp_path / "exploded")
    path = npz(tmp_path / "demos.npz", **{name: np.array([Bomb(), Bomb()], dtype=object)})
    refused(path, f"array '{name}' is a pickle, which is never opened")
    assert not Path(Bomb.path).exists()


def test_a_file_that_only_ends_in_npz(tmp_path):
    path = tmp_path / "demos.npz"
    for content in (b"", b"time,x,y,z\n", pickle.dumps({"x": 1}), b"PK\x03\x04 broken"):
        path.write_bytes(content)
        refused(path, "is not an NPZ file")


def test_a_damaged_npz(tmp_path):
    path = npz(tmp_path / "demos.npz")
    content = bytearray(path.read_bytes())
    at = content.index(b"\x93NUMPY")
    content[at + 130 : at + 140] = b"\xff" * 10  # the checksum of the member no longer agrees
    path.write_bytes(content)
    refused(path, "array 'x' cannot be read")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", b"no array")
    refused(path, "array 'x' cannot be read|has no array|is a pickle")


# --- CSV ---


def test_csv_without_labels(tmp_path):
    path = tmp_path / "rails.csv"
    path.write_text("\ufeffz,time,x,y\n.3,10.0,.1,.2\n.6,10.5,.4,.5\n\n.9,11.0,.7,.8\n", encoding="utf-8")
    (demo,) = read_demonstrations(path)
    assert (demo.name, demo.sample_period, demo.synthetic) == ("rails/unknown/1", 0.5, False)
    np.testing.assert_array_equal(demo.p_WH, np.arange(1.0, 10.0).reshape(3, 3) / 10)


def test_csv_rows_of_two_demonstrations_may_alternate(tmp_path):
    path = tmp_path / "rails.csv"
    path.write_text("subject,time,x,y,z\nA,0,1,0,0\nB,5,2,0,0\nA,1,3,0,0\nB,6,4,0,0\n")
    a, b = read_demonstrations(path)
    assert (a.subject, b.subject) == ("A", "B")
    np.testing.assert_array_equal(a.p_WH[:, 0], [1.0, 3.0])
    np.testing.assert_array_equal(b.p_WH[:, 0], [2.0, 4.0])


def test_csv_times_that_are_not_uniform_are_interpolated(tmp_path):
    path = tmp_path / "demo.csv"
    times = [0.0, 0.1, 0.2, 0.5, 0.6, 0.7, 0.81]
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([("time", "x", "y", "z"), *((t, 2 * t, -t, 1.0) for t in times)])
    (demo,) = read_demonstrations(path)
    assert demo.duration == pytest.approx(0.81)
    assert demo.num_samples == 9  # the median period is 0.1 s
    expected = np.stack([2 * demo.times, -demo.times, np.ones(9)], axis=1)
    np.testing.assert_allclose(demo.p_WH, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty, its first line must be the header time,x,y,z"),
        ("\n\n", "is empty"),
        ("time,x,y,z\n", "is empty, it must hold at least one demonstration"),
        ("0,1,2,3\n1,2,3,4\n", "wrong columns: there is no 'time', line 1 must be the header"),
        ("time,x,y\n0,1,2\n", "wrong columns: there is no 'z'"),
        ("time,x,y,z,w\n0,1,2,3,4\n", "wrong columns: 'w' is unknown"),
        ("time,x,y,z,x\n0,1,2,3,4\n", "wrong columns: 'x' stands 2 times"),
        ("time,x,y,z\n0,1,2,3\n1,2,3\n", "line 3 has 3 columns, the header 4"),
        ("time,x,y,z\n0,1,2,3\n1,2,3,4,5\n", "line 3 has 5 columns, the header 4"),
        ("time,x,y,z\n0,1,2,3\n1,2,,4\n", "line 3, column y: '' is not a number"),
        ("time,x,y,z\n0,1,2,3\n1,2,0x1,4\n", "line 3, column y: '0x1' is not a number"),
        ("time,x,y,z\n0,1,2,3\n1,nan,3,4\n", r"line 3, column x is nan \(NaN or inf\)"),
        ("time,x,y,z\n0,1,2,3\ninf,2,3,4\n", "line 3, column time is inf"),
        ("time,x,y,z\n0,1,2,3\n", "line 2 stands alone, a demonstration must have at least 2 samples"),
        ("time,x,y,z\n0,1,2,3\n1,1,2,3\n1,1,2,3\n", r"time does not increase at line 4 \(1 s after 1 s\)"),
        ("time,x,y,z\n0,1,2,3\n2,1,2,3\n1,1,2,3\n", r"time does not increase at line 4 \(1 s after 2 s\)"),
        ("time,x,y,z\n0,1,2,3\n1,1,2,3\n2,1,2,3\n1e6,1,2,3\n", "time jumps by 999998 s at line 5"),
        ("time,x,y,z\n0,1,2,3\n1,1,2,3e3\n", "line 3 is farther than 10 m from the origin: .* divide them by 1000"),
        ("time,x,y,z\n0,1,2,3\n1,-1e200,2,3\n", "line 3 is farther than 10 m"),
        ("time,x,y,z,synthetic\n0,1,2,3,yes\n1,1,2,3,yes\n", "synthetic must be 0 or 1, got 'yes'"),
        ("time,x,y,z,action\n0,1,2,3,\n1,1,2,3,\n", "action of a demonstration must be a printable"),
    ],
)
def test_bad_csv(tmp_path, text, message):
    path = tmp_path / "demo.csv"
    path.write_text(text)
    refused(path, message)


def test_a_file_that_only_ends_in_csv(tmp_path):
    path = npz(tmp_path / "demos.npz").rename(tmp_path / "demos.csv")
    refused(path, "is not a CSV text file|wrong columns")
    path.write_bytes(b"time,x,y,z\n0,1,2,\xff\xfe\n")
    refused(path, "is not a CSV text file")
    path.write_bytes(b"time,x,y,z\n0,1,2," + b"9" * 200_000 + b"\n")
    refused(path, "is not a CSV text file")


def test_message_names_the_whole_path(tmp_path):
    path = tmp_path / "absent.csv"
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_demonstrations(str(path))
