"""The independent check: it agrees with the monitor on distances, and would see a robot that is not monitored."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pace_drake.cli.main import main
from pace_drake.evaluate.separation import (
    CHECK_STEP,
    HAND_MOTIONS,
    SETTLING,
    SeparationBench,
    below_protective,
    hand_motion,
    link_poses,
    longer_than,
    measure_separation,
    run_trial,
    searched_distance,
    time_to_standstill,
)
from pace_drake.safety.proximity import approach
from pace_drake.stations.person import LIMB_RADII, limb_segments


@pytest.fixture(scope="module")
def bench(chair):
    return SeparationBench(chair)


@pytest.fixture(scope="module")
def strict(chair, bench):
    return SeparationBench(replace(chair, safety=replace(chair.safety, contact_speed=0.0)), bench.motions)


def test_distances_by_search_are_those_of_the_monitor(bench):
    rng = np.random.default_rng(0)
    q = bench.motions.home + rng.uniform(-1, 1, (30, 7))
    hands = rng.uniform([0.2, -0.6, 0.0], [1.0, 0.6, 0.8], (30, 3))
    limbs = np.array([limb_segments(p) for p in hands])
    found = searched_distance(bench.arm, q, limbs)
    for k in range(30):
        expected = approach(bench.arm, q[k : k + 1], np.zeros((1, 7)), limbs[k], LIMB_RADII).distance
        np.testing.assert_allclose(found[k], expected, atol=1e-5)


def test_the_check_knows_the_arm_by_itself(bench):
    """The tool centre point at home, as published."""
    X = link_poses(bench.motions.home[np.newaxis])[0, 7]
    np.testing.assert_allclose((X @ [0, 0, 0.107 + 0.1034, 1])[:3], [0.3069, 0.0, 0.4869], atol=1e-3)


def test_hands_are_never_faster_than_the_formulas_assume():
    rng = np.random.default_rng(1)
    for kind in HAND_MOTIONS:
        for _ in range(5):
            target, start = (
                rng.uniform([0.3, -0.5, 0.1], [0.7, 0.5, 0.6]),
                rng.uniform([0.6, -0.5, 0.1], [1.2, 0.5, 0.7]),
            )
            hand = hand_motion(kind, target, start, 1.6, 1.7, rng)
            limbs = np.array([limb_segments(p) for p in hand])
            # Over 20 ms: where the elbow turns over it may be faster for an instant.
            window = 10
            ways = np.linalg.norm(limbs[window:] - limbs[:-window], axis=3)
            speed = ways.max() / (window * CHECK_STEP)
            assert speed <= 1.6 * 1.1
            assert speed > 0.5
            assert np.array_equal(hand[0], hand[round(SETTLING / CHECK_STEP) - 1])


def test_runs_of_instants():
    below = np.array([0, 1, 1, 1, 0, 1, 1], dtype=bool)[:, np.newaxis]
    assert longer_than(below, 2)[:, 0].tolist() == [False, False, False, True, False, False, False]


def test_strictly_monitored_the_robot_never_closes_in_faster_than_allowed(strict):
    result = measure_separation(strict, "strict", 40, 1)
    assert result.violations == 0
    assert result.instants > 20_000
    assert 0.5 < result.share_slowed < 1
    assert result.share_stopped > 0.02
    assert result.distance_error < 1e-3
    assert max(result.closing_speeds) > 0.05


def test_the_check_sees_a_robot_that_nothing_slows(strict, chair):
    """Contacts of any speed allowed: the check by the strict settings finds that the robot is too fast."""
    careless = replace(chair.safety, contact_speed=100.0, stop_distance=0.0, reaction_time=0.3)
    bench = SeparationBench(replace(chair, safety=careless), strict.motions)
    trials = [run_trial(bench, number, 1) for number in range(15)]
    assert sum(int(longer_than(below_protective(trial, strict.config), 50).sum()) for trial in trials) > 100


def test_the_same_seed_gives_the_same_figures(bench):
    first, second = (measure_separation(bench, "scenario", 4, 7) for _ in range(2))
    assert first == second
    assert first != measure_separation(bench, "scenario", 4, 8)


def test_a_stale_hand_stops_the_arm(bench):
    time = time_to_standstill(bench, 0)
    config = bench.config
    assert config.hand_timeout < time <= config.hand_timeout + 2 * config.period + 0.25


def test_a_hand_in_the_path_slows_stops_and_lets_go_on_along_the_same_path(bench):
    """Kinematic closed loop: the gripper's way is the motion's, only later."""
    rng = np.random.default_rng(3)
    far = np.array([3.0, 0.0, 0.5])
    kind, index = next((k, i) for k, i in bench.motions if k == 1)
    bench.start(kind, index, 0.5, rng)
    q_ahead = bench.position_ahead(1.0)
    hand = (link_poses(q_ahead[np.newaxis])[0, 7] @ [0, 0, 0.15, 1])[:3]
    rates, positions = [], []
    for k in range(1200):
        there = 20 <= k < 500
        q, rate, _ = bench.step(hand if there else far)
        positions.append(q)
        rates.append(rate)
        assert bench.output("stop") == 0
    rates, positions = np.concatenate(rates), np.concatenate(positions)
    per_look = len(rates) // 1200
    assert rates[: 20 * per_look].min() == 1
    assert np.all(rates[300 * per_look : 500 * per_look] == 0)
    assert rates[600 * per_look] == 1
    # Not one position off the path: each lies between two finely sampled ones of the motion.
    fine = np.array([bench.motions.position(kind, index, f) for f in np.linspace(0, 1, 20001)])
    for q in positions[::97]:
        assert np.abs(fine - q).max(axis=1).min() < 1e-3


def test_the_command_writes_figures_and_a_page(tmp_path, capsys):
    out, figures = tmp_path / "report", tmp_path / "figures.json"
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", "safety", "--motions", "5", "--out", str(out), "--json", str(figures)])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert "violations" in text
    content = json.loads(figures.read_text())
    assert [r["name"] for r in content["results"]] == ["strict", "scenario"]
    assert len(content["results"][0]["least_distances"]) == 5
    page = (out / "index.html").read_text()
    assert "SYNTHETIC" in page
    assert "pace evaluate safety ikea_chair --motions 5 --seed 0" in page
    assert (out / "separation.png").stat().st_size > 5000
