"""pace chart check | lower: output, files, exit codes."""

import json
import re

import pytest

from pace_drake.cli.main import main
from pace_drake.resources import resource_path
from tests.statechart.design_errors import DESIGN_ERRORS, mutated


def pace(*arguments):
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in ("chart", *arguments)])
    return stopped.value.code


def refused(capsys, *arguments):
    assert pace(*arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


def test_check_says_what_holds(capsys, tmp_path):
    out = tmp_path / "verdicts.json"
    assert pace("check", "pace_task", "--set", "M=2", "--set", "L=1", "--json", out) == 0
    text = capsys.readouterr().out
    report = json.loads(out.read_text())
    assert "VIOLATED" not in text
    assert f"{report['states']:,} states" in text
    assert report["holds"] is True
    assert {v["unit"] for v in report["verdicts"]} == {"states", "queries"}
    assert all(v["holds"] and v["seconds"] >= 0 and v["examined"] > 0 for v in report["verdicts"])


def test_check_shows_the_shortest_counterexample(capsys, tmp_path):
    error = DESIGN_ERRORS["resuming while the robot moves"]
    chart = mutated(tmp_path, error.changes)["task"]
    out = tmp_path / "verdicts.json"
    checks = resource_path("statecharts/pace_task.checks.yaml")
    assert pace("check", chart, "--checks", checks, "--chart", f"task={chart}", "--json", out) == 1
    text = capsys.readouterr().out
    assert f"shortest counterexample: {error.depth} ticks" in text
    verdict = next(v for v in json.loads(out.read_text())["verdicts"] if v["name"] == error.broken)
    fired = [name for row in verdict["rows"] for name in row["fired"].get("task", [])]
    assert fired[-3:] == ["t_stop", "s_reissue", "d_no"] or "s_reissue" in fired


def test_check_of_a_chart_without_properties(capsys, tmp_path):
    path = tmp_path / "alone.scxml"
    path.write_text(resource_path("statecharts/human.scxml").read_text())
    assert pace("check", path) == 0
    assert "deterministic" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", "absent"], "absent: no such chart; give a .scxml file or one of button, "),
        (["check", "pace_task", "--set", "M"], "'M': write NAME=VALUE"),
        (["check", "pace_task", "--set", "M=many"], "parameter M must be a number, not 'many'"),
        (["check", "pace_task", "--set", "Q=1"], "no parameter 'Q'; there are M, L"),
        (["check", "pace_task", "--chart", "boss=x.scxml"], "no component 'boss'; there are operator"),
        (["check", "pace_task", "--checks", "absent.yaml"], "cannot read the checks"),
        (["check", "human", "--set", "M=1"], "no human.checks.yaml beside it"),
        (["check", "pace_task", "--set", "M=2", "--set", "L=1", "--json", "absent/x.json"], "absent: no such folder"),
        (["lower", "pace_task", "-o", "x.txt"], "must end in .scxml or .yaml"),
        (["lower", "absent", "-o", "x.scxml"], "no such chart"),
    ],
)
def test_mistakes_give_one_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_check_that_does_not_run_the_chart_says_so(capsys, tmp_path):
    """Else a changed copy would seem proven."""
    path = tmp_path / "copy.scxml"
    path.write_text(resource_path("statecharts/pace_task.scxml").read_text())
    checks = resource_path("statecharts/pace_task.checks.yaml")
    assert f"--chart COMPONENT={path}" in refused(capsys, "check", path, "--checks", checks)
    small = ("--set", "M=1", "--set", "L=1")
    assert pace("check", path, "--checks", checks, "--chart", f"task={path}", *small) == 0


def test_lower_writes_what_is_shipped(tmp_path):
    out = tmp_path / "plain.scxml"
    assert pace("lower", "pace_task", "-o", out) == 0
    assert out.read_text() == resource_path("statecharts/plain/pace_task.scxml").read_text()


def test_lower_never_overwrites_the_chart(capsys, tmp_path):
    path = tmp_path / "chart.scxml"
    path.write_text(resource_path("statecharts/human.scxml").read_text())
    before = path.read_text()
    assert re.search("would overwrite the chart itself", refused(capsys, "lower", path, "-o", path))
    assert path.read_text() == before


@pytest.mark.parametrize("suffix", [".svg", ".png", ".mmd", ".dot"])
def test_draw(tmp_path, suffix):
    out = tmp_path / f"chart{suffix}"
    assert (
        pace(
            "draw", "pace_task", "-o", out, "--highlight", "DECIDE", *(["--layout", "rows"] if suffix == ".svg" else [])
        )
        == 0
    )
    data = out.read_bytes()
    assert {".svg": b"<svg", ".png": b"\x89PNG", ".mmd": b"stateDiagram", ".dot": b"digraph"}[suffix] in data[:200]
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["draw", "pace_task", "-o", "x.pdf"], "must end in .svg, .png, .mmd or .dot"),
        (["draw", "pace_task", "-o", "x.png", "--layout", "dot"], "--layout dot makes .svg"),
        (
            ["draw", "pace_task", "-o", "x.svg", "--highlight", "RUN"],
            "no leaf state 'RUN'; there are READY, ROBOT_TASK",
        ),
        (["draw", "pace_task", "-o", "absent/x.png"], "absent: no such folder"),
    ],
)
def test_mistakes_in_drawing_give_one_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []
