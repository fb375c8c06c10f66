import io
import os
import pickle
import sys

import numpy as np
import pytest

from pace_drake.demos import read_watch, watch
from pace_drake.errors import InputError

try:
    REAL_FILE = watch._installed_file()
except InputError:
    REAL_FILE = None
needs_seglearn = pytest.mark.skipif(REAL_FILE is None, reason="extra 'data' (seglearn) is not installed")


@pytest.fixture(scope="module")
def recordings():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "seglearn", None)  # any import of it would fail
        return read_watch()


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Makes a folder the only place where packages are found, and `install(content)` a seglearn in it."""
    monkeypatch.setattr(sys, "path", [str(tmp_path)])

    def install(content: bytes | None):
        (tmp_path / "seglearn-1.2.5.dist-info").mkdir()
        (tmp_path / "seglearn-1.2.5.dist-info" / "METADATA").write_text("Name: seglearn\nVersion: 1.2.5\n")
        file = tmp_path / "seglearn" / "data" / "watch_dataset.npy"
        file.parent.mkdir(parents=True)
        if content is not None:
            file.write_bytes(content)
        return file

    return install


def npy_of(pickled: bytes) -> bytes:
    """A .npy file of one object, with any pickle in it."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
    return file.getvalue() + pickled


def refused(message):
    return pytest.raises(InputError, match=message)


# --- the recordings ---


@needs_seglearn
def test_the_recordings_are_those_that_numpy_reads(recordings):
    data = np.load(REAL_FILE, allow_pickle=True).item()  # the fixture has checked the file
    assert tuple(data["X_labels"]) == watch.COLUMNS
    sides = {0: "left", 1: "right"}
    expected = {
        (data["y_labels"][y], subject, sides[side]): x
        for x, y, subject, side in zip(data["X"], data["y"], data["subject"], data["side"], strict=True)
    }
    keys = [(r.exercise, r.person, r.side) for r in recordings]
    assert keys == sorted(expected)
    assert len(keys) == 140
    for key, recording in zip(keys, recordings, strict=True):
        np.testing.assert_array_equal(recording.values, expected[key])
        assert not recording.values.flags.writeable


@needs_seglearn
def test_accelerations_are_in_multiples_of_gravity(recordings):
    lengths = [np.median(np.linalg.norm(r.values[:, :3], axis=1)) for r in recordings]
    assert np.median(lengths) == pytest.approx(1.0, abs=0.1)


# --- only the known file ---


def test_without_the_package_one_line_says_what_to_install(install):
    with refused(r"^the watch recordings are not installed, run: pip install 'pace_drake\[data\]'$"):
        read_watch()


@needs_seglearn
def test_a_changed_byte_is_refused(install):
    content = bytearray(REAL_FILE.read_bytes())
    content[len(content) // 2] ^= 1
    file = install(bytes(content))
    with refused("is not the file of seglearn 1.2.5") as error:
        read_watch()
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_named(install):
    file = install(None)
    with refused("cannot be read .No such file or directory., run: pip install") as error:
        read_watch()
    assert str(error.value).startswith(f"{file}: ")


def test_another_file_is_refused_before_it_is_parsed(install, monkeypatch):
    monkeypatch.setattr(watch, "_unpickled", lambda content: pytest.fail("it was parsed"))
    install(npy_of(pickle.dumps(Runs(print, "hello"))))
    with refused("another SHA-256"):
        read_watch()


# --- the unpickler, were it given another file ---


class Runs:
    """Calls a function with arguments when it is unpickled."""

    def __init__(self, function, *arguments):
        self.reduced = (function, arguments)

    def __reduce__(self):
        return self.reduced


def test_arrays_are_read_as_numpy_wrote_them():
    read = watch._unpickled(npy_of(OLD_NUMPY))
    np.testing.assert_array_equal(read["x"].values, [[1.0, 2.0], [3.0, 4.0]])
    with refused("ask for 'numpy._core.multiarray._reconstruct'"):  # the same from numpy 2: not in the known file
        watch._unpickled(npy_of(OLD_NUMPY.replace(b"numpy.core", b"numpy._core")))


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (os.mkdir, ("ran",)),
        (os.system, ("mkdir ran",)),
        (eval, ("__import__('os').mkdir('ran')",)),
        (exec, ("import os; os.mkdir('ran')",)),
        (getattr, (os, "mkdir")),
        (np.savetxt, ("ran", [1.0])),
        (np.load, ("ran",)),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_functions_are_refused_and_do_not_run(function, arguments, protocol, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if arguments[0] is os:
        arguments = (Runs(__import__, "os"), "mkdir")  # modules cannot be pickled
    content = npy_of(pickle.dumps(Runs(function, *arguments), protocol))
    with refused("which is not allowed: nothing was read"):
        watch._unpickled(content)
    assert not list(tmp_path.iterdir())


def test_the_same_pickle_does_run_where_nobody_refuses(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pickle.loads(pickle.dumps(Runs(os.mkdir, "ran")))
    assert (tmp_path / "ran").is_dir()


def test_what_hides_behind_an_allowed_name_is_refused():
    for name, stack in [
        (b"cnumpy\ndtype.__class__\n", b"."),  # protocol 0 has no dotted names, but find_class gets the text
        (b"cnumpy.core.multiarray\n_reconstruct.__globals__\n", b"."),
        (b"\x80\x04\x8c\x05numpy\x8c\x0edtype.__base__\x93", b"."),
        (b"\x80\x04\x8c\x07_codecs\x8c\x06lookup\x93", b"."),
        (b"cnumpy.core.multiarray\nfromfile\n", b"."),
    ]:
        with refused("which is not allowed: nothing was read"):
            watch._unpickled(npy_of(name + stack))
    with refused("ask for the encoding 'zlib_codec'"):
        watch._unpickled(npy_of(b"c_codecs\nencode\n(X\x01\x00\x00\x00aX\x0a\x00\x00\x00zlib_codectR."))
    for code in (b"f4", b"V8", b"M8"):  # a type that is not in the file
        with refused("hold values of type"):
            watch._unpickled(npy_of(OLD_NUMPY.replace(b"f8", code)))


def _old_numpy() -> bytes:
    """A pickle of np.array({"x": np.array([[1.0, 2.0], [3.0, 4.0]])}) as numpy 1 on Python 2 wrote it."""

    def text(string: str) -> bytes:
        return b"X" + len(string.encode()).to_bytes(4, "little") + string.encode()

    def array(shape: bytes, code: str, order: str, data: bytes) -> bytes:
        empty = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85c_codecs\nencode\n"
        empty += text("b") + text("latin1") + b"\x86R\x87R"
        dtype = b"cnumpy\ndtype\n" + text(code) + b"K\x00K\x01\x87R(K\x03" + text(order)
        return empty + b"(K\x01" + shape + dtype + b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89" + data + b"tb"

    numbers = np.array([1.0, 2.0, 3.0, 4.0]).tobytes().decode("latin1")
    inner = array(b"K\x02K\x02\x86", "f8", "<", b"c_codecs\nencode\n" + text(numbers) + text("latin1") + b"\x86R")
    return b"\x80\x02" + array(b")", "O8", "|", b"](}" + text("x") + inner + b"se") + b"."


OLD_NUMPY = _old_numpy()
