"""PlantLog and check_limits, on made-up logs: each figure is that of what was passed, and nothing else."""

import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest

from pace_drake.diagram import FULL_LOG, Assembly
from pace_drake.evaluate.plant_log import PlantLog, check_limits
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.stations.workcell import Workcell

#: The Panda's (FER) limits.
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
SPEED = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
STEP = Workcell().time_step
STEPS = 20
LOGGED = ("time", "position_desired", "position", "velocity", "gripper", "contact")


@pytest.fixture(scope="module")
def station():
    return make_plant_station(Workcell())


@pytest.fixture(scope="module")
def logged_simulation(chair, chair_people):
    """A second of an episode."""
    workcell = chair.workcell
    motions = plan_motions(workcell, chair.task.num_robot_tasks, chair.task.num_joint_actions)
    parts = {"station": make_plant_station(workcell), "motions": motions, "people": chair_people}
    simulation = Simulation(Assembly(chair, make_policy("never_assist", chair), **parts, logged=FULL_LOG))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    simulation.advance(1.0)
    return simulation


@pytest.fixture
def still():
    """The arm rests at home."""
    home = np.tile(Workcell().home, (STEPS, 1))
    return PlantLog(
        time=STEP * np.arange(STEPS),
        position_desired=home,
        position=home.copy(),
        velocity=np.zeros((STEPS, 7)),
        gripper=np.tile([0.06, 0.0], (STEPS, 1)),
        contact=np.zeros((STEPS, 2)),
    )


def changed(log, name, step, column, value):
    array = getattr(log, name).copy()
    array[step, column] = value
    return replace(log, **{name: array})


def test_limits_are_checked_in_a_fraction_of_the_log_s_memory(station, still):
    """Else the heap grows by every episode that is longer than those before."""
    steps = 20_000
    log = PlantLog(**{name: np.repeat(getattr(still, name)[:1], steps, axis=0) for name in LOGGED})
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        check_limits(log, station)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak - before < log.position.nbytes


def test_a_log_that_is_not_a_copy_is_the_simulation_s_own(logged_simulation):
    own, other, copied = (PlantLog.of(logged_simulation, copy=copy) for copy in (False, False, True))
    assert len(own.time) > 10
    for name in ("position_desired", "position", "velocity", "gripper", "contact", "hand_distance", "speed_scale"):
        assert np.shares_memory(getattr(own, name), getattr(other, name))
        assert not np.shares_memory(getattr(own, name), getattr(copied, name))
        np.testing.assert_array_equal(getattr(own, name), getattr(copied, name))


def test_an_arm_at_rest_keeps_every_limit(station, still):
    limits = check_limits(still, station)
    assert limits.kept
    home = np.array(Workcell().home)
    assert limits.position == pytest.approx(np.min(np.minimum(home - LOWER, UPPER - home)))
    assert (limits.velocity, limits.acceleration, limits.tracking, limits.penetration) == (0, 0, 0, 0)
    assert limits.self_contacts == 0


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("side", [-1, 1])
def test_the_least_distance_from_a_position_limit(station, still, joint, side):
    limit = LOWER[joint] if side < 0 else UPPER[joint]
    for inside in (0.01, -0.01):
        log = changed(still, "position", 7, joint, limit - side * inside)
        limits = check_limits(log, station)
        assert limits.position == pytest.approx(inside)
        assert limits.kept == (inside > 0)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("share", [-0.99, 1.01])
def test_the_largest_share_of_a_velocity_limit(station, still, joint, share):
    velocity = still.velocity.copy()
    velocity[:, joint] = share * SPEED[joint]
    limits = check_limits(replace(still, velocity=velocity), station)
    assert limits.velocity == pytest.approx(abs(share))
    assert limits.acceleration == pytest.approx(0.0)
    assert limits.kept == (abs(share) < 1)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("share", [0.99, -1.01])
def test_accelerations_are_differences_of_velocities(station, still, joint, share):
    velocity = still.velocity.copy()
    velocity[10:, joint] = share * ACCELERATION[joint] * STEP  # reached within one step
    limits = check_limits(replace(still, velocity=velocity), station)
    assert limits.acceleration == pytest.approx(abs(share))
    assert limits.kept == (abs(share) < 1)


def test_tracking_is_the_largest_difference_from_what_was_desired(station, still):
    log = changed(still, "position_desired", 3, 4, still.position[3, 4] - 0.02)
    log = changed(log, "position_desired", 9, 2, still.position[9, 2] + 0.01)
    assert check_limits(log, station).tracking == pytest.approx(0.02)


def test_the_deepest_penetration(station, still):
    log = changed(changed(still, "contact", 3, 0, 0.001), "contact", 4, 0, 0.0004)
    limits = check_limits(log, station)
    assert limits.penetration == 0.001
    assert limits.self_contacts == 0
    assert limits.kept  # things may press on one another


def test_steps_with_self_contact_are_counted_and_forbidden(station, still):
    log = changed(changed(still, "contact", 3, 1, 2.0), "contact", 12, 1, 1.0)
    limits = check_limits(log, station)
    assert limits.self_contacts == 2
    assert not limits.kept


def test_the_file_has_every_array_by_its_name(still, tmp_path):
    rng = np.random.default_rng(0)
    looks = {name: np.zeros(5) for name in ("look_time", "hand_distance", "speed_scale")}
    full = replace(still, **looks)
    log = PlantLog(**{field.name: rng.normal(size=getattr(full, field.name).shape) for field in fields(full)})
    log.write(tmp_path / "plant.npz")
    with np.load(tmp_path / "plant.npz", allow_pickle=False) as file:
        again = PlantLog(**{name: file[name] for name in file.files})
    for field in fields(log):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(log, field.name))
    # Contacts that were not logged are not in it.
    replace(log, contact=None).write(tmp_path / "joints.npz")
    with np.load(tmp_path / "joints.npz", allow_pickle=False) as file:
        assert set(file.files) == {field.name for field in fields(log)} - {"contact"}
