"""Every observation set can be trained on, exported, and is refused where another is asked for."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.observation import OBSERVATION_SETS

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from pace_drake.envs.space import observation_space
from pace_drake.learning.export import export_policy
from pace_drake.learning.greedy import GreedyPolicy
from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo
from pace_drake.people import load_people
from pace_drake.policies.factory import make_policy
from pace_drake.policies.learned import LearnedPolicy


def scenario_of(chair, name):
    scenario = deepcopy(chair)
    scenario.observation = name
    for estimator in scenario.estimator.values():
        estimator.ensemble = False  # fast
    return scenario


@pytest.mark.parametrize("name", OBSERVATION_SETS)
def test_train_export_load_and_refuse(chair, tmp_path, name):
    scenario = scenario_of(chair, name)
    model = train_ppo(scenario, replace(TWIN_SETTINGS, steps=4096), backend="twin")
    path = tmp_path / "policy.onnx"
    export_policy(model, scenario, load_people(scenario), path, {})
    policy = make_policy(str(path), scenario)
    assert policy.observation == name
    space = observation_space(scenario)
    rng = np.random.default_rng(0)
    rows = rng.uniform(space.low, np.minimum(space.high, 60.0), size=(500, len(space.low)))
    rows[:, :2] = rng.integers(1, [5, 7], size=(500, 2))
    decided = policy.decide_all(rows)
    assert (decided == GreedyPolicy(model, scenario).decide_all(rows)).mean() > 0.998  # but for ties
    assert (decided[np.isin(rows[:, 1], (2, 4, 6))] == 1).all()  # the person waits
    for element in range(len(space.low)):
        broken = rows.copy()
        broken[::2, element] = (np.nan, np.inf, -np.inf)[element % 3]
        answers = policy.decide_all(broken)
        assert (answers[::2] == -1).all()
        assert (answers[1::2] == decided[1::2]).all()
    other = "paper" if name != "paper" else "none"
    with pytest.raises(
        InputError, match=rf"policy.onnx: sees the observation set '{name}', the scenario's is '{other}'"
    ):
        make_policy(str(path), scenario_of(chair, other))
    assert make_policy(str(path), scenario_of(chair, other), any_observation=True).observation == name


def test_a_network_that_does_not_take_what_its_set_gives(chair, tmp_path):
    import onnx

    proto = onnx.load(str(chair.resolve(chair.learned_policy)))
    for value in ("history", "everything"):
        for entry in list(proto.metadata_props):
            if entry.key == "observation":
                proto.metadata_props.remove(entry)
        entry = proto.metadata_props.add()
        entry.key, entry.value = "observation", value
        path = tmp_path / f"{value}.onnx"
        onnx.save(proto, str(path))
        with pytest.raises(InputError, match=f"{value}.onnx: .*train it anew"):
            LearnedPolicy(path, chair.task)
