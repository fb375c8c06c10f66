"""The replay of an episode: Drake's recording in 3D, and beside it what happened, in step with the animation."""

from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from math import isfinite
from typing import Any

from pace_drake.evaluate.timeline import COLOURS
from pace_drake.task import ActionKind, Task

#: States of pace_task.scxml by the colour they have in the timeline; those of other charts are plain.
_COLOUR_OF_STATE = {
    "ROBOT_TASK": COLOURS["ROBOT_TASK"],
    "PREP": COLOURS["PREPARE"],
    "WAIT": COLOURS["idle"],
    "JOINT": COLOURS["JOINT"],
    "HOMING": COLOURS["HOME"],
    "STOPPED": "#b279a2",
    "FAULT": "#b279a2",
}
_PLAIN = "#dddddd"
#: States without an action of the robot: they bear no number.
_UNNUMBERED = {"READY", "DECIDE", "STOPPED", "FAULT", "DONE"}
#: The paper's word, where the chart's is short.
_WORD = {"PREP": "PREPARE"}


@dataclass(frozen=True)
class About:
    """What a replay says about its run.

    Attributes:
        scenario: its name.
        run: one line: policy, level, seed, episode.
        people: where the hands come from; says SYNTHETIC where they are.
    """

    scenario: str
    run: str
    people: str


def replay_page(static_html: str, events: list[dict[str, str]], task: Task, about: About) -> str:
    """Puts the story of an episode into the page that Drake's Meshcat wrote; the result needs nothing else.

    Args:
        static_html: of ``Meshcat.StaticHtml()``, with the recording of the episode from time 0 on.
        events: rows of the episode, as ``timeline.read_events`` gives them.
        task: gives the names and the weight of the human's idle time.
        about: what the page says about the run.

    Raises:
        ValueError: ``static_html`` is not a page.
    """
    import jinja2

    head, end, tail = static_html.rpartition("</body>")
    if not end:
        raise ValueError("Meshcat's page has no </body>")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    template = environment.from_string(files("pace_drake.evaluate").joinpath("replay.html").read_text("utf-8"))
    panel = template.render(story=story(events, task), about=about, colours=COLOURS, weight=task.human_idle_weight)
    return head + panel + end + tail


def story(events: list[dict[str, str]], task: Task) -> dict[str, Any]:
    """What the page shows, as plain data; times in [s].

    Keys:
        end, outcome: when the episode ended and how (``finished``, ``truncated``, or empty).
        robot: intervals of the chart's states, with label, what is done, and colour. There may be none.
        human: intervals of the person's actions and waiting.
        phase: samples (time, human action, phase, true progress) of the actions that are not joint.
        robot_idle, human_idle: intervals (start, duration, joint action).
        decisions: time, answer (1 assist, 0 go on, -1 none in time), phase, true progress; null where unknown.
        joints: names of the joint actions.

    Args:
        events, task: see ``replay_page``.
    """
    end = max([0.0, *(float(row["time"]) for row in events)])
    endings = [row["name"] for row in events if row["kind"] == "episode" and row["name"] != "start"]
    joint = {index: k + 1 for k, index in enumerate(task.human_index_of_joint)}
    return {
        "end": end,
        "outcome": endings[-1] if endings else "",
        "robot": _robot(events, task, end),
        "human": _human(events, task, end),
        "phase": [
            [float(row["time"]), int(row["human_action"]), _number(row["phase"]), _number(row["progress"])]
            for row in events
            if row["kind"] == "phase" and int(row["human_action"]) not in joint
        ],
        **{
            kind: [
                [float(row["start"]), float(row["duration"]), int(row["joint_action"])]
                for row in events
                if row["kind"] == kind
            ]
            for kind in ("robot_idle", "human_idle")
        },
        "decisions": [
            {
                "time": float(row["time"]),
                "assist": int(row["assist"]),
                "phase": None if int(row["human_action"]) in joint else _number(row["phase"]),
                "progress": None if int(row["human_action"]) in joint else _number(row["progress"]),
                "action": task.human_actions[int(row["human_action"]) - 1].name,
            }
            for row in events
            if row["kind"] == "decision"
        ],
        "joints": [task.human_actions[index - 1].name for index in task.human_index_of_joint],
    }


def _number(text: str) -> float | None:
    """A number of the log; None if it is empty or not finite, as JSON knows no NaN."""
    value = float(text) if text else float("nan")
    return value if isfinite(value) else None


def _robot(events: list[dict[str, str]], task: Task, end: float) -> list[dict[str, Any]]:
    """Intervals of the chart's states. Several reactions at one instant leave the last one's."""
    changes: list[tuple[float, str, str, str]] = []  # time, state, label, what
    index, what = "", ""
    for row in events:
        if row["kind"] == "command" and row["name"] != ActionKind.HOLD.name:
            is_task = row["name"] == ActionKind.ROBOT_TASK.name
            index = row["robot_task"] if is_task else row["joint_action"]
            what = _name(task, is_task, index)
            # The command of a reaction is logged after it, at the same instant.
            if changes and changes[-1][0] == float(row["time"]):
                time, state, _, _ = changes[-1]
                changes[-1] = (time, state, _label(state, index), what)
        elif row["kind"] == "reaction":
            state = row["target"] or row["source"]
            numbered = state not in _UNNUMBERED
            label = _label(state, index) if numbered else state
            changes.append((float(row["time"]), state, label, what if numbered else ""))
    changes.append((end, "", "", ""))
    return [
        {
            "start": time,
            "stop": stop,
            "label": label,
            "what": what,
            "colour": _COLOUR_OF_STATE.get(state, _PLAIN),
            "waits": state == "WAIT",
        }
        for (time, state, label, what), (stop, *_) in pairwise(changes)
        if stop > time or (time == end and stop == end)
    ]


def _label(state: str, index: str) -> str:
    return f"{_WORD.get(state, state)} {index}".strip()


def _name(task: Task, is_task: bool, index: str) -> str:
    if not index:
        return ""
    if is_task:
        return task.robot_tasks[int(index) - 1].name
    return task.human_actions[task.human_index_of_joint[int(index) - 1] - 1].name


def _human(events: list[dict[str, str]], task: Task, end: float) -> list[dict[str, Any]]:
    """Intervals of what the person does; after the last joint action they are done."""
    joint = set(task.human_index_of_joint)
    changes = [
        (float(row["time"]), row["name"], int(row["human_action"]), row["name"].startswith("wait "))
        for row in events
        if row["kind"] == "human"
    ]
    done = [float(row["time"]) for row in events if row["kind"] == "reaction" and row["name"] == "j_done"]
    if changes and changes[-1][2] == task.num_human_actions and done and done[-1] > changes[-1][0]:
        changes.append((done[-1], "done", 0, False))
    changes.append((end, "", 0, False))
    return [
        {
            "start": time,
            "stop": stop,
            "what": name.removeprefix("wait "),
            "action": action,
            "waits": waits,
            "joint": action in joint,
        }
        for (time, name, action, waits), (stop, *_) in pairwise(changes)
        if stop > time
    ]
