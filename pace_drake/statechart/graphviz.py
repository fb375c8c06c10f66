"""A statechart as Graphviz text, and by Graphviz itself where it is installed."""

import shutil
import subprocess

from pace_drake.statechart.draw import FIRED, PREEMPTIVE, Highlight, fill_color
from pace_drake.statechart.layout import label
from pace_drake.statechart.model import Chart


def has_dot() -> bool:
    """Whether the program ``dot`` is installed."""
    return shutil.which("dot") is not None


def svg_by_dot(chart: Chart, highlight: Highlight | None = None) -> str:
    """The picture of a chart, laid out by ``dot``; ids as in ``draw.to_svg``.

    Raises:
        OSError: ``dot`` is not installed, or cannot draw it.
    """
    done = subprocess.run(["dot", "-Tsvg"], input=to_dot(chart, highlight), capture_output=True, text=True, timeout=60)
    if done.returncode != 0:
        raise OSError(f"dot: {done.stderr.strip()}")
    return done.stdout


def to_dot(chart: Chart, highlight: Highlight | None = None) -> str:
    """Graphviz text, with compound states as clusters; ``dot -Tsvg`` makes a picture of it."""
    highlight = highlight or Highlight()
    lines = [
        f'digraph "{chart.name}" {{',
        '  compound=true; rankdir=TB; node [shape=box, style="rounded,filled", fillcolor=white, fontname="Helvetica"];',
        '  edge [fontname="Helvetica", fontsize=10];',
        f'  "__initial" [shape=point]; "__initial" -> "{chart.initial_leaf(chart.initial)}";',
    ]

    def add(state: str, indent: str) -> None:
        children = [child.id for child in chart.states.values() if child.parent == state]
        fill = fill_color(state, not children, chart.states[state].decision is not None, highlight)
        if not children:
            final = ", peripheries=2" if chart.states[state].final else ""
            lines.append(f'{indent}"{state}" [id="state-{state}", fillcolor="{fill}"{final}];')
            return
        lines.append(
            f'{indent}subgraph "cluster_{state}" {{ label="{state}"; style="rounded,filled"; id="state-{state}";'
        )
        lines.append(f'{indent}  fillcolor="{fill}"; "__{state}" [shape=point];')
        lines.append(f'{indent}  "__{state}" -> "{chart.initial_leaf(state)}";')
        history = chart.states[state].history
        if history is not None:
            lines.append(f'{indent}  "{history}" [shape=circle, label="H*", fontsize=9];')
        for child in children:
            add(child, indent + "  ")
        lines.append(f"{indent}}}")

    for state in chart.states.values():
        if state.parent is None:
            add(state.id, "  ")
    for transition in chart.transitions:
        lines.append(f"  {_dot_edge(chart, transition, highlight)}")
    return "\n".join([*lines, "}"]) + "\n"


def _dot_edge(chart: Chart, transition, highlight: Highlight) -> str:
    target = transition.target or transition.source
    ends = {"tail": transition.source, "head": target}
    nodes = {end: state if state in chart.histories else chart.initial_leaf(state) for end, state in ends.items()}
    clusters = "".join(
        f', l{end}="cluster_{state}"' for end, state in ends.items() if nodes[end] != state and state in chart.states
    )
    color = FIRED if transition.id in highlight.fired else PREEMPTIVE if transition.preemptive else "#4a5866"
    text = label(transition).replace("\\", "\\\\").replace('"', '\\"').replace(" / ", "\\n/ ").replace("; ", ";\\n")
    return (
        f'"{nodes["tail"]}" -> "{nodes["head"]}" [id="transition-{transition.id}", label="{text}", '
        f'color="{color}"{clusters}];'
    )
