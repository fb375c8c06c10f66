"""What the robot knows of SYNTHETIC people only is named, so that it can be said beside a real person."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pace_drake.bridge.synthetic import synthetic_parts
from pace_drake.demos import generate_demonstrations, write_demonstrations
from pace_drake.dtw.estimator_file import ActionEstimator, EstimatorFile, write_estimator_file
from pace_drake.dtw.filter import Calibration
from pace_drake.people import load_people
from pace_drake.scenario import load_scenario

ALL = "references and durations of place_rails, place_screws, tighten_screws"


def parts(*overrides):
    scenario = load_scenario("ikea_chair", overrides)
    return synthetic_parts(scenario, load_people(scenario, tracked=True))


def write_estimators(path, description):
    one = ActionEstimator("wp", 0.5, 1.0, "P1/1", np.eye(3), Calibration(3.0, 0.2, (0.0,), (0.0,), (0.1,)), {})
    write_estimator_file(path, EstimatorFile(description, 0.1, "m", {"place_rails": one}))
    return f"estimator_file={path}"


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ((), [ALL, "policy learned"]),
        (("policy=never_assist",), [ALL]),
        (("policy=phase",), [ALL, "policy phase"]),
        (("policy=policies/ikea_chair.onnx",), [ALL]),  # there is no such file here, so no card beside it
    ],
)
def test_as_shipped_all_of_it(overrides, expected):
    assert parts(*overrides) == expected


def test_one_s_own_people_are_not(tmp_path):
    people = generate_demonstrations(num_subjects=2, num_trials=1).demonstrations
    write_demonstrations(tmp_path / "real.npz", [replace(d, synthetic=False) for d in people])  # as if they were
    write_demonstrations(tmp_path / "synthetic.npz", people)
    real = f"human.demonstrations={tmp_path / 'real.npz'}"
    assert parts(real, "policy=never") == []
    assert parts(real, "policy=phase") == ["policy phase"]  # with the thresholds of the shipped scenario
    assert parts(real, "policy=phase", "phase_threshold={place_rails: 0.31}") == []
    assert parts(f"human.demonstrations={tmp_path / 'synthetic.npz'}", "policy=never") == [ALL]
    file = write_estimators(tmp_path / "real.yaml", "3 people")
    assert parts(file, "policy=never") == ["references and durations of place_screws, tighten_screws"]
    file = write_estimators(tmp_path / "synthetic.yaml", "SYNTHETIC 3 people")
    assert parts(real, file, "policy=never") == ["references and durations of place_rails"]


@pytest.mark.parametrize(("people", "said"), [("SYNTHETIC people", True), ("recorded hands", False)])
def test_a_policy_s_card_says_whose_it_is(tmp_path, people, said):
    policy = tmp_path / "mine.onnx"
    policy.with_suffix(".json").write_text(json.dumps({"score": {"people": people}}))
    assert (f"policy {policy}" in parts(f"policy={policy}")) == said
    for content in ("{", "[]", "null", "{}"):
        policy.with_suffix(".json").write_text(content)
        assert parts(f"policy={policy}") == [ALL]
