"""pace tune: the file it writes, Ctrl-C and going on, and bad input: one line, exit code 2, nothing half-written."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from pace_drake.demos import Demonstration, write_demonstrations
from pace_drake.dtw.estimator_file import read_estimator_file
from tests.cli.test_run import pace, refused


def recordings(folder, action, people=5, synthetic=True):
    """Writes short demonstrations of an action, one per person; of 5 people the last 2 are held out."""
    demonstrations = []
    for person in range(people):
        rng = np.random.default_rng([len(action), person])
        s = np.linspace(0.0, 1.0, 26 + 4 * person) ** (1.0 + 0.1 * person)
        path = np.column_stack([np.sin(15.0 * s), np.cos(len(action) * s), s])
        noisy = path + 0.03 * rng.normal(size=path.shape)
        demonstrations.append(Demonstration(action, f"P{person}", "T1", 0.1, noisy, synthetic=synthetic))
    write_demonstrations(folder / f"{action}.csv", demonstrations)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for action in ("lift", "screw_in"):
        recordings(folder, action)
    return folder


@pytest.fixture(scope="module")
def estimators(data):
    """What the command writes when nobody interrupts it."""
    out = data.parent / "whole" / "estimators.yaml"
    out.parent.mkdir(exist_ok=True)
    assert pace("tune", "--data", data, "--trials", 4, "--jobs", 1, "--out", out) == 0
    return out


def test_the_file_is_complete_and_the_journals_are_gone(estimators):
    assert [path.name for path in estimators.parent.iterdir()] == ["estimators.yaml"]
    read = read_estimator_file(estimators)
    assert read.description.startswith("SYNTHETIC")
    assert list(read.actions) == ["lift", "screw_in"]
    assert all(action.score["trials"] == 4 for action in read.actions.values())
    assert all(np.isfinite(action.fused(0.1).phase(np.zeros((3, 3)))).all() for action in read.actions.values())


def test_the_table_says_what_was_found(data, estimators, tmp_path, capsys):
    journal = tmp_path / "journal"
    out = tmp_path / "one.yaml"
    arguments = ("--data", data, "--trials", 2, "--jobs", 1, "--metric", "euclidean", "--stretch", "--journal", journal)
    assert pace("tune", *arguments, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "SYNTHETIC" in printed
    for action in read_estimator_file(out).actions.values():
        assert action.distance == "euclidean"
        for text in (action.reference_name.split("/")[1], f"{action.gamma:g}", f"{action.score['train_mse']:.4f}"):
            assert text in printed
    # A journal that was named is kept, and used: with it, the same command has nothing left to try.
    assert sorted(path.name for path in journal.iterdir()) == ["00-lift.jsonl", "01-screw_in.jsonl"]
    before = [path.read_bytes() for path in sorted(journal.iterdir())]
    again = tmp_path / "again.yaml"
    assert pace("tune", *arguments, "--out", again) == 0
    assert again.read_bytes() == out.read_bytes()
    assert [path.read_bytes() for path in sorted(journal.iterdir())] == before
    # It is of these data, this seed and these stretches alone.
    for change in (("--seed", 1), ("--no-stretch",)):
        other = refused(capsys, "tune", *arguments, *change, "--out", tmp_path / "other.yaml")
        assert "00-lift.jsonl: belongs to another search" in other
        assert not (tmp_path / "other.yaml").exists()


def test_ctrl_c_and_the_same_command_again(data, estimators, tmp_path):
    out = tmp_path / "estimators.yaml"
    arguments = ("tune", "--data", str(data), "--trials", "4", "--jobs", "2", "--out", str(out))
    process = subprocess.Popen(
        [sys.executable, "-m", "pace_drake.cli.main", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    journal = tmp_path / "estimators.yaml.journal"

    def num_trials():
        return sum(max(path.read_bytes().count(b"\n") - 1, 0) for path in journal.glob("*.jsonl"))

    deadline = time.monotonic() + 120
    while num_trials() < 2 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: all processes get it
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    message = f"pace: interrupted; the trials so far are in {journal}; run the same command again to go on"
    assert error.strip() == message  # click begins a new line after ^C
    assert not out.exists()
    assert 2 <= num_trials() < 8
    assert pace(*arguments) == 0
    assert out.read_bytes() == estimators.read_bytes()  # nor do two processes make a difference
    assert [path.name for path in tmp_path.iterdir()] == ["estimators.yaml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "{out}/estimators.txt"], "must end in .yaml"),
        (["--out", "{out}/none/estimators.yaml"], "no such folder"),
        (["--out", "{out}/taken.yaml"], "exists; choose another file, or remove it"),
        ([], "--out"),
        (["--out", "{out}/e.yaml", "--data", "{out}/none"], "no such folder"),
        (["--out", "{out}/e.yaml", "--data", "{out}"], "holds no .npz or .csv file"),
        (["--out", "{out}/e.yaml", "--trials", "0"], "--trials"),
        (["--out", "{out}/e.yaml", "--jobs", "0"], "--jobs"),
        (["--out", "{out}/e.yaml", "--metric", "manhattan"], "--metric"),
        (["--out", "{out}/e.yaml", "--journal", "{out}/taken.yaml"], "taken.yaml"),
    ],
)
def test_bad_arguments(tmp_path, capsys, arguments, message):
    (tmp_path / "taken.yaml").write_text("taken")
    assert message in refused(capsys, "tune", *(argument.format(out=tmp_path) for argument in arguments))
    assert [path.name for path in tmp_path.iterdir()] == ["taken.yaml"]
    assert (tmp_path / "taken.yaml").read_text() == "taken"


def test_too_few_recordings(tmp_path, capsys):
    recordings(tmp_path, "lift", people=3)  # one of them is held out
    error = refused(capsys, "tune", "--data", tmp_path, "--out", tmp_path / "e.yaml")
    assert "action 'lift': needs at least 3 training signals, got 2" in error
    assert [path.name for path in tmp_path.iterdir()] == ["lift.csv"]


def test_a_missing_package_is_named(data, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    error = refused(capsys, "tune", "--data", data, "--jobs", 1, "--out", tmp_path / "e.yaml")
    assert "tuning needs optuna: install it with pip install 'pace_drake[tune]'" in error
