"""docs/own_task.md can be followed as it stands, but for how long things take."""

import re
import shlex
from pathlib import Path

import pytest

from pace_drake.demos import read_demonstrations
from tests.cli.test_run import pace

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "own_task.md").read_text()
#: Shortens each verb, and where it writes.
SHORTER = {
    "tune": ("--trials", 1, "--jobs", 1),
    "run": ("--level", "task"),
    "thresholds": ("--episodes", 20),
    "train": ("--steps", 512, "--episodes", 20),
    "demos": ("--subjects", 3, "--trials", 2),
}


@pytest.mark.slow
def test_every_command_of_the_page(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")
    pytest.importorskip("optuna", reason="extra 'tune' is not installed")
    monkeypatch.chdir(tmp_path)
    (scenario,) = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
    Path("mine.yaml").write_text(scenario)
    (commands,) = re.findall(r"```bash\n(.*?)```", PAGE, flags=re.DOTALL)
    Path("people").mkdir()
    verbs = []
    for line in commands.splitlines():
        program, verb, *rest = shlex.split(line, comments=True)
        if program == "pace":
            assert pace(verb, *rest, *SHORTER[verb]) == 0, line
            verbs.append(verb)
    assert verbs == ["demos", "tune", "run", "thresholds", "train", "run"]


def test_the_csv_of_the_page(tmp_path):
    rows = re.findall(r"^    (time,.*|[\d.]+,.*)$", PAGE, flags=re.MULTILINE)
    (tmp_path / "hand.csv").write_text("\n".join(rows))
    (one,) = read_demonstrations(tmp_path / "hand.csv")
    assert (one.name, one.num_samples, one.synthetic) == ("place_rails/P1/1", 2, False)
