"""What the network sees, by hand."""

from copy import deepcopy

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

import torch

from pace_drake.envs.space import observation_space
from pace_drake.learning.features import AssemblyFeatures
from pace_drake.observation import OBSERVATION_SETS


def features(chair, name, *rows):
    scenario = deepcopy(chair)
    scenario.observation = name
    module = AssemblyFeatures(observation_space(scenario), scenario.task)
    size = OBSERVATION_SETS[name]
    found = module(torch.tensor([row[:size] for row in rows], dtype=torch.float32)).numpy()
    assert found.shape == (len(rows), module.features_dim)
    return found


# Robot task 2, place_screws (mean 18 s, preparation 8 s), 9 s, half done; 0.1, 11 s to go; slow by 20 %.
ROW = (2, 3, 9.0, 0.5, 0.1, 11.0, 1.2)


def test_every_element(chair):
    one_hot = [0, 1, 0, 0, 0, 0, 1, 0, 0, 0]
    # elapsed / mean; phase, (9 - 8) / 10; 5 x deviation, (11 - 8) / 10; 3 (1.2 - 1).
    seen = [0.5, 0.5, 0.1, 0.5, 0.3, 0.6]
    for name, num in (("none", 1), ("paper", 3), ("fused", 5), ("history", 6)):
        np.testing.assert_allclose(features(chair, name, ROW)[0], [*one_hot, *seen[:num]], atol=1e-6)


def test_what_is_far_off_is_cut(chair):
    (row,) = features(chair, "history", (1, 1, 1e3, 0.0, 1.0, 3600.0, 50.0))
    np.testing.assert_allclose(row[10:], [3.0, 0.0, 3.0, 5.0, 3.0, 6.0], atol=1e-5)
    (row,) = features(chair, "history", (1, 1, 0.0, 1.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(row[10:], [0.0, 1.0, -1.1, 0.0, -1.1, -3.0], atol=1e-5)
