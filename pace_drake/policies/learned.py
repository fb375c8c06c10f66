"""A learned policy in ONNX, run by onnxruntime. Nothing in such a file is executed as code; no pickle is read."""

import json
from pathlib import Path

import numpy as np

from pace_drake.errors import InputError
from pace_drake.policies.rules import joint_actions
from pace_drake.task import Task

#: Version of what the metadata of a policy file means.
FORMAT = "pace_drake-policy-1"


def task_signature(task: Task) -> str:
    """What a policy must agree on with the task it is used in: the names behind the indices it observes."""
    return json.dumps(
        {
            "human_actions": [[action.name, action.joint] for action in task.human_actions],
            "robot_tasks": [robot_task.name for robot_task in task.robot_tasks],
        }
    )


class LearnedPolicy:
    """Chooses the action with the larger score.

    Two rules stand around the network: a person who waits is always helped (an untrained corner of the observation
    space must not leave them waiting for ever), and an observation that is not finite gets no answer, so that the
    decision times out as the chart says.

    Args:
        path: ONNX file: input ``observation`` (batch, 4), output ``scores`` (batch, 2), normalisation inside, and
            metadata ``format``, ``task`` (see ``task_signature``).
        task: the task it is used in.

    Raises:
        InputError: the file cannot be read, is no policy of this format, or was trained for another task.
    """

    def __init__(self, path: str | Path, task: Task) -> None:
        import onnxruntime  # 0.1 s and 30 MB, only for those who run a learned policy

        path = Path(path)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: cannot read the policy: {error.strerror}") from error
        options = onnxruntime.SessionOptions()
        # One small network: threads cost more than they give, and one thread gives the same bits every time.
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises several unrelated types for a bad file
            raise InputError(f"{path}: not a usable ONNX policy; train one with 'pace train'") from error
        metadata = self._session.get_modelmeta().custom_metadata_map
        if metadata.get("format") != FORMAT:
            raise InputError(f"{path}: an ONNX file, but not a policy of format {FORMAT}; train one with 'pace train'")
        if metadata.get("task") != task_signature(task):
            raise InputError(
                f"{path}: trained for another task ({metadata.get('scenario', 'unknown')}); train one for this scenario"
            )
        self._joint = joint_actions(task)

    def decide(self, observation: np.ndarray) -> int:
        """See Policy."""
        if not np.all(np.isfinite(observation)):
            return -1
        if int(observation[1]) in self._joint:
            return 1
        row = np.asarray(observation, dtype=np.float32)[np.newaxis]
        (scores,) = self._session.run(["scores"], {"observation": row})
        return int(scores[0, 1] > scores[0, 0])
