"""Makes the pictures of the README: ``make pictures``. The diagram needs Debian's graphviz, the workcell libegl1.

python docs/pictures.py [folder]
"""

import shutil
import subprocess
import sys
from pathlib import Path

from pace_drake.cli.main import main
from pace_drake.diagram import Assembly
from pace_drake.evaluate.workcell_picture import WORKING_POSE, render_workcell
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.plant import make_plant_station


def workcell(path: Path) -> None:
    """The plant level, rendered by VTK."""
    render_workcell(path, load_scenario("ikea_chair").workcell, WORKING_POSE)


def timeline(path: Path) -> None:
    """One episode of the default policy."""
    run = path.with_suffix(".run")
    shutil.rmtree(run, ignore_errors=True)
    try:
        main(["run", "ikea_chair", "--level", "task", "--seed", "1", "--out", str(run)])
    except SystemExit as stop:
        if stop.code:
            raise
    shutil.move(run / "timeline.png", path)
    shutil.rmtree(run)


def diagram(path: Path) -> None:
    """Drake's own picture of the diagram."""
    dot = shutil.which("dot")
    if dot is None:
        sys.exit("the picture of the diagram needs the dot program: apt-get install graphviz")
    scenario = load_scenario("ikea_chair")
    task = scenario.task
    assembly = Assembly(
        scenario,
        make_policy("learned", scenario),
        station=make_plant_station(scenario.workcell),
        motions=plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions),
    )
    graph = assembly.GetGraphvizString(max_depth=1)
    subprocess.run([dot, f"-T{path.suffix[1:]}", "-Gdpi=70", "-o", path], input=graph, text=True, check=True)


def statechart(path: Path) -> None:
    """The chart of Fig. 2, while a decision is asked for."""
    try:
        main(["chart", "draw", "pace_task", "--layout", "rows", "--highlight", "DECIDE", "-o", str(path)])
    except SystemExit as stop:
        if stop.code:
            raise


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"
    folder.mkdir(exist_ok=True)
    workcell(folder / "workcell.png")
    timeline(folder / "timeline.png")
    diagram(folder / "diagram.svg")
    statechart(folder / "statechart.png")
    statechart(folder / "statechart.svg")
