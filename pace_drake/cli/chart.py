"""``pace chart``: check, draw and lower statecharts."""

from pathlib import Path

import click

from pace_drake.errors import InputError
from pace_drake.files import write_whole
from pace_drake.resources import resource_path


class _ChartVerbs(click.Group):
    """Imports a verb only when it is called, as ``pace`` itself does."""

    _modules = ("check", "draw", "lower")

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self._modules)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in self._modules:
            return None
        import importlib

        return importlib.import_module(f"pace_drake.cli.chart_{name}").command


@click.group("chart", cls=_ChartVerbs)
def command() -> None:
    """Check, draw and lower statecharts."""


def chart_path(text: str) -> Path:
    """The file of a chart: a path, or the name of one that comes with the package.

    Raises:
        InputError: there is none.
    """
    shipped = {path.stem: path for path in sorted(resource_path("statecharts").glob("*.scxml"))}
    path = Path(text)
    if path.is_file():
        return path
    if text not in shipped:
        raise InputError(f"{text}: no such chart; give a .scxml file or one of {', '.join(shipped)}")
    return shipped[text]


def write_text(path: Path, text: str) -> None:
    """Writes a whole file or none."""
    write_whole(path, lambda beside: beside.write_text(text, encoding="utf-8"))
