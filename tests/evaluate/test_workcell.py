"""play_workcell: a short assembly with the whole plant, its figures, and that they can be bad."""

import gc
import json
from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from pace_drake.diagram import FULL_LOG, JOINT_LOG, Assembly
from pace_drake.errors import InputError
from pace_drake.evaluate.plant_log import LimitsKept, PlantLog
from pace_drake.evaluate.workcell import (
    Command,
    Sort,
    WorkcellEpisode,
    WorkcellRecorder,
    play_workcell,
    summarize,
    table,
    with_durations,
)
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.task import ActionKind, Episode
from tests.cli.test_run import pace

#: The person hurries: a minute and a half in all.
SHORT = (
    "policy=phase_threshold",
    "task.human_actions.0.duration.mean=12",
    "task.human_actions.1.duration.mean=9",
    "task.human_actions.2.duration.mean=9",
    "task.human_actions.3.duration.mean=7",
    "task.human_actions.4.duration.mean=12",
    "task.human_actions.5.duration.mean=7",
)


@pytest.fixture(scope="module")
def simulations():
    """(with the plant, at the task level)."""
    scenario = load_scenario("ikea_chair", SHORT)
    task, policy = scenario.task, make_policy(scenario.policy, scenario)
    motions = plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
    station = make_plant_station(scenario.workcell)
    plant = Assembly(scenario, policy, station=station, motions=motions, logged=FULL_LOG)
    return Simulation(plant), Simulation(Assembly(scenario, policy, people=plant.people))


@pytest.fixture(scope="module")
def played(simulations):
    (episode,) = play_workcell(*simulations, seed=0, numbers=[0])
    return episode


@pytest.mark.slow
def test_the_robot_does_what_the_task_level_says(played, simulations):
    assert played.finished
    assert played.seed == (0, 0)
    assert 30 < played.duration < 120
    assert len(played.sorts) >= 2
    for sort in played.sorts:
        assert sort.good, sort
    assert [sort.robot_task for sort in played.sorts] == [1 + k % 4 for k in range(len(played.sorts))]
    assert played.joint_actions == 3
    assert played.side_error < 0.01
    assert played.keys_taken == 2
    # The hand was near in the hand-overs, never in the arm; and at every look it was known.
    plant, _ = simulations
    log = PlantLog.of(plant)
    assert played.hand_distance == log.hand_distance.min()
    assert 0.0 < played.hand_distance < 0.1
    assert played.slowed == np.mean(log.speed_scale < 1)
    assert np.diff(log.look_time) == pytest.approx(plant.assembly.scenario.safety.period)
    assert played.same_decisions
    # That says something: the task level did decide, both ways.
    _, task = simulations
    (recorder,) = task.listeners
    assert {answer for _, _, answer in recorder.decisions} == {0, 1}
    assert len(recorder.decisions) >= 5


@pytest.mark.slow
def test_every_limit_is_kept_at_every_step(played, simulations):
    limits = played.limits
    assert limits.kept
    assert limits.penetration < 2e-3
    assert limits.tracking < 0.02
    assert limits.velocity > 0.3  # it did move
    plant, _ = simulations
    log = plant.assembly.plant_log["position_desired"].FindLog(plant.context)
    assert np.diff(log.sample_times()) == pytest.approx(plant.assembly.scenario.workcell.time_step)


@pytest.mark.slow
def test_a_cube_moved_away_makes_the_sort_bad(simulations):
    plant, _ = simulations
    station = plant.assembly.station
    moved = []

    def take_away(simulation, before):
        done = simulation.assembly.robot_action.GetOutputPort("motion_done")
        context = simulation.assembly.robot_action.GetMyContextFromRoot(simulation.context)
        if before and not moved and done.Eval(context)[0] == 1:
            body = station.plant.GetBodyByName("cube", station.plant.GetModelInstanceByName("cube_1"))
            plant_context = station.plant.GetMyMutableContextFromRoot(simulation.context)
            X_WO = RigidTransform([0.0, 0.02, 0.0]) @ station.component_pose(simulation.context, 0)
            station.plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WO)
            moved.append(X_WO)

    recorder = WorkcellRecorder()
    plant.listeners = (take_away, recorder)
    plant.reset(plant.sample_episode(np.random.default_rng([0, 0])))
    plant.advance(15.0)
    assert moved
    sort = recorder.sorts[0]
    assert not sort.good
    assert sort.error == pytest.approx(0.02, abs=0.01)


def test_no_log_is_held_through_the_next_episode(simulations, monkeypatch):
    plant, task = simulations
    monkeypatch.setattr(plant, "run", lambda: plant.advance(1.0) == Stop.FINISHED)
    episodes = play_workcell(plant, task, seed=0, numbers=[0, 1])
    assert not next(episodes).finished
    assert not [one for one in gc.get_objects() if isinstance(one, PlantLog)]


@pytest.mark.slow
def test_the_command_prints_and_writes_the_figures(tmp_path, capsys):
    overrides = [
        argument for value in (*SHORT, "task.human_actions.0.duration.mean=6") for argument in ("--set", value)
    ]
    assert pace("evaluate", "workcell", "--episodes", 1, "--seed", 1, *overrides, "--json", tmp_path / "f.json") == 0
    summary = json.loads((tmp_path / "f.json").read_text())
    assert summary["episodes"] == summary["finished"] == len(summary["each"]) == 1
    assert summary["sorts"] == summary["good_sorts"] > 0
    assert summary["joint_actions"] == summary["joint_actions_due"] == 3
    assert summary["limits_kept"] == summary["same_decisions_as_task_level"] == summary["sides_placed"] == 1
    assert summary["keys_taken"] == 2
    assert summary["largest_penetration"] < 2e-3
    printed = capsys.readouterr().out
    assert f"{summary['good_sorts']} of {summary['sorts']}" in printed
    assert "SYNTHETIC" in printed


def test_a_file_in_no_folder_is_refused_before_anything_is_played(tmp_path, capsys):
    assert pace("evaluate", "workcell", "--json", tmp_path / "none" / "f.json") == 2
    assert "no such folder" in capsys.readouterr().err


def test_a_plant_whose_contacts_are_not_logged_is_refused(simulations):
    _, task = simulations
    scenario, policy = task.assembly.scenario, make_policy("never_assist", task.assembly.scenario)
    half_logged = Assembly(
        scenario,
        policy,
        station=make_plant_station(scenario.workcell),
        motions=plan_motions(scenario.workcell, scenario.task.num_robot_tasks, scenario.task.num_joint_actions),
        people=task.assembly.people,
        logged=JOINT_LOG,
    )
    for simulation in (task, Simulation(half_logged)):
        with pytest.raises(InputError, match="logged=FULL_LOG"):
            next(play_workcell(simulation, task, 0, [0]))


# ---- figures


@pytest.mark.parametrize(
    ("error", "height", "good"), [(0.0, 0.03, True), (0.0149, 0.03, True), (0.0151, 0.03, False), (0.0, 0.06, False)]
)
def test_what_a_good_sort_is(error, height, good):
    assert Sort(1.0, 1, error, height).good == good


def test_with_durations_puts_each_command_s_time_where_it_was_drawn():
    drawn = Episode(np.arange(6.0), np.zeros(6), np.full((256, 4), 8.0), np.full(3, 9.0), np.full(3, 7.0))
    commands = [
        Command(ActionKind.ROBOT_TASK, 2, 3, 8.5),
        Command(ActionKind.PREPARE, 2, 4, 9.5),
        Command(ActionKind.JOINT, 2, 5, 10.5),
        Command(ActionKind.HOME, 2, 6, 7.5),
        Command(ActionKind.HOME_ABORTED, 3, 7, 6.5),
        Command(ActionKind.ROBOT_TASK, 4, 257, 8.25),
    ]
    episode = with_durations(drawn, commands)
    assert np.argwhere(episode.robot != 8.0).tolist() == [[0, 3], [2, 1]]
    assert (episode.robot[2, 1], episode.robot[0, 3]) == (8.5, 8.25)
    assert episode.preparation.tolist() == [9.0, 9.5, 9.0]
    assert episode.homing.tolist() == [7.0, 7.5, 6.5]
    np.testing.assert_array_equal(episode.human, drawn.human)  # the person's own
    assert np.all(drawn.robot == 8.0)  # the drawn one is as it was


GOOD = LimitsKept(position=0.2, velocity=0.8, acceleration=0.6, tracking=0.01, penetration=5e-4, self_contacts=0)


def made_up(number, **values):
    episode = WorkcellEpisode(
        seed=(0, number),
        finished=True,
        duration=100.0,
        real_time_factor=4.0,
        cpu_real_time_factor=5.0,
        sorts=[Sort(10.0, 1, 0.001, 0.026), Sort(20.0, 2, 0.003, 0.026)],
        joint_actions=3,
        side_error=0.002,
        keys_taken=2,
        limits=GOOD,
        hand_distance=0.2,
        slowed=0.1,
        same_decisions=True,
        memory=2**30,
    )
    return replace(episode, **values)


def test_the_summary_counts_and_takes_the_worst():
    bad = made_up(
        1,
        finished=False,
        duration=50.0,
        real_time_factor=1.0,
        sorts=[Sort(10.0, 1, 0.2, 0.026)],
        joint_actions=2,
        side_error=0.3,
        keys_taken=1,
        limits=LimitsKept(-0.1, 1.2, 0.7, 0.02, 3e-3, 4),
        same_decisions=False,
        memory=2**30 + 2**20,
    )
    summary = summarize([made_up(0), bad], 3)
    assert summary["episodes"] == 2
    assert summary["finished"] == summary["limits_kept"] == summary["sides_placed"] == 1
    assert summary["same_decisions_as_task_level"] == 1
    assert (summary["good_sorts"], summary["sorts"]) == (2, 3)
    assert summary["sort_error"] == {"median": 0.003, "largest": 0.2}
    assert (summary["joint_actions"], summary["joint_actions_due"]) == (5, 6)
    assert summary["keys_taken"] == 3
    assert summary["simulated"] == 150.0
    assert summary["real_time_factor"] == pytest.approx(150 / (100 / 4 + 50 / 1))
    assert summary["cpu_real_time_factor"] == pytest.approx(5.0)
    assert summary["largest_side_error"] == 0.3
    assert summary["least_distance_from_a_position_limit"] == -0.1
    assert summary["largest_share_of_velocity_limit"] == 1.2
    assert summary["largest_share_of_acceleration_limit"] == 0.7
    assert summary["largest_tracking_error"] == 0.02
    assert summary["largest_penetration"] == 3e-3
    assert summary["self_contacts"] == 4
    assert summary["memory_growth_after_the_first"] == 2**20
    assert json.loads(json.dumps(summary, allow_nan=False))["each"][1]["sorts"][0]["error"] == 0.2


def test_the_nearest_hand_and_the_slowest_episode_are_named():
    summary = summarize([made_up(0), made_up(1, hand_distance=0.1), made_up(2, slowed=0.3)], 3)
    assert (summary["least_hand_distance"], summary["slowed"]) == (0.1, 0.3)
    row = next(value for name, value in table(summary).rows if "hand;" in name)
    assert row == "0.100 m, 30 %"
    unseen = summarize([made_up(0, hand_distance=None, slowed=None)], 3)
    assert next(value for name, value in table(unseen).rows if "hand;" in name) == "not monitored"


def test_the_table_says_what_the_summary_does():
    rows = dict(table(summarize([made_up(0), made_up(1, finished=False)], 3)).rows)
    assert rows["episodes finished"] == "1 of 2"
    assert rows["cubes in the right tray, at most 15 mm off its middle"] == "4 of 4"
    assert rows["joint actions done"] == "6 of 6"
    assert rows["largest penetration"] == "0.50 mm"


def test_an_episode_without_sorts_has_no_error():
    summary = summarize([made_up(0, sorts=[])], 3)
    assert summary["sort_error"] is None
    assert (summary["good_sorts"], summary["sorts"]) == (0, 0)
    json.dumps(summary, allow_nan=False)
    assert table(summary).rows
