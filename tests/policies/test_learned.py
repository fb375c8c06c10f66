"""LearnedPolicy: the shipped file, its guards, and files that are refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.policies.factory import make_policy
from pace_drake.policies.learned import FORMAT, LearnedPolicy, task_signature
from pace_drake.task import RobotTask


@pytest.fixture(scope="module")
def path(chair):
    return chair.resolve(chair.learned_policy)


@pytest.fixture(scope="module")
def policy(chair, path):
    return LearnedPolicy(path, chair.task)


def test_it_assists_late_in_an_action_and_not_at_its_beginning(policy):
    assert policy.decide(np.array([4, 1, 0.0, 0.0])) == 0  # at the start the last task counts as done
    for action, mean in ((1, 22.0), (5, 40.0)):
        assert policy.decide(np.array([1, action, 8.0, 8.0 / mean])) == (action == 1)  # 14 s are left, or 32
    for action, mean in ((1, 22.0), (3, 18.0), (5, 40.0)):
        assert policy.decide(np.array([1, action, 0.95 * mean, 0.95])) == 1


def test_a_person_who_waits_is_always_helped(policy):
    for action in (2, 4, 6):
        for elapsed in (0.0, 1e3):
            assert policy.decide(np.array([1, action, elapsed, 1.0])) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("element", range(4))
def test_a_value_that_is_not_finite_never_becomes_an_action(policy, value, element):
    observation = np.array([1, 2, 5.0, 0.5])
    observation[element] = value
    assert policy.decide(observation) == -1


def test_files_that_are_refused(tmp_path, chair, path):
    data = path.read_bytes()
    cases = {
        "absent.onnx": (None, "cannot read"),
        "truncated.onnx": (data[: len(data) // 2], "not a usable ONNX policy"),
        "empty.onnx": (b"", "not a usable ONNX policy"),
        "pickle.onnx": (b"\x80\x04\x95\x00\x00.", "not a usable ONNX policy"),
        "other.onnx": (data.replace(b"pace_drake-policy-1", b"someone-elses-fmt-1"), "not a policy of format"),
    }
    for name, (content, message) in cases.items():
        file = tmp_path / name
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(InputError, match=message) as error:
            LearnedPolicy(file, chair.task)
        assert name in str(error.value)
        assert "\n" not in str(error.value)


def test_a_file_of_somebody_else_that_keeps_the_contract(tmp_path, chair):
    """As docs/learning.md states it: a linear network, made without SB3; it assists from phase 0.5 on."""
    onnx = pytest.importorskip("onnx", reason="extra 'train' is not installed")
    from onnx import TensorProto, helper, numpy_helper

    inputs = [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", 4])]
    outputs = [helper.make_tensor_value_info("scores", TensorProto.FLOAT, ["batch", 2])]
    weights = np.zeros((4, 2), dtype=np.float32)
    weights[3, 1] = 1.0
    constants = {"weights": weights, "bias": np.array([0.5, 0.0], dtype=np.float32)}
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["observation", "weights", "bias"], ["scores"])],
        "own",
        inputs,
        outputs,
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    metadata = {"format": FORMAT, "task": task_signature(chair.task), "observation": "paper"}
    helper.set_model_props(model, metadata)
    onnx.save(model, tmp_path / "own.onnx")
    dut = make_policy(str(tmp_path / "own.onnx"), chair)
    rows = np.array([[1, 1, 3.0, 0.4], [1, 1, 3.0, 0.5], [1, 1, 3.0, 0.6], [1, 2, 0.0, 0.0], [1, 1, np.nan, 0.6]])
    assert dut.decide_all(rows).tolist() == [0, 0, 1, 1, -1]  # a tie goes on; who waits is helped


def test_a_policy_of_another_task_is_refused(chair, path):
    task = replace(chair.task, robot_tasks=[RobotTask(name="weld")])
    with pytest.raises(InputError, match="trained for another task"):
        LearnedPolicy(path, task)
