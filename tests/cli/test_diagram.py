"""pace diagram: Drake's picture of the diagram, with and without Graphviz."""

import xml.etree.ElementTree as ET

import pytest

from pace_drake import graphviz
from pace_drake.cli import diagram
from pace_drake.cli.main import main
from pace_drake.errors import InputError


def pace(*arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in ("diagram", "--policy", "phase_threshold", *arguments)])
    return stop.value.code


def refused(capsys, *arguments):
    assert pace(*arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("pace: ")
    assert error.count("\n") == 1
    return error


@pytest.fixture
def no_program(monkeypatch):
    monkeypatch.setattr(graphviz.shutil, "which", lambda *_, **__: None)


def test_graphviz_text_needs_no_program(tmp_path, no_program):
    assert pace("--level", "task", "-o", tmp_path / "task.dot") == 0
    text = (tmp_path / "task.dot").read_text()
    for name in ("Human", "PhaseEstimator", "Decision", "TaskStatechart", "RobotAction", "IdleMeter"):
        assert f"<B>{name}</B>" in text
    assert "name=station" not in text


def test_without_a_program_one_line_says_what_to_install(tmp_path, no_program, capsys, monkeypatch):
    monkeypatch.setattr(diagram, "_assembly", lambda *_: pytest.fail("built a diagram for nothing"))
    error = refused(capsys, "-o", tmp_path / "plant.svg")
    assert "pip install 'pace_drake[diagram]'" in error
    assert "apt-get install graphviz" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", ["dot", "graphviz-pure"])
def test_the_picture_names_systems_and_ports(program, tmp_path, monkeypatch):
    monkeypatch.setattr(graphviz, "_PROGRAMS", (program,))
    try:
        graphviz.find_dot()
    except InputError:
        pytest.skip(f"{program} is not installed")
    assert pace("-o", tmp_path / "plant.svg") == 0
    root = ET.parse(tmp_path / "plant.svg").getroot()
    texts = {"".join(text.itertext()) for text in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"Human", "TaskStatechart", "assist", "p_WH", "panda.position", "name=station", "output ports"} <= texts
    assert "MultibodyPlant" not in texts


def test_depth_opens_the_station(tmp_path, no_program):
    for depth, inside in ((0, {}), (1, {"Human"}), (2, {"Human", "MultibodyPlant"})):
        assert pace("--depth", depth, "-o", tmp_path / "plant.dot") == 0
        text = (tmp_path / "plant.dot").read_text()
        for name in ("Human", "MultibodyPlant"):
            assert (f"<B>{name}</B>" in text) == (name in inside)


def test_mistakes_give_one_line(tmp_path, capsys):
    assert "must end in .svg, .png or .dot" in refused(capsys, "-o", tmp_path / "a.pdf")
    assert "no such folder" in refused(capsys, "-o", tmp_path / "absent" / "a.dot")
    assert "unknown scenario 'atlantis'" in refused(capsys, "atlantis", "-o", tmp_path / "a.dot")
