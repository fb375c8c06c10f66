"""The README's Python runs as it stands."""

import re
from pathlib import Path

import numpy as np

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
    t = np.linspace(0, 6, 80)
    path = np.column_stack([np.sin(t), np.cos(2 * t), t])
    names = {"reference": path, "hand": path, "demonstrations": [path[::2], path, np.repeat(path, 2, axis=0)]}
    exec(BLOCKS[1].replace("phase, phase_std", "phases, phase_std"), names)
    assert names["phase"] == 1.0
    assert names["phases"].shape == (80,)
    assert (names["remaining_time"] > 0.0).all()


def test_the_statechart_alone(monkeypatch):
    from pydrake.systems.framework import DiagramBuilder

    monkeypatch.chdir(README.parent)
    names = {"builder": DiagramBuilder()}
    exec(BLOCKS[2], names)
    assert names["door"].num_input_ports() == 2


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README.read_text()):
        assert (README.parent / target).exists(), target
