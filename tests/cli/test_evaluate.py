"""pace evaluate phase: tables, JSON, the report folder, repeatability, and bad input."""

import json

import pytest

from pace_drake.evaluate.phase import ESTIMATORS, PARTS
from tests.cli.test_run import pace, refused
from tests.cli.test_tune import recordings


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    recordings(folder, "lift")
    return folder


def test_a_whole_evaluation(data, tmp_path, capsys):
    out, file = tmp_path / "report", tmp_path / "mse.json"
    arguments = ("evaluate", "phase", "--data", data, "--trials", 2, "--json", file)
    assert pace(*arguments, "--jobs", 1, "--out", out) == 0
    printed = capsys.readouterr().out
    table = json.loads(file.read_text())
    assert list(table) == ["lift", "mean"]
    for of_action in table.values():
        assert tuple(of_action) == ESTIMATORS
        for parts in of_action.values():
            assert tuple(parts) == PARTS
            assert isinstance(parts["train"], float)
            assert isinstance(parts["heldout_people"], float)
            assert parts["heldout_trials"] is None
    # Printed in 80 columns with nothing cut off.
    for name, parts in table["mean"].items():
        assert f"{name} " in printed
        assert f"{parts['heldout_people']:.4f}" in printed
    assert "…" not in printed
    for text in ("SYNTHETIC", "not comparable", str(out / "index.html")):
        assert text in printed.replace("\n", "")
    assert sorted(path.name for path in out.iterdir()) == ["errors.png", "fig7.png", "index.html", "scores.csv"]
    assert f"--data {data} --seed 0 --trials 2" in (out / "index.html").read_text()

    # Again, in two processes: the same numbers. A folder that holds something is never overwritten.
    before = file.read_bytes()
    assert "exists and is not empty" in refused(capsys, *arguments, "--out", out)
    file.unlink()
    assert pace(*arguments, "--jobs", 2) == 0
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--json", "{out}/none/mse.json"], "no such folder"),
        (["--json", "{out}"], "--json"),
        (["--out", "{out}/taken"], "exists and is not empty"),
        (["--out", "{out}/taken/file/report"], "taken/file"),
        (["--data", "{out}/none", "--out", "{out}/report"], "no such folder"),
        (["--data", "{out}", "--out", "{out}/report"], "holds no .npz or .csv file"),
        (["--trials", "none"], "--trials"),
        (["--colour", "red"], "--colour"),
    ],
)
def test_bad_arguments(tmp_path, capsys, arguments, message):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "file").write_text("taken")
    arguments = [argument.format(out=tmp_path) for argument in arguments]
    assert message in refused(capsys, "evaluate", "phase", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_help_lists_what_can_be_evaluated(capsys):
    assert pace("evaluate", "--help") == 0
    assert "phase" in capsys.readouterr().out
    assert "No such command" in refused(capsys, "evaluate", "weather")
