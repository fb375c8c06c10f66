"""The plant level with cameras: each action looks once, and nothing else changes by it."""

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.stations.components import component_names
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from tests.rendering import require_opencv, require_rendering


@pytest.fixture(scope="module")
def motions(chair):
    return plan_motions(chair.workcell, chair.task.num_robot_tasks, chair.task.num_joint_actions)


def simulate(perception, motions, until):
    """Times, ages and poses at every half second."""
    scenario = load_scenario("ikea_chair", (f"perception={perception}",))
    station = make_plant_station(scenario.workcell, cameras=perception == "cameras")
    policy = make_policy("learned", scenario)
    simulation = Simulation(Assembly(scenario, policy, station=station, motions=motions))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    ages, poses, commands = [], [], []
    for time in np.arange(0.5, until, 0.5):
        assert simulation.advance(time) == Stop.BOUNDARY
        ages.append(simulation.output("component_ages").copy())
        poses.append(simulation.output("component_poses").reshape(-1, 7).copy())
        commands.append(simulation.output("robot_action").copy())
    return np.array(ages), np.array(poses), np.array(commands)


def test_cameras_see_what_is_true_at_each_new_action(chair, motions):
    require_rendering()
    require_opencv()
    ages, poses, commands = simulate("cameras", motions, 12.0)
    no_ages, true_poses, same_commands = simulate("true_poses", motions, 12.0)
    np.testing.assert_equal(commands, same_commands)
    assert np.all(no_ages == 0.0)
    names = component_names(chair.workcell)
    looked = {"cube": 1, "chair_side": 2, "allen_key": 2}
    for k, name in enumerate(names):
        kind = looked[name.rstrip("0123456789").rstrip("_")]
        first = int(np.argmax(commands[:, 0] == kind))
        assert np.all(np.isinf(ages[:first, k]))
        assert ages[first, k] <= 0.5
        np.testing.assert_allclose(poses[first, k, 4:], true_poses[first, k, 4:], atol=1e-3)
        np.testing.assert_allclose(np.abs(poses[first, k, :4]), np.abs(true_poses[first, k, :4]), atol=0.02)
    assert np.all(np.isfinite(ages[-1]))


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
