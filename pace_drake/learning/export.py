"""Writes a trained policy as ONNX with its normalisation inside, and its card beside it."""

import io
import json
import warnings
from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces import Discrete
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy

from pace_drake.envs.space import observation_space
from pace_drake.errors import InputError
from pace_drake.files import write_whole
from pace_drake.learning.greedy import Scores
from pace_drake.people import People
from pace_drake.policies.estimates import Estimates
from pace_drake.policies.learned import FORMAT, task_signature
from pace_drake.scenario import Scenario, scenario_hash


def export_policy(model: PPO, scenario: Scenario, people: People, path: Path, card: dict) -> None:
    """Exports a policy trained in ``PaceAssemblyEnv``.

    Args:
        model: the trained agent.
        scenario: what it was trained in; its task is written into the file and checked when it is loaded.
        people: of the scenario; what the estimators show of them is written and checked likewise.
        path: ends in .onnx; the card goes to the same name with .json.
        card: facts for people: seed, steps, score, versions.

    Raises:
        RuntimeError: the exported network does not compute what the trained one does.
    """
    import onnx
    import onnxruntime

    scores = Scores(model).cpu().eval()
    rng = np.random.default_rng(0)
    low, high = model.observation_space.low, np.minimum(model.observation_space.high, 100.0)  # type: ignore[attr-defined]
    sample = torch.tensor(rng.uniform(low, high, size=(64, len(low))), dtype=torch.float32)
    file = io.BytesIO()
    with warnings.catch_warnings():
        # The exporter by TorchScript is deprecated. The new one takes two seconds for this network instead of 0.04, and
        # needs onnxscript; every torch that pyproject.toml allows has the old one.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            scores,
            (sample,),
            file,  # type: ignore[arg-type]  # that exporter writes into memory, too
            input_names=["observation"],
            output_names=["scores"],
            dynamic_axes={"observation": {0: "batch"}, "scores": {0: "batch"}},
            dynamo=False,
        )
    proto = onnx.load_from_string(file.getvalue())
    for key, value in _metadata(scenario, people).items():
        entry = proto.metadata_props.add()
        entry.key, entry.value = key, value
    session = onnxruntime.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    (exported,) = session.run(["scores"], {"observation": sample.numpy()})
    with torch.no_grad():
        trained = scores(sample).numpy()
    if not np.allclose(exported, trained, atol=1e-4):
        raise RuntimeError(f"{path}: exported and trained policy differ by {np.abs(exported - trained).max()}")
    write_whole(path, lambda part: onnx.save(proto, str(part)))
    write_card(path, card)


def read_agent(path: Path, scenario: Scenario) -> PPO:
    """Reads a PPO agent, or an A2C agent with the same network, that Stable-Baselines3 saved.

    Its file is a pickle: call this only where the user trusts its maker.

    Args:
        path: of the .zip.
        scenario: whose observations and actions it must have.

    Raises:
        InputError: the file cannot be read, or the agent is of other observations or actions.
    """
    try:
        model = PPO.load(path, device="cpu")
    except Exception as error:  # whatever its pickle raises
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read as a PPO or A2C agent ({type(error).__name__}: {reason})") from error
    if not isinstance(model.policy, ActorCriticPolicy):
        raise InputError(f"{path}: a {type(model.policy).__name__}, which has no score for each action")
    for name, own, needed in (
        ("observations", model.observation_space, observation_space(scenario)),
        ("actions", model.action_space, Discrete(2)),
    ):
        if own != needed:
            raise InputError(
                f"{path}: its {name} are {' '.join(str(own).split())}, those of the scenario {scenario.name}"
                f" (observation: {scenario.observation}) are {' '.join(str(needed).split())}"
            )
    return model


def write_card(path: Path, card: dict) -> None:
    """Writes, or writes again, the card of the policy at ``path``: the same name, ending in .json.

    It also says what the policy says of itself: one of an older version is scored again, and stays what it is.
    """
    import onnx

    metadata = {entry.key: entry.value for entry in onnx.load(str(path)).metadata_props}
    text = json.dumps({**card, **metadata}, indent=1) + "\n"
    write_whole(path.with_suffix(".json"), lambda part: part.write_text(text, encoding="utf-8"))


def _metadata(scenario: Scenario, people: People) -> dict[str, str]:
    estimates = Estimates.of(scenario, people, people.estimators(scenario), scenario.observation)
    return {
        "format": FORMAT,
        "task": task_signature(scenario.task),
        "scenario": scenario.name,
        "scenario_hash": scenario_hash(scenario),
        "observation": scenario.observation,
        **({} if estimates is None else {"estimates": estimates.to_json()}),
    }
