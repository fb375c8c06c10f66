"""A learned policy in ONNX, run by onnxruntime. Nothing in such a file is executed as code; no pickle is read."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pace_drake.errors import InputError
from pace_drake.observation import FUSED_SETS, OBSERVATION_SETS
from pace_drake.policies import Policy
from pace_drake.policies.estimates import Estimates
from pace_drake.policies.rules import joint_actions, person_waits
from pace_drake.task import Task

if TYPE_CHECKING:
    from pace_drake.dtw.estimator import Estimator
    from pace_drake.people import People
    from pace_drake.scenario import Scenario

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


class LearnedPolicy(Policy):
    """Chooses the action with the larger score.

    Two rules stand around the network: a person who waits is always helped (an untrained corner of the observation
    space must not leave them waiting for ever), and an observation that is not finite gets no answer, so that the
    decision times out as the chart says.

    Args:
        path: ONNX file: input ``observation`` (batch, D), output ``scores`` (batch, 2), normalisation inside, and
            metadata ``format``, ``task`` (see ``task_signature``), ``observation``, the set that it sees, and
            ``estimates``, what the estimators showed it (see ``Estimates``); only sets without the phase filter may
            lack these.
        task: the task it is used in.
        observation: the set that it must see; None takes any.

    Raises:
        InputError: the file cannot be read, is no policy of this format, was trained for another task or another
            observation set, or does not say what the phase filter showed it.
    """

    def __init__(self, path: str | Path, task: Task, observation: str | None = None) -> None:
        import onnxruntime  # 0.1 s and 30 MB, only for those who run a learned policy

        self._path = path = Path(path)
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
        self.observation = metadata.get("observation", "paper")  # which the first files saw, and did not say
        if self.observation not in OBSERVATION_SETS:
            raise InputError(f"{path}: sees {self.observation!r}, which this version does not know; train it anew")
        if observation not in (None, self.observation):
            raise InputError(
                f"{path}: sees the observation set {self.observation!r}, the scenario's is {observation!r}; set"
                f" observation={self.observation}, or train one for this scenario"
            )
        text = metadata.get("estimates")
        if text is None and self.observation in FUSED_SETS:
            raise InputError(
                f"{path}: does not say what the phase filter showed it, as files of older versions do not; train it"
                " anew: pace train"
            )
        try:
            self._estimates = None if text is None else Estimates.from_json(text)
        except ValueError as error:
            raise InputError(f"{path}: what the estimators showed it cannot be read; train it anew") from error
        shape = self._session.get_inputs()[0].shape
        if len(shape) != 2 or shape[1] != OBSERVATION_SETS[self.observation]:
            raise InputError(f"{path}: its network does not take what {self.observation!r} gives; train it anew")
        self._joint = joint_actions(task)

    def check_estimates(self, scenario: "Scenario", people: "People", estimators: "Sequence[Estimator | None]") -> None:
        """Refuses estimators that show something else, of the same people and by the same settings, than in training.

        Args:
            scenario, people: that it is used in.
            estimators: those that ``people.estimators`` returned for them.

        Raises:
            InputError: they do, as another version of this program may.
        """
        if self._estimates is None or (now := Estimates.of(scenario, people, estimators, self.observation)) is None:
            return
        if different := self._estimates.difference(now):
            raise InputError(
                f"{self._path}: trained with another phase estimate {different}; train it anew: pace train"
            )

    def decide_all(self, observations: np.ndarray) -> np.ndarray:
        """See Policy."""
        usable = np.isfinite(observations).all(axis=1)
        seen = np.where(usable[:, np.newaxis], observations, 1.0).astype(np.float32)
        (scores,) = self._session.run(["scores"], {"observation": seen})
        return guarded(scores, observations, self._joint)


def guarded(scores: np.ndarray, observations: np.ndarray, joint: frozenset[int]) -> np.ndarray:
    """(n,) answers to scores (n, 2) of a network, with the two rules of ``LearnedPolicy``.

    Args:
        scores: of going on and of assisting.
        observations: (n, D) what was observed.
        joint: see ``rules.joint_actions``.
    """
    usable = np.isfinite(observations).all(axis=1) & np.isfinite(scores).all(axis=1)
    assist = (scores[:, 1] > scores[:, 0]) | person_waits(observations, joint)
    return np.where(usable, assist, -1).astype(int)
