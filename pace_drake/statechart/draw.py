"""Pictures of a statechart, SVG and PNG; and what to highlight while it runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from pace_drake.statechart.compile import CompiledChart, Vector
from pace_drake.statechart.layout import FONT, Layout, Row, Text, layout
from pace_drake.statechart.model import Chart

_COLORS = ("#3b6ea5", "#b5651d", "#4f8a4c", "#8a4f8a", "#a13d3d", "#2f8f8f", "#8f7a2f", "#5c5ca8", "#7a5230", "#4d6b57")
PREEMPTIVE, _ACTIVE, FIRED = "#c02020", "#ffe9a8", "#e07b00"
_FONTS = "DejaVu Sans Mono, Menlo, Consolas, monospace"
_STYLE = {
    "name": (FONT + 1, "#1c2733", "bold"),
    "output": (FONT - 1, "#66727f", "normal"),
    "row": (FONT, "#1c2733", "normal"),
}


@dataclass(frozen=True)
class Highlight:
    """What stands out in a picture.

    Attributes:
        active: ids of the active states, compound ones too.
        fired: ids of the transitions of the last update.
    """

    active: frozenset[str] = frozenset()
    fired: frozenset[str] = frozenset()


def highlight_of(compiled: CompiledChart, x: Vector, fired: Sequence[str] = ()) -> Highlight:
    """What stands out while a chart is in state x and has just taken ``fired``."""
    return Highlight(frozenset(compiled.chart.ancestors(compiled.leaf(x))), frozenset(fired))


def _stroke(row: Row, highlight: Highlight) -> tuple[str, float]:
    if row.transition.id in highlight.fired:
        return FIRED, 2.6
    return (PREEMPTIVE, 1.8) if row.transition.preemptive else (_COLORS[row.color % len(_COLORS)], 1.2)


def fill_color(state: str, is_leaf: bool, decides: bool, highlight: Highlight) -> str:
    """The colour of a state."""
    if state in highlight.active:
        return _ACTIVE if is_leaf else "#fff8e3"
    return "#eaf3ea" if decides else "#ffffff" if is_leaf else "#f4f6f8"


# ---- SVG


def to_svg(chart: Chart, highlight: Highlight | None = None) -> str:
    """The picture of a chart.

    Every state has the id ``state-<id>`` and every transition ``transition-<id>``, with classes ``state``, ``leaf``,
    ``compound``, ``active`` and ``transition``, ``preemptive``, ``fired``, so that a page can restyle a running chart.
    """
    highlight = highlight or Highlight()
    found = layout(chart)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{found.width:.0f}" height="{found.height:.0f}" '
        f'viewBox="0 0 {found.width:.0f} {found.height:.0f}" font-family={quoteattr(_FONTS)}>',
        f"<title>{escape(chart.name)}</title>",
        f'<rect width="{found.width:.0f}" height="{found.height:.0f}" fill="white"/>',
    ]
    for box in found.boxes:
        classes = ["state", "leaf" if box.is_leaf else "compound", *(["active"] * (box.state in highlight.active))]
        fill = fill_color(box.state, box.is_leaf, box.decides, highlight)
        frame = f'x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}"'
        parts.append(f'<g id="state-{box.state}" class="{" ".join(classes)}">')
        parts.append(f'<rect {frame} rx="9" fill="{fill}" stroke="#4a5866" stroke-width="1.3"/>')
        if box.is_final:
            inner = f'x="{box.x + 3:.1f}" y="{box.y + 3:.1f}" width="{box.width - 6:.1f}" height="{box.height - 6:.1f}"'
            parts.append(f'<rect {inner} rx="7" fill="none" stroke="#4a5866" stroke-width="1"/>')
        parts += [_svg_text(text) for text in box.texts]
        parts.append("</g>")
    for row in found.rows:
        color, width = _stroke(row, highlight)
        classes = ["transition", *(["preemptive"] * row.transition.preemptive)]
        classes += ["fired"] * (row.transition.id in highlight.fired)
        parts.append(f'<g id="transition-{row.transition.id}" class="{" ".join(classes)}">')
        parts += [_svg_text(text, row.transition.id in text.text.partition(":")[0]) for text in row.texts]
        if row.points:
            way = " ".join(f"{x:.1f},{y:.1f}" for x, y in row.points)
            parts.append(f'<polyline points="{way}" fill="none" stroke="{color}" stroke-width="{width}"/>')
            x, y = row.points[-1]
            parts.append(f'<polygon points="{_head(x, y, 1)}" fill="{color}"/>')
        parts.append("</g>")
    for mark in found.marks:
        if mark.history is not None:
            parts.append(
                f'<g id="history-{mark.history}" class="history"><circle cx="{mark.x:.1f}" cy="{mark.y:.1f}" r="8" '
                f'fill="white" stroke="#4a5866"/><text x="{mark.x:.1f}" y="{mark.y:.1f}" font-size="9" '
                'text-anchor="middle" dominant-baseline="central">H*</text></g>'
            )
        elif mark.to is not None:
            x, y = mark.to
            parts.append(
                f'<g class="initial"><circle cx="{mark.x:.1f}" cy="{mark.y:.1f}" r="4" fill="#1c2733"/>'
                f'<line x1="{mark.x:.1f}" y1="{mark.y:.1f}" x2="{x - 5:.1f}" y2="{y:.1f}" stroke="#1c2733"/>'
                f'<polygon points="{_head(x, y, -1)}" fill="#1c2733"/></g>'
            )
    return "\n".join([*parts, "</svg>"]) + "\n"


def _head(x: float, y: float, side: int) -> str:
    """An arrow head that points to (x, y) from the right (side 1) or left (-1)."""
    return f"{x:.1f},{y:.1f} {x + 7 * side:.1f},{y - 3.2:.1f} {x + 7 * side:.1f},{y + 3.2:.1f}"


def _svg_text(text: Text, is_first: bool = False) -> str:
    size, color, weight = _STYLE[text.style]
    content = escape(text.text)
    if is_first:
        name, _, rest = content.partition(":")
        content = f'<tspan font-weight="bold">{name}</tspan>:{rest}'
    return (
        f'<text x="{text.x:.1f}" y="{text.y:.1f}" font-size="{size:g}" fill="{color}" font-weight="{weight}" '
        f'dominant-baseline="central" xml:space="preserve">{content}</text>'
    )


# ---- PNG


def write_png(chart: Chart, path: Path, highlight: Highlight | None = None, dpi: int = 130) -> None:
    """The same picture by matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    found = layout(chart)
    figure = Figure(figsize=(found.width / 72, found.height / 72), dpi=dpi)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, found.width), ylim=(found.height, 0))
    axes.axis("off")
    _paint(axes, found, highlight or Highlight())
    figure.savefig(path)


def _paint(axes, found: Layout, highlight: Highlight) -> None:
    from matplotlib.patches import Circle, FancyBboxPatch, Polygon

    def frame(x: float, y: float, width: float, height: float, radius: float, **style) -> None:
        rounding = f"round,pad=0,rounding_size={radius}"
        axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle=rounding, **style))

    def write(text: Text) -> None:
        size, color, weight = _STYLE[text.style]
        style = {"family": "DejaVu Sans Mono", "va": "center_baseline", "color": color, "parse_math": False}
        axes.text(text.x, text.y, text.text, fontsize=size, fontweight=weight, **style)

    for box in found.boxes:
        fill = fill_color(box.state, box.is_leaf, box.decides, highlight)
        frame(box.x, box.y, box.width, box.height, 9, facecolor=fill, edgecolor="#4a5866", linewidth=1.3)
        if box.is_final:
            frame(box.x + 3, box.y + 3, box.width - 6, box.height - 6, 7, facecolor="none", edgecolor="#4a5866")
        for text in box.texts:
            write(text)
    for row in found.rows:
        color, width = _stroke(row, highlight)
        for text in row.texts:
            write(text)
        if row.points:
            axes.plot(*zip(*row.points, strict=True), color=color, linewidth=width, solid_joinstyle="round")
            x, y = row.points[-1]
            axes.add_patch(Polygon([(x, y), (x + 7, y - 3.2), (x + 7, y + 3.2)], color=color, linewidth=0))
    for mark in found.marks:
        if mark.history is not None:
            axes.add_patch(Circle((mark.x, mark.y), 8, facecolor="white", edgecolor="#4a5866", zorder=3))
            axes.text(mark.x, mark.y, "H*", fontsize=9, ha="center", va="center", zorder=4)
        elif mark.to is not None:
            x, y = mark.to
            axes.add_patch(Circle((mark.x, mark.y), 4, color="#1c2733", linewidth=0))
            axes.plot([mark.x, x - 5], [y, y], color="#1c2733", linewidth=1)
            axes.add_patch(Polygon([(x, y), (x - 7, y - 3.2), (x - 7, y + 3.2)], color="#1c2733", linewidth=0))
