"""The mistakes in the design of the chart that exploration found, each as a change of the shipped charts."""

from dataclasses import dataclass
from pathlib import Path

from pace_drake.resources import resource_path
from pace_drake.statechart.check import Report, check, load_spec

RESUME = "fault == 0 &amp;&amp; stop == 0 &amp;&amp; ack == 1 &amp;&amp; rb == 0"
COMMANDED = "kind != NONE &amp;&amp; kind != HOLD"


@dataclass(frozen=True)
class DesignError:
    """One mistake.

    Attributes:
        changes: component -> texts to be replaced, all of their occurrences.
        broken: a property that finds it.
        depth: [ticks] length of the shortest counterexample.
    """

    changes: dict[str, list[tuple[str, str]]]
    broken: str
    depth: int


DESIGN_ERRORS = {
    "done as a level flag": DesignError(
        {
            "robot": [
                ('expr="last" pace:role="output" pace:type="sequence"', 'expr="1" pace:role="output"'),
                ('pace:output="busy = 1"', 'pace:output="busy = 1; done = 0"'),
            ],
            "task": [
                ('"done" expr="0" pace:role="input" pace:type="sequence"', '"done" expr="0" pace:role="input"'),
                ("done == cmd", "done == 1"),
                ("done != cmd", "done == 0"),
                ("done + 1 - D0", "cmd"),
            ],
        },
        "robot tasks are done in order, none skipped, none twice",
        6,
    ),
    "a command without its kind": DesignError(
        {
            "task": [(' pace:output="kind = HOLD_KIND"', "")],
            "robot": [(COMMANDED, "1 == 1")],
        },
        "the robot begins nothing while stopped",
        5,
    ),
    "resuming while the robot moves": DesignError(
        {"task": [(RESUME, RESUME.replace(" &amp;&amp; rb == 0", ""))]},
        "robot tasks are done in order, none skipped, none twice",
        6,
    ),
    "one resume, which issues the command again": DesignError(
        {
            "task": [
                (f'cond="{RESUME} &amp;&amp; done == cmd"', 'cond="rb == 2"'),
                (f"{RESUME} &amp;&amp; done != cmd", RESUME),
            ]
        },
        "robot tasks are done in order, none skipped, none twice",
        4,
    ),
    "one resume, which does not": DesignError(
        {
            "task": [
                (f"{RESUME} &amp;&amp; done == cmd", RESUME),
                (f'cond="{RESUME} &amp;&amp; done != cmd"', 'cond="rb == 2"'),
            ]
        },
        "every episode ends",
        8,
    ),
    "timers run on while stopped": DesignError(
        {"task": [('      <assign location="t0" expr="now - age"/>\n', "")]},
        "timers stand still while stopped",
        9,
    ),
}


def mutated(folder: Path, changes: dict[str, list[tuple[str, str]]]) -> dict[str, Path]:
    """Writes changed charts; every text to be replaced must occur."""
    files = {"task": "pace_task", "robot": "robot", "human": "human"}
    charts = {}
    for component, replacements in changes.items():
        text = resource_path(f"statecharts/{files[component]}.scxml").read_text()
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        charts[component] = folder / f"{component}.scxml"
        charts[component].write_text(text)
    return charts


def check_mutated(folder: Path, changes: dict[str, list[tuple[str, str]]], **parameters: float) -> Report:
    """The report on the shipped composition with these changes."""
    path = resource_path("statecharts/pace_task.checks.yaml")
    return check(load_spec(path, mutated(folder, changes), parameters))
