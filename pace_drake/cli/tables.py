"""Tables on the terminal."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console
    from rich.table import Table as RichTable

    from pace_drake.evaluate.report import Table
    from pace_drake.task import Task


def wide_console() -> "Console":
    """A console on which wide tables stay whole where nobody looks, as in a file."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=200)


def joint_names(task: "Task") -> dict[str, str]:
    """How the joint actions are called, by their 1-based numbers."""
    joints = enumerate(task.human_index_of_joint, start=1)
    return {str(key): f"{key} {task.human_actions[human_index - 1].name}" for key, human_index in joints}


def idle_table(mean: dict, names: "Mapping[str, str]", title: str) -> "RichTable":
    """Who waited for whom, by joint action.

    Args:
        mean: as ``mean_result`` gives it; ``robot_idle`` and ``human_idle`` by the same keys, the last is ``total``.
        names: how keys are shown, where not by themselves.
        title: in rich's markup.
    """
    from rich.table import Table as RichTable

    drawn = RichTable("joint action", "robot waited", "human waited", title=title)
    for column in drawn.columns[1:]:
        column.justify = "right"
    for key in mean["robot_idle"]:
        if key == "total":
            drawn.add_section()
        drawn.add_row(names.get(key, key), f"{mean['robot_idle'][key]:.2f}", f"{mean['human_idle'][key]:.2f}")
    return drawn


def rich_table(table: "Table") -> "RichTable":
    """A report's table as rich draws it."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table as RichTable

    drawn = RichTable(
        title=f"\n{escape(table.title)}",
        box=box.SIMPLE_HEAD,
        title_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )
    for k, name in enumerate(table.columns):
        drawn.add_column(escape(name), justify="right" if k else "left", no_wrap=True)
    for row in table.rows:
        drawn.add_row(*map(escape, row))
    return drawn
