"""Every verb that writes tries the place before it works: one line, and nothing computed or left behind."""

import re
from pathlib import Path

import click
import pytest

from pace_drake.cli.main import pace as root
from tests.cli.test_run import refused

HERE = Path(__file__).resolve()

#: Where a file or a folder is asked for, as "WORDS" or "WORDS OPTION"; {bad} is the place.
VERBS = [
    "run --level task --out {bad}",
    "bridge --lcm-url udpm://239.255.76.67:7667?ttl=0 --out {bad}",
    "train --out {bad}.onnx",
    "train --tensorboard {bad}",
    "export {agent} --trust-pickle --out {bad}.onnx",
    "sweep {sweep} --out {bad}.parquet",
    "timeline {run} --output {bad}.png",
    "view {run} --screenshot {bad}.png",
    "diagram --level task --output {bad}.dot",
    "demos {bad}.npz",
    "record {bad}.npz --action place_rails --subject P1 --lcm-url udpm://239.255.76.67:7667?ttl=0",
    "tune --out {bad}.yaml",
    "tune --out {here}/e.yaml --journal {bad}",
    "evaluate phase --json {bad}",
    "evaluate phase --out {bad}",
    "evaluate policy --json {bad}",
    "evaluate policy --out {bad}",
    "evaluate safety --json {bad}",
    "evaluate safety --out {bad}",
    "evaluate sensitivity --json {bad}",
    "evaluate sensitivity --out {bad}",
    "evaluate perception --json {bad}",
    "evaluate perception --out {bad}",
    "evaluate workcell --json {bad}",
    "chart check pace_task --json {bad}",
    "chart draw pace_task --out {bad}.svg",
    "chart lower pace_task --out {bad}.yaml",
]


@pytest.fixture
def no_work(monkeypatch):
    """Nothing may be loaded for the work itself."""

    def fail(*_, **__):
        raise AssertionError("the work began")

    for name in (
        "people.load_people",
        "evaluate.tuning.load_signals",
        "statechart.check.check",
        "demos.generate_demonstrations",
        "diagram.Assembly",
        "statechart.load_chart",
        "evaluate.separation.SeparationBench",
        "evaluate.sensitivity.evaluate_cases",
        "evaluate.perception.evaluate",
    ):
        monkeypatch.setattr(f"pace_drake.{name}", fail)


@pytest.mark.parametrize("verb", VERBS)
def test_a_place_that_cannot_be_written(verb, no_work, tmp_path, capsys, monkeypatch):
    if verb.startswith(("train", "export", "sweep")):
        pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")
    run = tmp_path / "run"
    run.mkdir()
    for name in ("events.csv", "replay.html"):
        (run / name).touch()
    (tmp_path / "agent.zip").touch()
    names = {
        "bad": "/proc/x",
        "here": tmp_path,
        "run": run,
        "agent": tmp_path / "agent.zip",
        "sweep": HERE.parents[2] / "examples" / "sweep.yaml",
    }
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    error = refused(capsys, *(word.format(**names) for word in verb.split()))
    assert re.match(r"pace: /proc/x(\.\w+)?: cannot be written \(", error)
    assert sorted(tmp_path.rglob("*")) == before


def test_every_output_is_tried():
    """A new option that names an output must be above."""

    def options(command, words=()):
        if isinstance(command, click.Group):
            for name in command.list_commands(None):
                yield from options(command.get_command(None, name), (*words, name))
        for one in command.params:
            if isinstance(one.type, click.Path) and isinstance(one, click.Option) and one.type.type is Path:
                yield " ".join(words), one.opts[-1]

    read = {("chart check", "--checks"), ("record", "--log")}
    tried = {
        (verb, option)
        for verb, option in options(root)
        if any(t.startswith(verb) and f" {option} " in t for t in VERBS)
    }
    assert {*options(root)} - read == tried
    assert len(tried) > 20
