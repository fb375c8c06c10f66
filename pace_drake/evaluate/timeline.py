"""Timeline of one episode: who did what when, who waited, the phase, and the decisions."""

import csv
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pace_drake.errors import InputError
from pace_drake.evaluate.event_log import COLUMNS
from pace_drake.files import check_file
from pace_drake.task import ActionKind, Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What a timeline can be drawn as.
PICTURES = (".png", ".svg", ".pdf")
#: Resolution of the pictures.
DPI = 110

#: What is drawn in which colour.
COLOURS = {
    "human": "#4c78a8",
    "joint": "#54a24b",
    "ROBOT_TASK": "#9d9da1",
    "PREPARE": "#eeca3b",
    "JOINT": "#54a24b",
    "HOME": "#bab0ac",
    "HOME_ABORTED": "#bab0ac",
    "idle": "#e45756",
    "HOLD": "#b279a2",
}


def check_picture(path: Path) -> None:
    """Refuses a place where no timeline can be drawn to, before the work; see ``check_file``.

    Raises:
        InputError: an ending that is not one of ``PICTURES``, or no file can be made there.
    """
    if path.suffix not in PICTURES:
        raise InputError(f"{path}: the name must end in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}")
    check_file(path)


def read_events(path: Path, episode: int = 0) -> list[dict[str, str]]:
    """Rows of one episode of an events.csv; a last row cut short by a kill is left out.

    Raises:
        InputError: the file has other columns.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            header, rows = reader.fieldnames or (), list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: was not written by pace run, it is no CSV text") from error
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise InputError(f"{path}: was not written by pace run, it has no column {missing[0]!r}")
    return [row for row in rows if row["episode"] == str(episode) and row["duration"] is not None]


def draw_timeline(events: list[dict[str, str]], task: Task, title: str, path: Path) -> None:
    """Draws a PNG (or what the suffix of ``path`` says); arguments as ``timeline_figure``."""
    timeline_figure(events, task, title).savefig(path, dpi=DPI)


def timeline_image(events: list[dict[str, str]], task: Task, title: str) -> np.ndarray:
    """The picture as an array (height, width, 3) of uint8; arguments as ``timeline_figure``."""
    figure = timeline_figure(events, task, title)
    figure.set_dpi(DPI)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[attr-defined]


def timeline_figure(events: list[dict[str, str]], task: Task, title: str) -> "Figure":
    """Draws who did what when.

    Args:
        events: rows of one episode, as ``read_events`` gives them.
        task: gives the names.
        title: one line above.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    # Only just begun, there is little to see.
    end = max([1.0, *(float(row["time"]) for row in events)])
    figure = Figure(figsize=(12, 5), layout="constrained")
    FigureCanvasAgg(figure)
    lanes, phases = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])

    def bar(lane: int, start: float, stop: float, colour: str, label: str = "", hatch: str | None = None) -> None:
        lanes.barh(lane, stop - start, left=start, height=0.8, color=colour, edgecolor="white", hatch=hatch)
        if label and stop - start > 0.045 * end:
            lanes.text((start + stop) / 2, lane, label, ha="center", va="center", fontsize=7, color="black")

    humans = [row for row in events if row["kind"] == "human"]
    for row, following in zip_longest(humans, humans[1:]):
        stop = float(following["time"]) if following else end
        if row["name"].startswith("wait "):
            continue
        joint = task.human_actions[int(row["human_action"]) - 1].joint
        # After the last joint action the person is done.
        if joint and following is None:
            done = [r for r in events if r["kind"] == "reaction" and r["name"] == "j_done"]
            stop = float(done[-1]["time"]) if done else stop
        bar(
            1,
            float(row["time"]),
            stop,
            COLOURS["joint" if joint else "human"],
            row["name"].replace("_", "\n", 1),
        )
    commands = [row for row in events if row["kind"] == "command"]
    for row, following in zip_longest(commands, commands[1:]):
        if row["name"] == ActionKind.HOLD.name:
            until = end if following is None else float(following["time"])
            bar(0, float(row["time"]), until, COLOURS["HOLD"], "held")
    for row in events:
        if row["kind"] == "command" and row["name"] != ActionKind.HOLD.name:
            start = float(row["time"])
            stop = start + float(row["duration"] or 0.0)
            kind = ActionKind[row["name"]]
            index = row["robot_task"] or row["joint_action"]
            name = {
                ActionKind.ROBOT_TASK: f"sort\n{index}",
                ActionKind.PREPARE: f"prepare\n{index}",
                ActionKind.JOINT: f"joint\n{index}",
            }.get(kind, "home")
            bar(0, start, min(stop, end), COLOURS[row["name"]], name)
        elif row["kind"] in ("robot_idle", "human_idle"):
            start = float(row["start"])
            lane = 0 if row["kind"] == "robot_idle" else 1
            bar(lane, start, start + float(row["duration"]), COLOURS["idle"], "", "///")
            lanes.text(
                start + float(row["duration"]) / 2,
                lane + 0.45,
                f"waits {float(row['duration']):.1f} s",
                ha="center",
                va="bottom",
                fontsize=7,
                color=COLOURS["idle"],
            )
    lanes.set_yticks([0, 1], ["robot", "human"])
    lanes.set_ylim(-0.6, 1.9)
    lanes.set_title(title, fontsize=10)
    lanes.legend(
        handles=[
            Patch(color=COLOURS["human"], label="human action"),
            Patch(color=COLOURS["joint"], label="joint action"),
            Patch(color=COLOURS["ROBOT_TASK"], label="robot task"),
            Patch(color=COLOURS["PREPARE"], label="preparation"),
            Patch(facecolor=COLOURS["idle"], hatch="///", label="waiting"),
        ],
        ncols=5,
        fontsize=7,
        loc="upper right",
        frameon=False,
    )

    samples = [row for row in events if row["kind"] == "phase"]
    for action in range(1, task.num_human_actions + 1):
        of_action = [row for row in samples if int(row["human_action"]) == action]
        if task.human_actions[action - 1].joint or not of_action:
            continue
        times = [float(row["time"]) for row in of_action]
        first = action == 1
        phases.plot(
            times,
            [float(r["progress"]) for r in of_action],
            color="0.7",
            lw=1,
            label="true progress" if first else None,
        )
        phases.plot(
            times,
            [float(r["phase"]) for r in of_action],
            color=COLOURS["human"],
            lw=1.5,
            label="estimated phase" if first else None,
        )
    for assist, marker, label in ((0, "o", "decision: go on"), (1, "^", "decision: assist")):
        rows = [r for r in events if r["kind"] == "decision" and r["assist"] == str(assist)]
        phases.plot(
            [float(r["time"]) for r in rows],
            [float(r["phase"]) for r in rows],
            marker,
            color="black",
            ms=7 if assist else 4,
            label=label,
        )
    phases.set_ylabel("phase")
    phases.set_ylim(-0.05, 1.1)
    phases.set_xlabel("time [s]")
    phases.set_xlim(0, end)
    phases.legend(fontsize=7, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return figure
