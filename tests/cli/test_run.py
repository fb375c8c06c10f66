"""pace run: the run folder, repeatability, and bad input: one line, exit code 2, nothing half-written."""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pace_drake.cli.main import main
from pace_drake.evaluate.event_log import COLUMNS
from pace_drake.evaluate.timeline import read_events
from pace_drake.scenario import load_scenario
from tests.started import started

TASK = ["run", "--level", "task", "--policy", "phase_threshold"]


def pace(*arguments):
    """Runs the command in this process; returns its exit code."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


def refused(capsys, *arguments):
    """Runs a command that must be refused; returns the one line it wrote."""
    capsys.readouterr()
    assert pace(*arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("pace: ")
    assert error.count("\n") == 1
    assert "Traceback" not in error
    return error


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "run"
    assert pace(*TASK, "--episodes", 3, "--seed", 4, "--out", out) == 0
    return out


def test_the_run_folder_is_complete(run_folder):
    assert sorted(p.name for p in run_folder.iterdir()) == [
        "events.csv",
        "scenario.yaml",
        "summary.json",
        "timeline.png",
    ]
    assert (run_folder / "timeline.png").read_bytes().startswith(b"\x89PNG")
    assert load_scenario(str(run_folder / "scenario.yaml")).policy == "phase_threshold"


def test_the_summary(run_folder):
    summary = json.loads((run_folder / "summary.json").read_text())
    assert len(summary["episodes"]) == 3
    assert "SYNTHETIC" in summary["people"]
    for content in (*summary["episodes"], summary["mean"]):
        for agent in ("robot_idle", "human_idle"):
            assert list(content[agent]) == ["1", "2", "3", "total"]
            assert content[agent]["total"] == pytest.approx(sum(content[agent][k] for k in "123"))
        cost = content["robot_idle"]["total"] + 3 * content["human_idle"]["total"]
        assert content["cost"] == pytest.approx(cost)
        assert content["real_time_factor"] > 1
        assert content["decisions"] >= 3
    costs = [e["cost"] for e in summary["episodes"]]
    assert summary["mean"]["cost"] == pytest.approx(np.mean(costs))
    assert len(set(costs)) == 3


def test_the_events_agree_with_the_summary(run_folder):
    summary = json.loads((run_folder / "summary.json").read_text())
    for number, episode in enumerate(summary["episodes"]):
        events = read_events(run_folder / "events.csv", number)
        assert tuple(events[0]) == COLUMNS
        assert [e["name"] for e in events if e["kind"] == "episode"] == ["start", "finished"]
        for agent in ("robot_idle", "human_idle"):
            for joint in "123":
                intervals = [e for e in events if e["kind"] == agent and e["joint_action"] == joint]
                total = sum(float(e["duration"]) for e in intervals)
                assert total == pytest.approx(episode[agent][joint], abs=1e-9)
        decisions = [e for e in events if e["kind"] == "decision"]
        assert len(decisions) == episode["decisions"]
        reactions = [e["name"] for e in events if e["kind"] == "reaction"]
        assert reactions[0] == "t_start"
        assert reactions[-1] == "h_end"
        assert reactions.count("d_yes") == sum(e["assist"] == "1" for e in decisions) == 3
        times = [float(e["time"]) for e in events]
        assert times == sorted(times)


def test_same_seed_same_events_and_another_seed_others(run_folder, tmp_path):
    for seed, equal in ((4, True), (5, False)):
        out = tmp_path / str(seed)
        assert pace(*TASK, "--episodes", 3, "--seed", seed, "--out", out) == 0
        assert ((out / "events.csv").read_bytes() == (run_folder / "events.csv").read_bytes()) == equal


def test_the_timeline_can_be_drawn_again(run_folder, tmp_path, capsys):
    assert pace("timeline", run_folder, "--episode", 2, "-o", tmp_path / "again.png") == 0
    assert (tmp_path / "again.png").read_bytes().startswith(b"\x89PNG")
    assert "no episode 7" in refused(capsys, "timeline", run_folder, "--episode", 7)
    assert "not a run folder" in refused(capsys, "timeline", tmp_path)


@pytest.mark.parametrize("name", ["x.foo", "x", "x.PNGX"])
def test_a_timeline_ends_in_a_kind_of_picture(run_folder, tmp_path, capsys, name):
    path = tmp_path / name
    assert f"{path}: the name must end in .png, .svg or .pdf" in refused(capsys, "timeline", run_folder, "-o", path)


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"", b"\xff\xfe\x00", b"episode,time\n0,1\n"])
def test_events_of_another_program(content, tmp_path, run_folder, capsys):
    (tmp_path / "scenario.yaml").write_bytes((run_folder / "scenario.yaml").read_bytes())
    (tmp_path / "events.csv").write_bytes(content)
    error = refused(capsys, "timeline", tmp_path)
    assert f"{tmp_path / 'events.csv'}: was not written by pace run, it " in error


def test_a_folder_that_holds_something_is_never_overwritten(run_folder, capsys):
    before = {p.name: p.read_bytes() for p in run_folder.iterdir()}
    assert "exists and is not empty" in refused(capsys, *TASK, "--out", run_folder)
    assert before == {p.name: p.read_bytes() for p in run_folder.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "atlantis"], "unknown scenario 'atlantis'; known are ikea_chair"),
        (["run", "--set", "task.human_idel_weight=3"], "human_idel_weight"),
        (["run", "--set", "foo=1"], "cannot set 'foo': no such key 'foo'; known are name, "),
        (["run", "--set", "task.human_idel_weight=3"], "did you mean human_idle_weight?"),
        (["run", "--set", "task.human_actions.0.duration.meen=3"], "no such key 'meen'; did you mean mean?"),
        (["run", "--set", "estimator.place_rails.gama=3"], "no such key 'gama'; did you mean gamma?"),
        (["run", "--lambda", "0"], "lambda must be > 0"),
        (["run", "--lambda", "-1"], "lambda must be > 0"),
        (["run", "--lambda", "x"], "'x' is not a valid float"),
        (["run", "--policy", "oracle"], "unknown policy 'oracle'"),
        (["run", "--policy", "absent.onnx"], "absent.onnx: cannot read the policy"),
        (["run", "--level", "moon"], "'moon' is not one of"),
        (["run", "--seed", "-1"], "-1"),
        (["run", "--episodes", "0"], "0"),
        (["run", "--hand", "absent.npz"], "absent.npz"),
        (["run", "--chart", "absent.scxml"], "absent.scxml"),
        (["run", "--wrong"], "--wrong"),
        (["walk"], "No such command 'walk'"),
    ],
)
def test_bad_arguments(arguments, message, tmp_path, capsys):
    out = ["--out", tmp_path / "out"] if arguments[0] == "run" else []
    assert message in refused(capsys, *arguments, *out)
    assert not (tmp_path / "out").exists()


ROW = "{t},0.1,0.2,0.3\n"
GOOD = "".join(ROW.format(t=k / 10) for k in range(300))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nan.csv", "time,x,y,z\n" + GOOD + "30.0,nan,0,0\n", "NaN"),
        ("columns.csv", "time,x,y\n0,1,2\n0.1,1,2\n", "column"),
        ("short_row.csv", "time,x,y,z\n0,1,2,3\n0.1,1,2\n", "column"),
        ("empty.csv", "", "empty"),
        ("header.csv", "time,x,y,z\n", "empty|sample"),
        ("backwards.csv", "time,x,y,z\n" + GOOD + "29.0,0,0,0\n", "time"),
        ("text.csv", "time,x,y,z\n0,a,b,c\n0.1,1,2,3\n", "number"),
        ("broken.npz", "PK\x03\x04 this is not a zip", "cannot|not"),
        ("unknown.dat", "1 2 3", r"\.npz|\.csv"),
    ],
)
def test_bad_hand_files(name, content, message, tmp_path, capsys):
    import re

    path = tmp_path / name
    path.write_text(content)
    error = refused(capsys, *TASK, "--hand", path, "--out", tmp_path / "out")
    assert name in error
    assert re.search(message, error), error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("factor", [1000, 1e200])
def test_a_hand_in_other_units(factor, tmp_path, capsys):
    path = tmp_path / "hand.csv"
    path.write_text("time,x,y,z\n" + "".join(f"{k / 10},{0.1 * factor},{0.2 * factor},0\n" for k in range(50)))
    error = refused(capsys, *TASK, "--hand", path, "--out", tmp_path / "out")
    assert f"{path}: line 2 is farther than 10 m from the origin" in error
    assert not (tmp_path / "out").exists()


def test_an_npz_with_a_pickle_inside_is_refused(tmp_path, capsys):
    path = tmp_path / "pickle.npz"
    np.savez(path, x=np.array([{"a": 1}], dtype=object), length=[1], dt=0.1)
    assert "pickle.npz" in refused(capsys, *TASK, "--hand", path, "--out", tmp_path / "out")


def test_a_chart_with_an_unknown_guard_name(tmp_path, capsys):
    from pace_drake.resources import resource_path

    text = resource_path("statecharts/pace_task.scxml").read_text()
    path = tmp_path / "chart.scxml"
    path.write_text(text.replace('cond="hj == l"', 'cond="hand == l"'))
    error = refused(capsys, *TASK, "--chart", path, "--out", tmp_path / "out")
    line = next(k for k, row in enumerate(path.read_text().splitlines(), 1) if "hand ==" in row)
    assert f"{path}:{line}: guard of 'w_joint' uses the unknown name 'hand'" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "chart", ["examples/door.scxml", "statecharts/fig2_literal.scxml", "statecharts/query_latch.scxml"]
)
def test_a_chart_of_something_else_is_told_what_it_lacks(chart, tmp_path, capsys):
    path = Path(__file__).resolve().parents[2] / chart
    error = refused(capsys, *TASK, "--chart", path, "--out", tmp_path / "out")
    assert f"{path}: no chart of the collaboration, it lacks inputs " in error
    assert "joint_ready, robot_waiting, decision_index, variables i; begin with a copy of pace_task.scxml" in error
    assert not (tmp_path / "out").exists()


def test_a_recorded_hand(tmp_path, shared_data):
    out = tmp_path / "out"
    assert pace(*TASK, "--hand", shared_data / "hand" / "lego_task1.npz", "--out", out) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert "recorded hands" in summary["people"]
    assert "SYNTHETIC" not in summary["people"]
    assert 0 < summary["episodes"][0]["phase_rmse"] < 0.5


def test_a_single_recording_says_that_its_reference_is_synthetic(tmp_path):
    path = tmp_path / "one.csv"
    path.write_text("time,x,y,z\n" + "".join(f"{k / 30},{np.sin(k / 20)},{k / 900},0\n" for k in range(900)))
    out = tmp_path / "out"
    assert pace(*TASK, "--hand", path, "--out", out) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert "SYNTHETIC reference" in summary["people"]
    events = read_events(out / "events.csv")
    ends = [float(e["start"]) for e in events if e["kind"] == "human"]
    assert ends[1] - ends[0] == pytest.approx(899 / 30, abs=0.05)  # as long as recorded


def test_killed_half_way_the_events_so_far_can_be_read(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "pace_drake.cli.main", *TASK, "--episodes", "100000", "--out", str(out)]
    with started(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        for _ in range(600):
            if (out / "events.csv").exists() and (out / "events.csv").stat().st_size > 20_000:
                break
            time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    events = read_events(out / "events.csv")
    assert [e["name"] for e in events if e["kind"] == "episode"] == ["start", "finished"]
    with (out / "events.csv").open(newline="") as file:
        assert sum(1 for _ in csv.reader(file)) > 100
    assert load_scenario(str(out / "scenario.yaml")).name == "ikea_chair"
    assert not (out / "summary.json").exists()
    assert pace("timeline", out) == 0


def test_ctrl_c_says_so_and_keeps_the_folder(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "pace_drake.cli.main", *TASK, "--episodes", "100000", "--out", str(out)]
    with started(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        for _ in range(600):
            if (out / "events.csv").exists() and (out / "events.csv").stat().st_size > 20_000:
                break
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in error
    assert str(out) in error
    assert "Traceback" not in error
    assert read_events(out / "events.csv")
