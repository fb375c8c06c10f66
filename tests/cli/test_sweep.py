"""pace sweep: interrupted, taken up again, failed cells, the table, and bad input: one line, exit code 2."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from pace_drake.learning.sweep import load_sweep
from pace_drake.learning.sweep_runner import SweepLog
from tests.cli.test_run import pace, refused

pytestmark = pytest.mark.skipif(
    not all(map(find_spec, ("ray", "pyarrow", "stable_baselines3"))),
    reason="extras 'train' and 'ray' are not installed",
)

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "sweep.yaml"


def test_the_example_makes_a_grid():
    tasks, failures = load_sweep(EXAMPLE).tasks()
    assert len({task.key for task in tasks}) == 8
    assert failures == []
    (first, *_, last) = (task.scenario for task in tasks)
    assert first.estimator["tighten_screws"].distance == "wp"
    assert last.estimator["tighten_screws"].distance == "euclidean"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The example with a cell that cannot be used, cut down to two short trainings."""
    content = yaml.safe_load(EXAMPLE.read_text()) | {
        "steps": 4096,
        "episodes": 50,
        "human_idle_weight": [3],
        "observation": ["none"],
    }
    content["estimators"]["broken"] = {"estimator.place_rails.distance": "manhattan"}
    path = tmp_path_factory.mktemp("sweep") / "small.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def session(pid):
    """The processes of a session that still run."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, of = status.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        found += [status.parent.name] * (state != "Z" and int(of) == pid)
    return found


@pytest.fixture(scope="module")
def interrupted(file):
    """Ctrl-C in the terminal, which reaches all processes, after the first row; then a crash while writing a row."""
    command = [sys.executable, "-m", "pace_drake.cli.main", "sweep", str(file), "--jobs", "1"]
    process = subprocess.Popen(
        command, cwd=file.parent, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    log = file.with_suffix(".jsonl")
    try:
        for _ in range(1200):
            if log.exists() and log.read_bytes().endswith(b"\n"):
                break
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.05)
        assert len(session(process.pid)) > 3  # Ray's
        os.killpg(process.pid, signal.SIGINT)
        _, error = process.communicate(timeout=30)
        for _ in range(200):
            if not (left := session(process.pid)):
                break
            time.sleep(0.05)
    finally:
        for pid in session(process.pid):
            os.kill(int(pid), signal.SIGKILL)
    return process.returncode, error, left, log.read_text()


def test_ctrl_c_keeps_what_is_finished_and_leaves_no_process(interrupted, file):
    from pyarrow import parquet

    code, error, left, log = interrupted
    assert code == 130
    rows = [json.loads(line)["row"] for line in log.splitlines()]
    assert len(rows) == 1
    assert error.strip() == "pace: interrupted; 1 of 2 rows are in small.jsonl; run the same command again to go on"
    assert left == []
    assert parquet.read_table(file.with_suffix(".parquet")).to_pylist() == rows


def test_ctrl_c_before_the_first_row(tmp_path, monkeypatch, capsys):
    from pace_drake.cli import sweep

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, "_run", interrupt)
    monkeypatch.chdir(tmp_path)
    example = Path(__file__).resolve().parents[2] / "examples" / "sweep.yaml"
    assert pace("sweep", example) == 130
    error = capsys.readouterr().err
    said = r"pace: interrupted; none of \d+ is finished; run the same command again to go on"
    assert re.fullmatch(said, error.strip())
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_row_goes_to_the_disk_keeps_it(tmp_path, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    path = tmp_path / "log.jsonl"
    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt), SweepLog(path) as log:
        log.append(SimpleNamespace(key="k"), {"seed": 0})
    assert [json.loads(line) for line in path.read_text().splitlines()] == [{"key": "k", "row": {"seed": 0}}]


@pytest.fixture(scope="module")
def finished(interrupted, file):
    """The same command again: its exit code, and the rows that were there before."""
    log = file.with_suffix(".jsonl")
    before = log.read_text()
    with log.open("a") as half:
        half.write(before[:100])
    here = Path.cwd()
    os.chdir(file.parent)
    try:
        yield pace("sweep", file), before
    finally:
        os.chdir(here)


def test_going_on_does_what_is_missing(finished, file):
    from pyarrow import parquet

    code, before = finished
    assert code == 1  # because of the broken cells
    log = file.with_suffix(".jsonl").read_text()
    assert log.startswith(before)
    assert len(log.splitlines()) == 2
    table = parquet.read_table(file.with_suffix(".parquet")).to_pylist()
    assert sorted(row["estimator"] for row in table) == ["euclidean", "wp"]
    assert all(row["human_idle_weight"] == 3 and row["steps"] == 4096 and row["episodes"] == 50 for row in table)
    # Without the phase in sight the estimator makes no difference: same seed, same episodes.
    assert table[0]["unseen_cost"] == table[1]["unseen_cost"]
    assert sorted(path.name for path in file.parent.iterdir()) == ["small.jsonl", "small.parquet", "small.yaml"]


def test_a_finished_sweep_is_not_run_again(finished, file, monkeypatch, capsys):
    def start(*_):
        raise AssertionError("Ray is not needed")

    monkeypatch.setattr("pace_drake.learning.sweep_runner.cluster", start)
    before = file.with_suffix(".jsonl").read_bytes()
    capsys.readouterr()
    assert pace("sweep", file) == 1
    printed = capsys.readouterr().out
    assert "3 tasks, 2 of them done before and skipped" in printed
    assert "failed: ikea_chair, estimator broken, observation none, lambda 3, seed 0: " in printed
    assert "must be wp, euclidean or sqeuclidean, is 'manhattan'" in printed
    assert "table: small.parquet, rows: small.jsonl" in printed
    rows = [json.loads(line)["row"] for line in before.splitlines()]
    for row in rows:
        assert f"{row['unseen_cost']:.2f}" in printed
        assert f"{row['validation_robot_idle_total']:.1f} / {row['validation_human_idle_total']:.1f}" in printed
    assert file.with_suffix(".jsonl").read_bytes() == before


def test_the_summary_is_of_means_over_seeds():
    from rich.console import Console

    from pace_drake.cli.sweep import _table
    from pace_drake.learning.sweep import ROW_UNITS

    rows = []
    for seed, cost in enumerate((10.0, 13.0)):
        row = dict.fromkeys(ROW_UNITS, 1.0) | {
            "scenario": "s[b]",
            "estimator": "e",
            "observation": "none",
            "seed": seed,
        }
        rows.append(row | {"validation_cost": cost, "unseen_cost": 2 * cost, "peak_memory": 700e6 + seed})
    console = Console(width=120, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    console.print(_table(rows))
    printed = console.export_text()
    assert f"11.50 ± {np.sqrt(4.5):.2f}" in printed
    assert f"23.00 ± {np.sqrt(18):.2f}" in printed
    for text in ("s[b]", "1.0 / 1.0", "700"):
        assert text in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{here}/none.yaml"], "none.yaml: cannot read the sweep"),
        (["{here}/bad.yaml"], "bad.yaml: colour: is no key of a sweep"),
        (["{here}/good.yaml", "--out", "{here}/t.csv"], "must end in .parquet"),
        (["{here}/good.yaml", "--out", "{here}/none/t.parquet"], "no such folder"),
        (["{here}/good.yaml", "--out", "{here}/taken.parquet"], "exists, and its rows (taken.jsonl) do not"),
        (["{here}/good.yaml", "--out", "{here}/t.parquet", "--jobs", "0"], "--jobs"),
        (["{here}/good.yaml", "--out", "{here}/t.parquet", "--address", "127.0.0.1:1"], "nobody answers there"),
        (["{here}/good.yaml", "--out", "{here}/t.parquet", "--address", "anywhere"], "cannot join the Ray cluster"),
    ],
)
def test_bad_arguments(tmp_path, capsys, arguments, message):
    (tmp_path / "bad.yaml").write_text("scenarios: [ikea_chair]\ncolour: red")
    (tmp_path / "good.yaml").write_text("scenarios: [ikea_chair]")
    (tmp_path / "taken.parquet").write_text("taken")
    assert message in refused(capsys, "sweep", *(argument.format(here=tmp_path) for argument in arguments))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "good.yaml", "taken.parquet"]
    assert (tmp_path / "taken.parquet").read_text() == "taken"


@pytest.mark.parametrize("name", ["ray", "pyarrow"])
def test_a_missing_package_is_named(tmp_path, capsys, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("pace_drake.learning.sweep.load_sweep", lambda _: pytest.fail("known too late"))
    error = refused(capsys, "sweep", EXAMPLE, "--out", tmp_path / "t.parquet")
    assert f"a sweep needs {name}: install it with pip install 'pace_drake[ray]'" in error
    assert list(tmp_path.iterdir()) == []
