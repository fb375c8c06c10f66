"""What the plant level costs, planning and stepping: ``python benchmarks/bench_plant.py``.

Seconds of this process's CPU time for 20 s of the same simulated episode, without and with the safety monitor, the log,
and a recording for the replay; the stepping's ratios are to the first row. Planning begins with an empty cache.
"""

import os
import tempfile
from time import perf_counter, process_time

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams
from rich.console import Console
from rich.table import Table

from pace_drake.diagram import FULL_LOG, JOINT_LOG, Assembly
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation
from pace_drake.stations.components import components
from pace_drake.stations.motions import MotionLibrary, plan_motions
from pace_drake.stations.plant import make_plant_station
from pace_drake.task import ActionKind

SIMULATED = 20.0  # [s]


def planning(console: Console) -> MotionLibrary:
    scenario = load_scenario("ikea_chair")
    numbers = scenario.task.num_robot_tasks, scenario.task.num_joint_actions
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        start = perf_counter()
        motions = plan_motions(scenario.workcell, *numbers)
        fresh = perf_counter()
        plan_motions(scenario.workcell, *numbers)
        cached = perf_counter()
        motions.motion(ActionKind.ROBOT_TASK, 1, components(scenario.workcell)[0].located + 0.005)  # makes the scene
        located = perf_counter()
        rng = np.random.default_rng(0)
        for _ in range(10):
            motions.motion(ActionKind.ROBOT_TASK, 1, components(scenario.workcell)[0].located + 0.01 * rng.random(3))
        end = perf_counter()
    console.print(
        f"planning {len(motions)} motions: {fresh - start:.1f} s from nothing, {cached - fresh:.3f} s from the cache; "
        f"a sort of a cube that lies elsewhere {(end - located) / 10:.2f} s"
    )
    return motions


def stepping(motions: MotionLibrary, monitored: bool, logged: tuple[str, ...], recorded: bool) -> float:
    scenario = load_scenario("ikea_chair", (f"safety.enabled={str(monitored).lower()}",))
    meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False)) if recorded else None
    station = make_plant_station(scenario.workcell, meshcat=meshcat)
    policy = make_policy("learned", scenario)
    simulation = Simulation(Assembly(scenario, policy, station=station, motions=motions, logged=logged))
    if meshcat is not None:
        meshcat.StartRecording(10.0, set_visualizations_while_recording=False)
    simulation.reset(simulation.sample_episode(np.random.default_rng([1, 0])))
    simulation.advance(1.0)
    start = process_time()
    simulation.advance(1.0 + SIMULATED)
    return process_time() - start


def main() -> None:
    console = Console()
    motions = planning(console)
    table = Table("plant", "CPU [s\\]", "times real time", "ratio", title=f"{SIMULATED:g} s simulated")
    first = 0.0
    for name, *what in (
        ("bare", False, (), False),
        ("monitored", True, (), False),
        ("monitored, joints logged, recorded (pace run)", True, JOINT_LOG, True),
        ("monitored, everything logged (pace evaluate workcell)", True, FULL_LOG, False),
    ):
        cpu = stepping(motions, *what)  # type: ignore[arg-type]
        first = first or cpu
        table.add_row(name, f"{cpu:.2f}", f"{SIMULATED / cpu:.1f}", f"{cpu / first:.2f}")
    console.print(table)


if __name__ == "__main__":
    main()
