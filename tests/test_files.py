"""pace_drake.files: whole files, and a cache that is always there."""

import os

import pytest

from pace_drake import files


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
