"""Every example runs and shows what it says."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.policies.factory import make_policy

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    assert sorted(p.stem for p in EXAMPLES.glob("*.py")) == ["bridge", "own_chart", "own_policy", "simulate", "train"]


def test_simulate(tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    picture = tmp_path / "phase.png"
    cost = load("simulate").run(str(picture))
    assert 0 < cost < 200
    assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"must end in \.png, \.svg or \.pdf"):
        load("simulate").run(str(tmp_path / "phase.foo"))


def test_train():
    pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")
    assert load("train").run(256) > 0


def test_bridge():
    """The peer follows the diagram's commands over LCM messages (memq://), with none rejected."""
    time, worst_error, accepted, rejected = load("bridge").run(20.0)
    assert time >= 20.0
    assert accepted > 3900  # 200 Hz
    assert rejected == 0
    assert 0 < worst_error < 0.03  # [rad], lag of the peer's 30 Hz filter


def test_own_policy(chair):
    module = load("own_policy")
    costs = module.run(50)
    assert 0 < costs["own"] < costs["explicit query"]
    # It is what it says: the rule of the package with 0.5 everywhere.
    rule = make_policy("phase_threshold", replace(chair, phase_threshold=dict.fromkeys(chair.phase_threshold, 0.5)))
    rng = np.random.default_rng(0)
    rows = np.column_stack(
        [rng.integers(1, 5, 200), rng.integers(1, 7, 200), rng.uniform(0, 40, 200), rng.uniform(0, 1, 200)]
    )
    own = module.HalfPhase(chair.task.human_index_of_joint)
    assert own.decide_all(rows).tolist() == rule.decide_all(rows).tolist()


def test_own_chart():
    taken, moved = load("own_chart").run()
    assert taken == ["opens", "alarms", "goes_on", "closes"]
    assert moved == pytest.approx(1.0)


def test_the_door_holds():
    from pace_drake.statechart.check import check, checks_path, load_spec

    report = check(load_spec(checks_path(EXAMPLES / "door.scxml")))
    assert report.holds
    assert len(report.verdicts) == 6
