"""The same diagram on LCM: drives a robot through the driver's messages, here answered by a test peer.

The peer is OURS and no robot: it follows commands with a first-order lag. In-process LCM (memq://) is used, so nothing
leaves this program. On a lab network ``pace bridge`` does this, with checks before and an operator (docs/hardware.md).

    python examples/bridge.py [seconds]
"""

import sys

import numpy as np
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator

from pace_drake.diagram import Assembly
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.panda_peer import PandaPeer
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.stations.hardware import HardwareStation, LcmLoop
from pace_drake.stations.motions import plan_motions


def run(seconds: float) -> tuple[float, float, int, int]:
    scenario = load_scenario("ikea_chair", ("safety.grasp_check=false",))  # the peer's fingers meet nothing
    task = scenario.task
    config = LcmConfig(url="memq://")
    lcm = DrakeLcm(config.url)
    motions = plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
    peer = PandaPeer(lcm, motions.home, config=config)

    station = HardwareStation(config, lcm, clock=peer.wall_clock)
    # Everything but the station is what simulation runs; on hardware the logic reacts every 10 ms.
    assembly = Assembly(
        scenario,
        make_policy("phase_threshold", scenario),
        station=station,
        motions=motions,
        reaction_period=0.01,
    )
    simulator = Simulator(assembly)
    context = simulator.get_mutable_context()
    assembly.set_episode(context, assembly.people.sample(scenario, np.random.default_rng(0)))

    loop = LcmLoop(simulator, lcm, station, clock=peer.elapsed, poll_timeout=0.0)
    peer.step(0.0)  # the first status
    loop.initialize(timeout=0.0)
    assembly.GetInputPort("ack").FixValue(context, 1.0)  # the operator's leave; nothing is sent without it
    worst = 0.0
    while context.get_time() < seconds and not assembly.GetOutputPort("finished").Eval(context)[0]:
        peer.step(0.005)
        loop.step()
        commanded = assembly.robot_action.GetOutputPort("position").Eval(
            assembly.robot_action.GetMyContextFromRoot(context)
        )
        worst = max(worst, float(np.max(np.abs(commanded - peer.position))))
    mode = int(assembly.GetOutputPort("mode").Eval(context)[0])
    print(f"{context.get_time():.1f} s, state {assembly.task_statechart.compiled.chart.leaves[mode]}")
    print(f"{peer.num_accepted} commands accepted, {peer.num_rejected} rejected; joint error {1e3 * worst:.1f} mrad")
    for agent in ("robot_idle", "human_idle"):
        print(agent, np.round(assembly.GetOutputPort(agent).Eval(context), 2), "s")
    return context.get_time(), worst, peer.num_accepted, peer.num_rejected


if __name__ == "__main__":
    run(float(sys.argv[1]) if len(sys.argv) > 1 else float("inf"))
