"""The plant level with cameras: each action looks once, and nothing else changes by it."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation
from pace_drake.stations.components import component_index
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.task import ActionKind
from tests.rendering import require_opencv, require_rendering


@pytest.fixture(scope="module")
def motions(chair):
    return plan_motions(chair.workcell, chair.task.num_robot_tasks, chair.task.num_joint_actions)


def test_cameras_see_what_is_true_at_each_new_action_and_nothing_else_changes(chair, motions):
    require_rendering()
    require_opencv()
    commands, simulations = [], []
    for perception in ("true_poses", "cameras"):
        scenario = load_scenario("ikea_chair", (f"perception={perception}",))
        station = make_plant_station(scenario.workcell, cameras=perception == "cameras")
        policy = make_policy("never_assist", scenario)
        simulations.append(Simulation(Assembly(scenario, policy, station=station, motions=motions)))
        simulation = simulations[-1]
        layout = simulation.sample_layout(np.random.default_rng(1))
        simulation.reset(simulation.sample_episode(np.random.default_rng(0)), layout)
        commands.append([])
        looked = set()
        while simulation.time < 12.0:
            simulation.advance(simulation.time + 0.5)
            commands[-1].append(simulation.output("robot_action").copy())
            if perception == "true_poses":
                continue
            ages = simulation.output("located_component_ages")
            fetched = component_index(chair.workcell, *map(int, commands[-1][-1][:2]))
            if fetched is not None and ages[fetched] < 0.55:
                looked.add(fetched)
                seen = simulation.output("located_component_poses").reshape(-1, 7)[fetched]
                # The arm has hardly begun to move: the component lies where it was seen.
                true = simulation.output("component_poses").reshape(-1, 7)[fetched]
                np.testing.assert_allclose(seen[4:], true[4:], atol=1.5e-3)
                np.testing.assert_allclose(abs(seen[:4] @ true[:4]), 1.0, atol=1e-3)
    assert len(looked) >= 2
    np.testing.assert_array_equal(commands[0], commands[1])


def test_what_is_not_seen_is_not_fetched_and_is_as_soon_as_it_is_seen(chair, motions):
    """A cube is hidden below the table: the robot waits for it, at home, and looks again and again."""
    require_rendering()
    require_opencv()
    scenario = load_scenario("ikea_chair", ("perception=cameras",))
    station = make_plant_station(scenario.workcell, cameras=True)
    simulation = Simulation(Assembly(scenario, make_policy("never_assist", scenario), station=station, motions=motions))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    kind, index, _ = simulation.output("robot_action")
    cube = component_index(chair.workcell, ActionKind.ROBOT_TASK, 1)
    plant_context = station.plant.GetMyMutableContextFromRoot(simulation.context)
    body = station.plant.GetBodyByName("cube", station.plant.GetModelInstanceByName("cube_1"))
    # Face down, its tag cannot be seen.
    X_WO = station.component_pose(simulation.context, cube)
    face_down = X_WO @ RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [0.0, 0.0, 0.0])
    station.plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, face_down)
    simulation.advance(3.0)
    kind, index, _ = simulation.output("robot_action")
    assert (kind, index) == (ActionKind.ROBOT_TASK, 1)
    np.testing.assert_allclose(simulation.output("panda.position_measured"), chair.workcell.home, atol=1e-3)
    assert np.isinf(simulation.output("located_component_ages")[cube])
    station.plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, body, X_WO)
    simulation.advance(5.0)
    assert np.max(np.abs(simulation.output("panda.position_measured") - chair.workcell.home)) > 0.1


def test_cameras_need_a_station_that_has_some(motions):
    require_opencv()
    scenario = load_scenario("ikea_chair", ("perception=cameras",))
    station = make_plant_station(scenario.workcell)
    with pytest.raises(InputError, match="needs a station with sorting_camera"):
        Assembly(scenario, make_policy("never_assist", scenario), station=station, motions=motions)


def test_cameras_that_are_needed_must_be_enabled(motions):
    require_opencv()
    overrides = ("perception=cameras", "workcell.cameras.sorting_camera.enabled=false")
    scenario = load_scenario("ikea_chair", overrides)
    with pytest.raises(InputError, match=r"workcell\.cameras\.sorting_camera: must be there and enabled"):
        Assembly(
            scenario,
            make_policy("never_assist", scenario),
            station=make_plant_station(scenario.workcell),
            motions=motions,
        )


def test_perception_is_checked():
    with pytest.raises(InputError, match="perception: must be one of true_poses, cameras"):
        load_scenario("ikea_chair", ("perception=eyes",))
