"""pace view: the newest run or the one named, its figures and addresses, and one line where there is nothing."""

import os
import webbrowser

import pytest

from pace_drake.evaluate import screenshot
from tests.cli.test_run import pace, refused


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A working directory with two runs."""
    folder = tmp_path_factory.mktemp("work")
    for name, seed in (("newer", 4), ("older", 5)):
        out = folder / "runs" / name
        assert pace("run", "--level", "task", "--policy", "phase_threshold", "--seed", seed, "--out", out) == 0
    os.utime(folder / "runs" / "older" / "events.csv", (1e9, 1e9))
    return folder


@pytest.fixture
def opened(monkeypatch):
    """Addresses that were opened; nothing else happens."""
    found = []
    monkeypatch.setattr(webbrowser, "open", lambda address: bool(found.append(address)) or True)
    return found


def test_a_run_is_summed_up_and_opened(runs, opened, capsys):
    capsys.readouterr()
    assert pace("view", runs / "runs" / "older") == 0
    text = capsys.readouterr().out
    for expected in ("ikea_chair", "phase_threshold", "seed 5", "SYNTHETIC", "cost (lambda = 3)", "total"):
        assert expected in text
    for name in ("events.csv", "scenario.yaml", "summary.json", "timeline.png"):
        assert (runs / "runs" / "older" / name).as_uri() in text
    assert opened == [(runs / "runs" / "older" / "timeline.png").as_uri()]


def test_the_newest_run_is_the_default_and_a_replay_comes_first(runs, opened, capsys, monkeypatch):
    monkeypatch.chdir(runs)
    replay = runs / "runs" / "newer" / "replay.html"
    replay.write_text("<html></html>")
    capsys.readouterr()
    assert pace("view") == 0
    assert "seed 4" in capsys.readouterr().out
    assert opened == [replay.as_uri()]
    replay.unlink()


def test_no_open_opens_nothing(runs, opened, capsys, monkeypatch):
    monkeypatch.chdir(runs)
    capsys.readouterr()
    assert pace("view", "--no-open") == 0
    assert (runs / "runs" / "newer" / "timeline.png").as_uri() in capsys.readouterr().out
    assert opened == []


def test_a_run_that_was_killed_is_shown_as_far_as_it_is(runs, opened, capsys, tmp_path):
    (tmp_path / "events.csv").write_bytes((runs / "runs" / "newer" / "events.csv").read_bytes())
    capsys.readouterr()
    assert pace("view", tmp_path, "--no-open") == 0
    assert "no summary.json" in " ".join(capsys.readouterr().out.split())
    assert f"pace timeline {tmp_path}" in refused(capsys, "view", tmp_path)
    assert opened == []


def test_mistakes_give_one_line(runs, capsys, tmp_path, monkeypatch):
    run = runs / "runs" / "newer"
    monkeypatch.chdir(tmp_path)
    assert "holds no run" in refused(capsys, "view")
    assert "not a run folder, it has no events.csv" in refused(capsys, "view", tmp_path)
    assert "not a run folder" in refused(capsys, "view", "absent")
    assert "has no replay.html" in refused(capsys, "view", run, "--screenshot", "a.png")
    monkeypatch.setattr(webbrowser, "open", lambda _address: False)
    assert "found no browser" in refused(capsys, "view", run)
    (run / "replay.html").write_text("<html></html>")
    assert "must be a .png" in refused(capsys, "view", run, "--screenshot", "a.jpg")
    assert "absent: no such folder" in refused(capsys, "view", run, "--screenshot", "absent/a.png")
    for at in ("1e9", "nan", "inf"):
        assert "the episode of the replay goes from 0 to " in refused(
            capsys, "view", run, "--screenshot", "a.png", "--at", at
        )
    monkeypatch.setattr(screenshot, "find_chromium", lambda: None)
    assert "apt-get install chromium" in refused(capsys, "view", run, "--screenshot", "a.png")
    (run / "replay.html").unlink()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"mean": {}}', '{"mean": {"robot_idle": {"1": "x"}, "human_idle": {"1": 0}}}']
)
def test_a_damaged_summary(content, runs, capsys, tmp_path):
    (tmp_path / "events.csv").write_bytes((runs / "runs" / "newer" / "events.csv").read_bytes())
    (tmp_path / "summary.json").write_text(content)
    assert "not a summary that pace run wrote" in refused(capsys, "view", tmp_path)
