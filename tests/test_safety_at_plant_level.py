"""The safety monitor in the whole diagram: hand signals that go stale, operators, hands in the path."""

import json
import re

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.evaluate.workcell import WorkcellRecorder
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from tests.cli.test_run import pace


@pytest.fixture(scope="module")
def simulation(chair):
    motions = plan_motions(chair.workcell, chair.task.num_robot_tasks, chair.task.num_joint_actions)
    policy = make_policy("never_assist", chair)
    return Simulation(Assembly(chair, policy, station=make_plant_station(chair.workcell), motions=motions))


@pytest.fixture
def started(simulation):
    for name in ("stop", "ack", "hand_age"):
        simulation.assembly.GetInputPort(name).FixValue(simulation.context, [0.0])
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    simulation.advance(2.0)
    return simulation


def reaching_hand(path, times, shares):
    """Records a hand over the assembly table that reaches over the sorting table, by shares of the way."""
    away, there = np.array([0.95, 0.10, 0.25]), np.array([0.38, -0.42, 0.22])
    t = np.arange(0.0, 30.05, 0.1)
    p_WH = away + np.interp(t, times, shares)[:, None] * (there - away)
    rows = [f"{t:.1f},{x:.4f},{y:.4f},{z:.4f}" for t, (x, y, z) in zip(t, p_WH, strict=True)]
    path.write_text("\n".join(["time,x,y,z", *rows]) + "\n")
    return path


def hand_played(path):
    return (
        f"human.demonstrations={path}",
        "human.workplace=[]",
        "human.pace_correlation=0",
        "task.human_actions.0.duration={mean: 30, cv: 0}",
        "policy=never_assist",
    )


@pytest.fixture
def resting_hand(tmp_path):
    return reaching_hand(tmp_path / "hand.csv", [2.5, 4.0], [0.0, 1.0])


def put(simulation, **values):
    for name, value in values.items():
        simulation.assembly.GetInputPort(name).FixValue(simulation.context, [value])


def test_the_monitor_is_wired(started):
    assert started.output("speed_scale")[0] == 1
    assert 0.1 < started.output("hand_distance")[0] < 1.5
    assert started.output("safety_stop")[0] == 0


def test_a_stale_hand_stops_the_robot_until_the_operator_acknowledges(started):
    kind = started.output("robot_action")[0]
    put(started, hand_age=0.3)
    started.advance(started.time + 0.011)
    assert started.output("robot_action")[0] == 6  # HOLD: the chart knows within a period
    started.advance(3.0)
    held = started.output("panda.position_measured").copy()
    put(started, hand_age=0.0)
    started.advance(4.0)
    assert started.output("robot_action")[0] == 6  # the signal is back, and nothing moves
    np.testing.assert_allclose(started.output("panda.position_measured"), held, atol=2e-3)
    put(started, ack=1.0)
    started.interrupt()
    started.advance(started.time + 0.03)
    assert started.output("robot_action")[0] == kind
    started.advance(5.0)
    assert np.max(np.abs(started.output("panda.position_measured") - held)) > 0.02


def test_the_operators_stop_still_stops(started):
    put(started, stop=1.0)
    started.interrupt()
    started.advance(2.5)
    assert started.output("robot_action")[0] == 6
    assert started.output("safety_stop")[0] == 1
    put(started, stop=0.0, ack=1.0)
    started.interrupt()
    started.advance(2.6)
    assert started.output("robot_action")[0] != 6


def test_an_episode_whose_robot_waits_for_an_acknowledgement_does_not_run_for_ever(started):
    put(started, hand_age=0.3)
    assert started.run(max_time=8.0) is False
    assert started.truncation == "after 8 s; the robot was stopped, waiting for ack, for the last 6 s"


def test_nor_does_one_in_which_a_hand_rests_near_the_path(resting_hand):
    scenario = load_scenario("ikea_chair", (*hand_played(resting_hand), "max_time=15"))
    motions = plan_motions(scenario.workcell, scenario.task.num_robot_tasks, scenario.task.num_joint_actions)
    station = make_plant_station(scenario.workcell)
    policy = make_policy("never_assist", scenario)
    simulation = Simulation(Assembly(scenario, policy, station=station, motions=motions))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    assert simulation.run(period=0.5) is False
    assert simulation.time == 15.0
    why = re.fullmatch(r"after 15 s; the robot was held by the hand for the last (\d+) s", simulation.truncation)
    assert 5 <= int(why[1]) <= 13


def test_pace_run_says_that_the_hand_held_the_robot(resting_hand, tmp_path, capsys):
    out = tmp_path / "out"
    overrides = [argument for value in (*hand_played(resting_hand), "max_time=15") for argument in ("--set", value)]
    assert pace("run", "--out", out, *overrides) == 0
    (episode,) = json.loads((out / "summary.json").read_text())["episodes"]
    assert episode["finished"] is False
    assert episode["duration"] == 15.0
    assert "the robot was held by the hand for the last" in episode["truncation"]
    printed = " ".join(capsys.readouterr().out.split())
    assert f"1 of 1 episodes truncated {episode['truncation']}" in printed


def test_a_person_who_reaches_into_the_path_slows_and_stops_the_robot_and_nothing_is_dropped(tmp_path):
    """A hand that comes over the sorting table while a cube is carried there, stays, and goes again."""
    hand = reaching_hand(tmp_path / "hand.csv", [2.5, 4.0, 9.0, 10.5], [0.0, 1.0, 1.0, 0.0])
    scenario = load_scenario("ikea_chair", hand_played(hand))
    motions = plan_motions(scenario.workcell, scenario.task.num_robot_tasks, scenario.task.num_joint_actions)
    station = make_plant_station(scenario.workcell)
    policy = make_policy("never_assist", scenario)
    simulation = Simulation(Assembly(scenario, policy, station=station, motions=motions))
    recorder = WorkcellRecorder()
    simulation.listeners = (recorder,)
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    scales, distances, moved = [], [], []
    before = simulation.output("panda.position_measured").copy()
    while simulation.time < 24.0:
        simulation.advance(simulation.time + 0.1)
        now = simulation.output("panda.position_measured").copy()
        scales.append(simulation.output("speed_scale")[0])
        distances.append(simulation.output("hand_distance")[0])
        moved.append(np.max(np.abs(now - before)))
        before = now
    scales, distances, moved = np.array(scales), np.array(distances), np.array(moved)
    assert np.all(scales[:20] == 1.0)
    assert np.any((scales > 0.0) & (scales < 1.0))  # it slows
    assert scales.min() == pytest.approx(0.0, abs=0.05)  # it stops
    assert np.max(moved[60:88]) < 0.01
    assert np.all(scales[120:] > 0.5)  # it goes on by itself
    assert np.mean(scales[120:]) > 0.95
    assert simulation.output("safety_stop")[0] == 0.0
    assert len(recorder.sorts) >= 2
    assert all(sort.good for sort in recorder.sorts)  # and the cube that it held is in its tray
    assert distances.min() > 0.03
