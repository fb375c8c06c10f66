"""A statechart as Mermaid text, for READMEs."""

from pace_drake.statechart.layout import label
from pace_drake.statechart.model import Chart


def to_mermaid(chart: Chart) -> str:
    """``stateDiagram-v2`` text. Mermaid has no history and no preemption; labels say so."""
    lines = ["stateDiagram-v2", f"    [*] --> {chart.initial}"]

    def add(state: str, indent: str) -> None:
        children = [child.id for child in chart.states.values() if child.parent == state]
        if not children:
            lines.append(f"{indent}{state}")
            return
        lines.append(f"{indent}state {state} {{")
        lines.append(f"{indent}    [*] --> {chart.states[state].initial}")
        for child in children:
            add(child, indent + "    ")
        lines.append(f"{indent}}}")

    for state in chart.states.values():
        if state.parent is None:
            add(state.id, "    ")
    for transition in chart.transitions:
        target = transition.target or transition.source
        notes = [
            *(["preemptive"] if transition.preemptive else []),
            *(["history"] if target in chart.histories else []),
            *(["internal"] if transition.target is None else []),
        ]
        text = label(transition) + (f" ({', '.join(notes)})" if notes else "")
        lines.append(f"    {transition.source} --> {chart.histories.get(target, target)}: {_for_mermaid(text)}")
    return "\n".join(lines) + "\n"


def _for_mermaid(text: str) -> str:
    """Mermaid reads ``:`` and ``;`` as its own, and the text as HTML."""
    codes = {"#": "#35;", ";": ",", ":": "", "<": "#lt;", ">": "#gt;", "&": "#amp;"}
    return "".join(codes.get(character, character) for character in text)
