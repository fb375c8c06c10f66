"""Tables on the terminal."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

    from pace_drake.evaluate.report import Table


def wide_console() -> "Console":
    """A console on which wide tables stay whole where nobody looks, as in a file."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=200)


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
