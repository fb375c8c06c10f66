"""pace_drake.alignments: which trial others are compared with."""

import numpy as np
import pytest

from pace_drake.alignments import choose_reference, make_alignment, spread
from pace_drake.demos import Demonstration, generate_demonstrations
from pace_drake.people import load_people
from pace_drake.scenario import EstimatorConfig, load_scenario
from pace_drake.task import Duration
from tests.naive import naive_spread

DURATION = Duration(mean=20.0, cv=0.25, minimum=5.0)
CONFIG = EstimatorConfig(distance="wp", gamma=0.5, window=0.8)


def shown(subject, trial, path):
    return Demonstration("reach", subject, trial, 0.1, path, synthetic=True)


def paths(seed, count, noise):
    """Trials of one motion, each with noise of its own [m]; SYNTHETIC."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, 150)[:, np.newaxis]
    motion = np.hstack([np.sin(7.0 * time), np.cos(5.0 * time), np.sin(11.0 * time + 1.0)])
    return [motion + noise * np.cumsum(rng.normal(size=motion.shape), axis=0) for _ in range(count)]


def test_spread_is_the_deviation_between_people_over_the_slope_of_their_mean():
    rng = np.random.default_rng(0)
    durations = [9.3, 14.0, 21.7, 30.0]
    phases = [
        np.clip(np.linspace(0, 1, int(T / 0.1) + 1) ** p, 0, 1)
        for T, p in zip(durations, (0.8, 1, 1.3, 2), strict=True)
    ]
    assert spread(phases, durations, 0.1) == pytest.approx(naive_spread(phases, durations, 0.1), rel=1e-12)
    noisy = [np.clip(one + 0.02 * rng.normal(size=one.size), 0, 1) for one in phases]
    assert spread(noisy, durations, 0.1) == pytest.approx(naive_spread(noisy, durations, 0.1), rel=1e-12)


def test_a_lag_that_all_share_is_no_spread_and_a_phase_that_does_not_move_is_much():
    time = [np.linspace(0, 1, m) for m in (101, 201)]
    durations = [10.0, 20.0]
    assert spread([t**2 for t in time], durations, 0.1) == pytest.approx(0.0, abs=1e-4)
    apart = [0.1 + 0.8 * time[0], 0.1 + 0.8 * time[1] + 0.04]
    assert spread(apart, durations, 0.1) == pytest.approx(0.02 / 0.8, rel=1e-6)
    flat = [0.5 + 0.0 * time[0], 0.54 + 0.0 * time[1]]
    assert spread(flat, durations, 0.1) == pytest.approx(0.02 / 0.2, rel=1e-6)


def test_a_trial_that_is_like_the_others_is_chosen_and_not_a_strange_one():
    known = [shown(f"S{k}", "T1", path) for k, path in enumerate(paths(1, 4, 0.003))]
    strange = shown("S9", "T1", paths(2, 1, 0.08)[0])
    chosen = choose_reference(DURATION, CONFIG, [strange, *known], known, 0.1)
    assert any(chosen is one for one in known)
    assert choose_reference(DURATION, CONFIG, [chosen, strange], known, 0.1) is chosen


def test_a_candidate_is_not_judged_by_its_own_persons_trials():
    """A person who always does the same in a way of their own would else be the best reference."""
    own = paths(3, 1, 0.05)[0]
    alone = [shown("A", f"T{k}", own + 1e-4 * k) for k in range(6)]
    others = [shown(f"S{k}", "T1", path) for k, path in enumerate(paths(4, 3, 0.01))]
    assert choose_reference(DURATION, CONFIG, [*alone, *others], [*alone, *others], 0.1).subject != "A"


def test_the_reference_of_synthetic_people_is_the_best_of_the_known_ones_and_is_not_played():
    scenario = load_scenario("ikea_chair", ("human.split=train",))
    people, known = load_people(scenario), generate_demonstrations(seed=0).split("train")
    for k, action in enumerate(scenario.task.human_actions):
        reference = people.references[k]
        if action.joint:
            assert reference is None
            continue
        trials = known.of(action.name)
        candidates = [known.reference(action.name), *trials]
        best = choose_reference(action.duration, scenario.estimator_of(action.name), candidates, trials, 0.1)
        assert np.array_equal(reference.p_WH, best.p_WH)
        for group in (people.demonstrations[k], people.training[k]):
            assert len(group) == len(trials) - (reference.trial != "reference")
            assert not any(np.array_equal(d.p_WH, reference.p_WH) for d in group)


def test_what_is_chosen_on_known_people_is_better_for_unseen_ones():
    """Over three worlds, than the generator's own reference, of a person of average tempo."""
    found = []
    for seed in (1, 2, 6):
        scenario = load_scenario("ikea_chair", (f"human.seed={seed}", "human.split=unseen"))
        people, usual = load_people(scenario), generate_demonstrations(seed=seed)
        for k, action in enumerate(scenario.task.human_actions):
            if action.joint:
                continue
            durations = [float(action.duration.quantile(q)) for q in (0.1, 0.9)]
            shown_by = people.demonstrations[k][::4]
            played = [(d.positions(np.arange(int(T / 0.1) + 1) * 0.1, T), T) for d in shown_by for T in durations]
            hands, lengths = zip(*played, strict=True)
            alignments = [
                make_alignment(scenario.estimator_of(action.name), reference, 0.1)
                for reference in (people.references[k], usual.reference(action.name))
            ]
            found.append([spread(one.phases(hands), lengths, 0.1) for one in alignments])
    chosen, usual = np.sqrt(np.mean(np.square(found), axis=0))
    assert chosen < 0.8 * usual
