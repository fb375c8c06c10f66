"""The README's Python runs as it stands."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


def test_ten_lines_of_python(capsys):
    assert len(BLOCKS) == 3
    assert len([line for line in BLOCKS[0].splitlines() if line]) <= 11
    exec(BLOCKS[0], {})
    numbers = re.findall(r"\d+\.?\d*", capsys.readouterr().out)
    assert len(numbers) == 7  # robot idle (3), human idle (3), cost
    assert float(numbers[-1]) > 0


def test_the_phase_estimator_alone():
    names = {}
    exec(BLOCKS[1], names)
    assert names["phase"] == pytest.approx(1.0)
    assert names["phases"].shape == names["t"].shape
    assert (names["remaining_time"] > 0.0).all()


def test_the_statechart_alone(monkeypatch):
    monkeypatch.chdir(README.parent)
    names = {}
    exec(BLOCKS[2], names)
    assert names["door"].num_input_ports() == 2


def test_every_block_of_python_runs_by_itself(monkeypatch):
    """In a fresh interpreter, as one that is copied."""
    for block in BLOCKS:
        done = subprocess.run([sys.executable, "-c", block], cwd=README.parent, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_names_that_the_text_says_can_be_imported_from_where_it_says():
    said = re.findall(r"`(\w+)` \(`from ([\w.]+)`\)", README.read_text())
    assert [name for name, _ in said] == ["PaceAssemblyVectorEnv"]
    for name, module in said:
        assert hasattr(importlib.import_module(module), name)


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README.read_text()):
        assert (README.parent / target).exists(), target
