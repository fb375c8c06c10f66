"""pace_drake.evaluate.clairvoyant: the least cost, against every word of decisions played by the twin."""

import itertools
from copy import deepcopy

import numpy as np
import pytest

from pace_drake.envs.kernel import DECISION
from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.clairvoyant import clairvoyant_cost
from pace_drake.people import load_people


@pytest.mark.parametrize("changes", [{}, {"decide_at_start": False}, {"human_idle_weight": 0.5}])
def test_no_word_of_decisions_costs_less(chair, changes):
    scenario = deepcopy(chair)
    for name, value in changes.items():
        setattr(scenario.task if hasattr(scenario.task, name) else scenario, name, value)
    pool = make_pool(scenario, load_people(scenario), 20, np.random.default_rng(1))
    # All ways to put 0 to 7 robot tasks before each of three assistances.
    words = np.zeros((8**3, 24))
    for row, counts in zip(words, itertools.product(range(8), repeat=3), strict=True):
        row[np.cumsum(np.array(counts) + 1) - 1] = 1.0
    for parts in pool.sample(12, np.random.default_rng(2)):
        twin = AssemblyTwin(scenario, pool, len(words))
        twin.start(np.arange(len(words)), np.tile(parts, (len(words), 1)))
        for step in range(words.shape[1]):
            going = np.flatnonzero(twin.status == DECISION)
            twin.step(words[going, step], going)
            if not (twin.status == DECISION).any():
                break
        least = clairvoyant_cost(scenario, pool.episode(parts))
        assert twin.cost.min() == pytest.approx(least, abs=1e-8)
