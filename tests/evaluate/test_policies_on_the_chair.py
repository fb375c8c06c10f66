"""What the policies cost on the chair, on the same 60 episodes of validation trials."""

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.evaluate.episode import mean_result, run_episode
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation


@pytest.fixture(scope="module")
def means(chair, chair_people):
    means = {}
    for name in ("always_assist", "elapsed_threshold", "phase_threshold", "learned"):
        simulation = Simulation(Assembly(chair, make_policy(name, chair), people=chair_people))
        results = [run_episode(simulation, simulation.sample_episode(np.random.default_rng([1, k]))) for k in range(60)]
        means[name] = mean_result(results)
    return means


def test_elapsed_time_alone_costs_what_the_notes_say(means):
    assert 24 <= means["elapsed_threshold"]["cost"] <= 29


def test_the_phase_helps_a_rule(means):
    assert means["phase_threshold"]["cost"] < means["elapsed_threshold"]["cost"]


def test_the_shipped_policy_is_at_least_15_percent_below_the_elapsed_threshold(means):
    assert means["learned"]["cost"] <= 0.85 * means["elapsed_threshold"]["cost"]


def test_always_assisting_keeps_the_person_from_waiting_and_the_robot_waits(means):
    assert means["always_assist"]["human_idle"]["total"] < 2
    assert means["always_assist"]["robot_idle"]["total"] > 30


def test_every_episode_finishes(means):
    assert all(mean["finished"] for mean in means.values())
