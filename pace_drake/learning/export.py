"""Writes a trained policy as ONNX with its normalisation inside, and its card beside it."""

import json
import logging
import warnings
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO

from pace_drake.files import write_whole
from pace_drake.policies.learned import FORMAT, task_signature
from pace_drake.scenario import Scenario


class _Scores(torch.nn.Module):
    """The deterministic part of an SB3 actor-critic policy: observation -> one score per action."""

    def __init__(self, model: PPO) -> None:
        super().__init__()
        policy = model.policy
        self.features, self.hidden, self.action = (
            policy.features_extractor,
            policy.mlp_extractor.policy_net,
            policy.action_net,
        )

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.action(self.hidden(self.features(observation)))


def export_policy(model: PPO, scenario: Scenario, path: Path, card: dict) -> None:
    """Exports a policy trained in ``PaceAssemblyEnv``.

    Args:
        model: the trained agent.
        scenario: what it was trained in; its task is written into the file and checked when it is loaded.
        path: ends in .onnx; the card goes to the same name with .json.
        card: facts for people: seed, steps, score, versions.

    Raises:
        RuntimeError: the exported network does not compute what the trained one does.
    """
    import onnx
    import onnxruntime

    scores = _Scores(model).cpu().eval()
    rng = np.random.default_rng(0)
    low, high = model.observation_space.low, np.minimum(model.observation_space.high, 100.0)  # type: ignore[attr-defined]
    sample = torch.tensor(rng.uniform(low, high, size=(64, len(low))), dtype=torch.float32)
    # The exporter warns of torchvision, which nothing here needs, and of its own deprecated calls.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        program = torch.onnx.export(
            scores,
            (sample,),
            input_names=["observation"],
            output_names=["scores"],
            dynamic_shapes={"observation": {0: torch.export.Dim("batch")}},
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    proto = program.model_proto
    # Stack traces of the exporter name files of this machine; the policy needs none of it.
    for node in proto.graph.node:
        del node.metadata_props[:]
    for value in (*proto.graph.value_info, *proto.graph.input, *proto.graph.output):
        del value.metadata_props[:]
    del proto.metadata_props[:]
    for key, value in _metadata(scenario).items():
        entry = proto.metadata_props.add()
        entry.key, entry.value = key, value
    session = onnxruntime.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    (exported,) = session.run(["scores"], {"observation": sample.numpy()})
    with torch.no_grad():
        trained = scores(sample).numpy()
    if not np.allclose(exported, trained, atol=1e-4):
        raise RuntimeError(f"{path}: exported and trained policy differ by {np.abs(exported - trained).max()}")
    write_whole(path, lambda part: onnx.save(proto, str(part)))
    write_card(path, scenario, card)


def write_card(path: Path, scenario: Scenario, card: dict) -> None:
    """Writes, or writes again, the card of the policy at ``path``: the same name, ending in .json."""
    text = json.dumps({**card, **_metadata(scenario)}, indent=1) + "\n"
    write_whole(path.with_suffix(".json"), lambda part: part.write_text(text, encoding="utf-8"))


def _metadata(scenario: Scenario) -> dict[str, str]:
    return {
        "format": FORMAT,
        "task": task_signature(scenario.task),
        "scenario": scenario.name,
        "scenario_hash": sha256(scenario.to_yaml().encode()).hexdigest(),
        "observation": scenario.observation,
    }
