"""The safety monitor in the whole diagram: hand signals that go stale, operators, hands in the path."""

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station


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
