"""The plant level: the Panda moves, and nothing in the logic changes by it."""

import json

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from tests.cli.test_run import pace

#: Limits of the Panda (FER): position [rad] and velocity [rad/s].
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
SPEED = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])


@pytest.fixture(scope="module")
def motions(chair):
    return plan_motions(chair.workcell, chair.task.num_robot_tasks, chair.task.num_joint_actions)


def test_plant_and_task_level_give_the_same_events(tmp_path):
    short = ["--set", "task.human_actions.4.duration.mean=18", "--policy", "phase_threshold", "--seed", "3"]
    for level in ("plant", "task"):
        assert pace("run", "--level", level, *short, "--out", tmp_path / level) == 0
    events = [(tmp_path / level / "events.csv").read_bytes() for level in ("plant", "task")]
    assert len(events[0].splitlines()) > 50
    assert events[0] == events[1]  # decisions, order and times, bit for bit
    replay = (tmp_path / "plant" / "replay.html").read_text()
    assert "<html" in replay[:200].lower()
    assert len(replay) > 1_000_000
    summary = json.loads((tmp_path / "plant" / "summary.json").read_text())
    assert summary["level"] == "plant"
    assert summary["mean"]["real_time_factor"] > 0


def test_the_arm_follows_within_its_limits_and_never_jumps(chair, motions):
    policy = make_policy("always_assist", chair)
    simulation = Simulation(Assembly(chair, policy, station=make_plant_station(chair.workcell), motions=motions))
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    robot_action = simulation.assembly.robot_action
    port, context = robot_action.GetOutputPort("position"), robot_action.GetMyContextFromRoot(simulation.context)
    commanded = [port.Eval(context).copy()]
    step = 0.02
    kinds = set()
    while simulation.time < 45.0:
        assert simulation.advance(simulation.time + step) == Stop.BOUNDARY
        commanded.append(port.Eval(context).copy())
        kinds.add(int(simulation.output("robot_action")[0]))
        measured = simulation.output("panda.position_measured")
        assert np.max(np.abs(measured - commanded[-1])) < 0.02
        assert np.all(measured > LOWER)
        assert np.all(measured < UPPER)
        assert np.all(np.abs(simulation.output("panda.velocity_estimated")) < SPEED)
    assert kinds >= {2, 3, 4}  # prepare, joint, home
    moved = np.abs(np.diff(commanded, axis=0))
    assert np.max(moved) > 0.005
    assert np.all(moved <= SPEED * step)


def test_a_stopped_arm_stands_still_and_goes_on(chair, motions):
    simulation = Simulation(
        Assembly(chair, make_policy("never_assist", chair), station=make_plant_station(chair.workcell), motions=motions)
    )
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    simulation.advance(3.0)
    operator = {name: simulation.assembly.GetInputPort(name) for name in ("stop", "ack")}
    operator["stop"].FixValue(simulation.context, 1.0)
    simulation.interrupt()
    simulation.advance(4.0)
    held = simulation.output("panda.position_measured").copy()
    simulation.advance(6.0)
    np.testing.assert_allclose(simulation.output("panda.position_measured"), held, atol=2e-3)
    operator["stop"].FixValue(simulation.context, 0.0)
    operator["ack"].FixValue(simulation.context, 1.0)
    simulation.interrupt()
    simulation.advance(6.5)
    assert np.max(np.abs(simulation.output("panda.position_measured") - held)) > 0.02


def test_motions_are_never_played_faster_than_the_limits(motions):
    """Every drawn duration of the chair is longer than the motion needs."""
    scenario = load_scenario("ikea_chair")
    task = scenario.task
    for kind, index in motions:
        drawn = {
            1: lambda i: task.robot_tasks[i - 1].duration,
            2: lambda k: task.assistances[k - 1].preparation,
            3: lambda k: task.human_actions[task.human_index_of_joint[k - 1] - 1].duration,
            4: lambda k: task.assistances[k - 1].homing,
            5: lambda k: task.assistances[k - 1].homing,
        }[int(kind)](index)
        assert drawn.minimum >= motions.minimum_duration(kind, index)
