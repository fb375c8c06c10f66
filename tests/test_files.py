"""pace_drake.files: whole files, and a cache that is always there."""

import os
from pathlib import Path

import pytest

from pace_drake import files
from pace_drake.errors import InputError


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    files.cache_folder.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield tmp_path
    files.cache_folder.cache_clear()


def test_the_cache_is_the_user_s(fresh):
    folder = files.cache_folder("things")
    assert folder == fresh / "cache" / "pace_drake" / "things"
    assert folder.is_dir()
    assert os.stat(folder).st_mode & 0o077 == 0  # nobody else writes what is run from there


def test_where_it_cannot_be_written_it_is_a_temporary_one(fresh):
    (fresh / "cache").write_text("a file stands where the folder should be")
    folder = files.cache_folder("things")
    assert folder.is_dir()
    assert fresh / "cache" not in folder.parents
    folder.rmdir()


def test_what_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    for path, reason in (("/proc/x.txt", "No such file or directory"), (tmp_path / "file" / "x", "Not a directory")):
        with pytest.raises(InputError, match=rf"{path}: cannot be written \({reason}\), check the folder"):
            files.write_whole(Path(path), lambda part: part.write_text("new"))


def test_a_place_is_tried_and_nothing_stays(tmp_path):
    (tmp_path / "file").write_text("old")
    files.check_file(tmp_path / "new")
    files.check_file(tmp_path / "file")
    files.check_folder(tmp_path)
    files.check_folder(tmp_path / "a" / "b")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("file", "old")]


@pytest.mark.parametrize(
    ("check", "path", "message"),
    [
        (files.check_file, "{here}/none/x", "{here}/none: no such folder for x; make it"),
        (files.check_file, "{here}", "{here}: is a folder; name a file"),
        (files.check_file, "/proc/x.txt", "/proc/x.txt: cannot be written"),
        (files.check_file, "{here}/" + "x" * 300, "cannot be written .File name too long"),
        (files.check_folder, "{here}/file", "{here}/file: is a file, no folder"),
        (files.check_folder, "{here}/file/a", "{here}/file: is a file, no folder"),
        (files.check_folder, "/proc/a/b", "/proc/a/b: cannot be written"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused(tmp_path, check, path, message):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=message.format(here=tmp_path)):
        check(Path(path.format(here=tmp_path)))


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("old")

    def write(part):
        part.write_text("half")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        files.write_whole(path, write)
    assert [p.name for p in tmp_path.iterdir()] == ["x.txt"]
    assert path.read_text() == "old"
