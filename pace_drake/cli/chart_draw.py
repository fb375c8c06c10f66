"""``pace chart draw``: pictures of a statechart."""

from pathlib import Path

import click

from pace_drake.cli.chart import chart_path, write_text
from pace_drake.errors import InputError
from pace_drake.files import check_file, write_whole


@click.command()
@click.argument("file")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Picture: .svg, .png, .mmd or .dot.")
@click.option("--highlight", "active", metavar="STATE", help="Draw this leaf state as the active one.")
@click.option(
    "--layout",
    type=click.Choice(["auto", "rows", "dot"]),
    default="auto",
    show_default=True,
    help="Of .svg: by Graphviz (dot), or in rows, which needs nothing; auto takes dot where it is installed.",
)
def command(file: str, out: Path, active: str | None, layout: str) -> None:
    """Draw the statechart FILE (a .scxml file or the name of one that comes with the package).

    .svg and .png show states inside states, with each transition as guard / effect and an arrow to its target; .mmd is
    Mermaid text for a README, .dot text for Graphviz.
    """
    from pace_drake.statechart import load_chart
    from pace_drake.statechart.draw import Highlight, to_svg, write_png
    from pace_drake.statechart.graphviz import has_dot, svg_by_dot, to_dot
    from pace_drake.statechart.mermaid import to_mermaid

    if out.suffix not in (".svg", ".png", ".mmd", ".dot"):
        raise InputError(f"{out}: the name must end in .svg, .png, .mmd or .dot")
    check_file(out)
    if layout == "dot" and (not has_dot() or out.suffix != ".svg"):
        raise InputError("--layout dot makes .svg, and needs Graphviz: install it, or leave the option out")
    chart = load_chart(chart_path(file))
    if active is not None and active not in chart.leaves:
        raise InputError(f"no leaf state {active!r}; there are {', '.join(chart.leaves)}")
    highlight = Highlight(frozenset(chart.ancestors(active))) if active is not None else Highlight()
    if out.suffix == ".png":
        write_whole(out, lambda beside: write_png(chart, beside, highlight))
    elif out.suffix == ".svg":
        by_dot = layout == "dot" or (layout == "auto" and has_dot())
        write_text(out, svg_by_dot(chart, highlight) if by_dot else to_svg(chart, highlight))
    else:
        write_text(out, to_mermaid(chart) if out.suffix == ".mmd" else to_dot(chart, highlight))
