"""Makes the pictures of the README: ``make pictures``. It needs Debian's graphviz, libegl1 and chromium.

python docs/pictures.py [--out FOLDER] [NAME ...], such as replay.png; all by default
"""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

from pace_drake.cli.main import main
from pace_drake.evaluate.workcell_picture import WORKING_POSE, render_workcell
from pace_drake.scenario import load_scenario


def pace(*arguments: str | Path) -> None:
    """Runs a command; a failure ends all."""
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        if stop.code:
            raise


def workcell(path: Path) -> None:
    """The plant level, rendered by VTK."""
    render_workcell(path, load_scenario("ikea_chair").workcell, WORKING_POSE)


def timeline(path: Path) -> None:
    """One episode of the default policy."""
    run = path.with_suffix(".run")
    shutil.rmtree(run, ignore_errors=True)
    pace("run", "ikea_chair", "--level", "task", "--seed", "1", "--out", run)
    shutil.move(run / "timeline.png", path)
    shutil.rmtree(run)


def replay(path: Path) -> None:
    """The page of the same episode at the plant level, while the robot hands over the first key."""
    run = path.with_suffix(".run")
    shutil.rmtree(run, ignore_errors=True)
    pace("run", "ikea_chair", "--level", "plant", "--seed", "1", "--out", run)
    pace("view", run, "--screenshot", path, "--at", "65.5")
    shutil.rmtree(run)


def diagram(path: Path) -> None:
    """Drake's own picture of the diagram."""
    pace("diagram", "ikea_chair", "-o", path)


def statechart(path: Path) -> None:
    """The chart of Fig. 2, while a decision is asked for."""
    pace("chart", "draw", "pace_task", "--layout", "rows", "--highlight", "DECIDE", "-o", path)


#: File to what makes it.
PICTURES: dict[str, Callable[[Path], None]] = {
    "workcell.png": workcell,
    "timeline.png": timeline,
    "replay.png": replay,
    "diagram.svg": diagram,
    "statechart.png": statechart,
    "statechart.svg": statechart,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *PICTURES], metavar="NAME", help=", ".join(PICTURES))
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "pictures")
    chosen = parser.parse_args()
    chosen.out.mkdir(exist_ok=True)
    for name in chosen.names or PICTURES:
        PICTURES[name](chosen.out / name)
