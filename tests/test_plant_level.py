"""The plant level: the Panda moves, and nothing in the logic changes by it."""

import json

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.stations.components import component_index, flat
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.task import ActionKind
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


# ---- components: where they lie, stops, aborted assistance


@pytest.fixture(scope="module")
def sorting(chair, motions):
    """The robot only sorts."""
    station = make_plant_station(chair.workcell)
    return Simulation(Assembly(chair, make_policy("never_assist", chair), station=station, motions=motions))


def with_layout(simulation, seed):
    episode = simulation.sample_episode(np.random.default_rng(seed))
    layout = simulation.sample_layout(np.random.default_rng([seed, 1]))
    for name in ("stop", "ack"):
        simulation.assembly.GetInputPort(name).FixValue(simulation.context, 0.0)
    simulation.reset(episode, layout)
    return layout


def test_an_episode_begins_with_its_layout(sorting):
    for seed in (1, 2):
        layout = with_layout(sorting, seed)
        for k, located in enumerate(layout.located):
            X_WO = sorting.assembly.station.component_pose(sorting.context, k)
            np.testing.assert_allclose(flat(X_WO), located, atol=1e-12)


@pytest.mark.slow
def test_a_stop_while_a_cube_is_carried_drops_nothing_and_the_sort_is_finished(sorting):
    with_layout(sorting, 1)
    station, operator = sorting.assembly.station, sorting.assembly.GetInputPort

    def height():
        return station.component_pose(sorting.context, 0).translation()[2]

    while height() < 0.09:  # until the cube is up
        assert sorting.advance(sorting.time + 0.1) == Stop.BOUNDARY
        assert sorting.time < 8.0
    operator("stop").FixValue(sorting.context, 1.0)
    sorting.interrupt()
    sorting.advance(sorting.time + 0.5)
    X_WO = station.component_pose(sorting.context, 0)
    assert X_WO.translation()[2] > 0.09
    sorting.advance(sorting.time + 3.0)
    # It hangs where it was when the arm came to rest, 2 mm of slip at most.
    assert np.linalg.norm(station.component_pose(sorting.context, 0).translation() - X_WO.translation()) < 2e-3
    operator("stop").FixValue(sorting.context, 0.0)
    operator("ack").FixValue(sorting.context, 1.0)
    sorting.interrupt()
    sorting.advance(sorting.time + 0.1)
    operator("ack").FixValue(sorting.context, 0.0)
    tray = sorting.assembly.scenario.workcell.trays[0].to_rigid_transform()

    def in_tray():
        return (tray.inverse() @ station.component_pose(sorting.context, 0)).translation()

    while np.hypot(*in_tray()[:2]) > 0.03:  # on the way it is not put down, nor fetched again
        assert height() > 0.08
        assert sorting.advance(sorting.time + 0.05) == Stop.BOUNDARY
        assert sorting.time < 20.0
    while sorting.output("robot_task")[0] == 1:
        assert sorting.advance(sorting.time + 0.2) == Stop.BOUNDARY
        assert sorting.time < 20.0
    p_TrayO = in_tray()
    assert np.hypot(*p_TrayO[:2]) < 0.015
    assert p_TrayO[2] < 0.05


@pytest.mark.slow
def test_what_follows_a_reset_is_that_of_a_fresh_simulation_bit_for_bit(sorting):
    """After an episode in which a cube was moved."""
    with_layout(sorting, 1)
    sorting.advance(9.0)
    fresh = Simulation(sorting.assembly)
    states = []
    for simulation in (sorting, fresh):
        with_layout(simulation, 5)
        simulation.advance(9.0)
        states.append(simulation.context.Clone())
    vectors = [
        np.concatenate([context.get_discrete_state(k).value() for k in range(context.num_discrete_state_groups())])
        for context in states
    ]
    np.testing.assert_array_equal(*vectors)


@pytest.mark.slow
@pytest.mark.parametrize("joint_action", [1, 2])
def test_an_aborted_assistance_takes_the_component_back_to_its_table(motions, joint_action):
    """The robot is ready long before the person, and does not wait."""
    overrides = ["wait_timeout=2", "decide_at_start=true"]
    if joint_action == 2:
        # Past the first joint action at once, then a long action.
        overrides += ["task.human_actions.0.duration.mean=5", "task.human_actions.2.duration.mean=90"]
    else:
        overrides += ["task.human_actions.0.duration.mean=90"]
    scenario = load_scenario("ikea_chair", tuple(overrides))
    station = make_plant_station(scenario.workcell)
    simulation = Simulation(
        Assembly(scenario, make_policy("always_assist", scenario), station=station, motions=motions)
    )
    with_layout(simulation, 1)
    component = component_index(scenario.workcell, ActionKind.PREPARE, joint_action)

    def until(kind, latest):
        while tuple(simulation.output("robot_action")[:2]) != (kind, joint_action):
            assert simulation.advance(simulation.time + 0.2) == Stop.BOUNDARY
            assert simulation.time < latest

    until(ActionKind.HOME_ABORTED, 80.0)
    begun = simulation.time
    assert station.component_pose(simulation.context, component).translation()[2] > 0.2  # it has it
    while simulation.output("robot_action")[0] == ActionKind.HOME_ABORTED:
        assert simulation.advance(simulation.time + 0.2) == Stop.BOUNDARY
        assert simulation.time < begun + 20.0
    X_WO = station.component_pose(simulation.context, component)
    nominal = station.components[component].nominal.to_rigid_transform()
    assert X_WO.translation()[2] == pytest.approx(nominal.translation()[2], abs=3e-3)
    np.testing.assert_allclose(X_WO.translation()[:2], nominal.translation()[:2], atol=0.01)
    assert X_WO.rotation().matrix()[2, 2] > 0.999  # it lies flat
    assert not np.any(simulation.output("key_taken"))
    # And it can be fetched from there again.
    until(ActionKind.PREPARE, begun + 25.0)
    until(ActionKind.HOME_ABORTED, begun + 45.0)
    assert station.component_pose(simulation.context, component).translation()[2] > 0.2
