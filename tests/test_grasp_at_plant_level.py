"""A cube that is not where the gripper closes, or is lost on its way: the robot stops, says why, fetches it anew."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from pace_drake.diagram import Assembly
from pace_drake.evaluate.event_log import EventRecorder
from pace_drake.evaluate.workcell import WorkcellRecorder
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation, Stop
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.task import ActionKind
from tests.short_scenario import short_scenario


class Played:
    """One episode, the rows of its event log, and its sorts."""

    def __init__(self, *overrides: str) -> None:
        scenario = short_scenario("decide_at_start=false", *overrides)
        task = scenario.task
        motions = plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
        self.station = make_plant_station(scenario.workcell)
        policy = make_policy(scenario.policy, scenario)
        self.simulation = Simulation(Assembly(scenario, policy, station=self.station, motions=motions))
        self.rows: list[dict] = []
        self.sorts = WorkcellRecorder()
        recorder = EventRecorder(lambda time, kind, **values: self.rows.append({"time": time, "kind": kind, **values}))
        self.simulation.listeners = (recorder, self.sorts)
        self.acknowledge(False)
        self.simulation.reset(self.simulation.sample_episode(np.random.default_rng(0)))

    def acknowledge(self, on: bool) -> None:
        self.simulation.assembly.GetInputPort("ack").FixValue(self.simulation.context, float(on))
        self.simulation.interrupt()

    def until(self, reached, limit: float) -> None:
        while not reached():
            assert self.simulation.advance(self.simulation.time + 0.05) == Stop.BOUNDARY
            assert self.simulation.time < limit, self.rows

    def progress(self) -> np.ndarray:
        action = self.simulation.assembly.robot_action
        return action.GetOutputPort("motion_progress").Eval(action.GetMyContextFromRoot(self.simulation.context))

    def put_away(self, name: str) -> None:
        """Puts a component on the table beside the pile."""
        plant = self.station.plant
        body = plant.GetBodyByName("cube", plant.GetModelInstanceByName(name))
        context = plant.GetMyMutableContextFromRoot(self.simulation.context)
        plant.SetFloatingBaseBodyPoseInWorldFrame(context, body, RigidTransform([0.55, -0.35, 0.02]))

    def names(self, kind: str) -> list[str]:
        return [row["name"] for row in self.rows if row["kind"] == kind]

    def height(self, k: int) -> float:
        return self.station.component_pose(self.simulation.context, k).translation()[2]


def test_a_cube_that_is_gone_stops_the_robot_with_a_reason_and_after_the_acknowledgement_it_is_fetched_anew():
    played = Played("policy=always_assist")
    simulation = played.simulation
    played.until(lambda: played.progress()[2] > 0.1, 5.0)
    assert tuple(played.progress()[:2]) == (ActionKind.ROBOT_TASK, 1)
    played.put_away("cube_1")
    played.until(lambda: "t_fault" in played.names("reaction"), 10.0)
    (reason,) = played.names("fault")
    assert reason == (
        "the gripper does not hold cube_1: its fingers are 24 mm apart instead of 40; put it where it belongs, then"
        " acknowledge: it is fetched anew"
    )
    assert played.station.component_pose(simulation.context, 0).translation()[0] == pytest.approx(0.55, abs=1e-3)
    simulation.advance(simulation.time + 0.5)
    held = simulation.output("panda.position_measured").copy()
    simulation.advance(simulation.time + 2.0)
    np.testing.assert_allclose(simulation.output("panda.position_measured"), held, atol=1e-3)
    assert simulation.output("robot_action")[0] == ActionKind.HOLD
    played.acknowledge(True)
    simulation.advance(simulation.time + 0.5)
    played.acknowledge(False)
    desired = []
    action = simulation.assembly.robot_action
    while not played.sorts.sorts:
        assert simulation.advance(simulation.time + 0.05) == Stop.BOUNDARY
        assert simulation.time < 40.0
        context = action.GetMyContextFromRoot(simulation.context)
        desired.append(action.GetOutputPort("position").Eval(context).copy())
    assert np.max(np.abs(np.diff(desired, axis=0))) < 2.175 * 0.05  # no jump: it went back to where it began
    home = simulation.assembly.scenario.workcell.home
    assert np.min(np.max(np.abs(np.array(desired[:-40]) - home), axis=1)) < 1e-2
    assert [sort.good for sort in played.sorts.sorts] == [True]
    assert simulation.run()
    assert len(played.names("fault")) == 1  # once
    reactions = played.names("reaction")
    assert [name for name in reactions if name in ("t_fault", "f_ack", "s_reissue", "h_end")] == [
        *("t_fault", "f_ack", "s_reissue", "h_end")
    ]


def test_a_cube_that_is_lost_on_its_way_stops_the_robot_until_somebody_acknowledges():
    played = Played("policy=never_assist", "max_time=12")
    simulation = played.simulation
    played.until(lambda: played.height(0) > 0.09, 10.0)
    assert played.names("fault") == []
    played.put_away("cube_1")
    simulation.advance(simulation.time + 0.4)
    assert played.names("reaction")[-1] == "t_fault"
    reason = played.names("fault")[0]
    assert not simulation.run()
    stopped = next(row["time"] for row in played.rows if row["name"] == "t_fault")
    assert simulation.truncation == (
        f"after 12 s; the robot was stopped, waiting for ack, for the last {12 - stopped:.0f} s: {reason}"
    )


def test_without_the_check_the_robot_goes_on_with_nothing():
    played = Played("policy=never_assist", "safety.grasp_check=false")
    played.until(lambda: played.progress()[2] > 0.1, 5.0)
    played.put_away("cube_1")
    played.until(lambda: "r_done" in played.names("reaction"), 20.0)
    assert played.simulation.assembly.grasp_monitor is None
    assert "t_fault" not in played.names("reaction")
    assert played.station.component_pose(played.simulation.context, 0).translation()[0] == pytest.approx(0.55, abs=1e-3)
