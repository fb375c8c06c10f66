"""What is written is read back exactly; what is wrong is refused in one line, and nothing in a file is executed."""

import os
from dataclasses import replace

import numpy as np
import pytest
import yaml

from pace_drake.dtw.estimator_file import ActionEstimator, EstimatorFile, read_estimator_file, write_estimator_file
from pace_drake.dtw.filter import Calibration
from pace_drake.errors import InputError

rng = np.random.default_rng(0)
CALIBRATION = Calibration(1.0 / 3.0, 0.1, (-0.01, 0.0), (0.2,), (0.1, 1e-5, 0.3))
ROWS = ActionEstimator(
    "wp", 0.1 + 0.2, 0.8, "row/S1/T1", rng.normal(size=(12, 3)), CALIBRATION, {"train_mse": 1e-7, "trials": 60.0}
)
ROWS = replace(ROWS, goal=np.array([0.1, 0.2, 1.0 / 3.0]))
CONTENT = EstimatorFile("SYNTHETIC 3 people", 0.1, "m", {"row": ROWS, "lift up": replace(ROWS, distance="euclidean")})


@pytest.fixture
def path(tmp_path):
    write_estimator_file(tmp_path / "estimators.yaml", CONTENT)
    return tmp_path / "estimators.yaml"


def test_what_is_written_is_read_back_exactly(path):
    read = read_estimator_file(path)
    assert (read.description, read.sample_period, read.units) == ("SYNTHETIC 3 people", 0.1, "m")
    assert list(read.actions) == ["row", "lift up"]
    for name, action in read.actions.items():
        expected = CONTENT.actions[name]
        assert (action.reference == expected.reference).all()
        assert (action.goal == expected.goal).all()
        for field in ("distance", "gamma", "window", "reference_name", "calibration", "score"):
            assert getattr(action, field) == getattr(expected, field)
    again = path.with_name("again.yaml")
    write_estimator_file(again, read)
    assert again.read_bytes() == path.read_bytes()


def test_without_a_goal_an_action_ends_where_its_reference_does(path):
    """So it is in the files of earlier versions."""
    edited(path, "actions", "row", "goal")
    assert (read_estimator_file(path).actions["row"].goal == ROWS.reference[-1]).all()


def test_its_estimators_are_those_of_the_settings(path):
    action = read_estimator_file(path).actions["row"]
    query = rng.normal(size=(9, 3))
    alignment, fused = action.alignment(0.1), action.fused(0.1)
    assert (alignment.phase(query) == ROWS.alignment(0.1).phase(query)).all()
    assert (fused.phase(query) == ROWS.fused(0.1).phase(query)).all()
    assert fused.calibration == CALIBRATION
    assert fused.sample_period == alignment.sample_period == 0.1


def test_an_older_file_stays_until_the_new_one_is_whole(path):
    before = path.read_bytes()
    broken = replace(CONTENT, actions={"row": replace(ROWS, gamma=np.float64(1.0))})  # which YAML does not know
    with pytest.raises(yaml.YAMLError):
        write_estimator_file(path, broken)
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]
    with pytest.raises(InputError, match=r"none/a\.yaml: cannot be written \(No such file or directory\), check"):
        write_estimator_file(path.parent / "none" / "a.yaml", CONTENT)


def edited(path, *keys, value=None):
    """Sets, or without a value removes, one entry of the file."""
    document = yaml.safe_load(path.read_text())
    at = document
    for key in keys[:-1]:
        at = at[key]
    if value is None:
        del at[keys[-1]]
    else:
        at[keys[-1]] = value
    path.write_text(yaml.safe_dump(document))


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("units",), None, "the file: has no 'units'"),
        (("colour",), 1, "the file: has the unknown key 'colour'"),
        (("actions",), {}, "actions: must name at least one action"),
        (("actions",), [1], "actions: must name at least one action"),
        (("actions", "row"), 3, "actions.row: must be a mapping of calibration, distance, gamma"),
        (("actions", "row", "gama"), 1.0, "actions.row: has the unknown key 'gama'"),
        (("actions", "row", "gamma"), "much", "actions.row: gamma: must be a number, is 'much'"),
        (("actions", "row", "gamma"), True, "actions.row: gamma: must be a number, is True"),
        (("actions", "row", "gamma"), -1.0, "actions.row: gamma must be"),
        (("actions", "row", "window"), float("nan"), "actions.row: window must be"),
        (("actions", "row", "distance"), "manhattan", "actions.row: distance must be one of"),
        (("actions", "row", "score"), {"mse": "good"}, "actions.row: score.mse: must be a number"),
        (("actions", "row", "reference"), [[1.0, 2.0], [3.0]], "actions.row: reference must be a list of samples"),
        (("actions", "row", "reference"), [[1.0, 2.0, 3.0]], "actions.row: reference must have at least 2 samples"),
        (("actions", "row", "goal"), [0.1, 0.2], "actions.row: goal must be a vector of 3 values"),
        (("actions", "row", "calibration", "slope"), None, "actions.row.calibration: has no 'slope'"),
        (("actions", "row", "calibration", "std"), [0.1, 0.0], "actions.row: std must be finite values > 0"),
        (("actions", "row", "calibration", "std"), 0.1, "actions.row.calibration.std: must be a list of numbers"),
        (("actions", "row", "calibration", "std"), [], "actions.row: std must have at least one value"),
        (("actions", "row", "calibration", "std"), ["x"], "actions.row.calibration.std: must be a number, is 'x'"),
        (("actions", "row", "calibration", "duration_log_std"), [1.0], "duration_log_std: must be a number, is [1.0]"),
        (("sample_period",), 0.0, "sample_period must be > 0"),
        (("sample_period",), "0.1 s", "sample_period: must be a number, is '0.1 s'"),
    ],
)
def test_what_is_wrong_is_named(path, keys, value, message):
    edited(path, *keys, value=value)
    with pytest.raises(InputError) as error:
        read_estimator_file(path)
    assert message in str(error.value)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is no YAML file"),
        ("!!python/object/apply:os.system ['echo executed']", "is no YAML file"),
        ("just a text", "the file: must be a mapping of actions, description"),
        ("", "the file: must be a mapping"),
        (b"\xff\xfe\xfa", "cannot be read (no text file)"),
    ],
)
def test_other_files_are_refused(tmp_path, capfd, text, message):
    path = tmp_path / "other.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as error:
        read_estimator_file(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert "executed" not in capfd.readouterr().out


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read \(No such file or directory\)"):
        read_estimator_file(tmp_path / "none.yaml")
