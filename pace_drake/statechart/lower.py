"""Lowers a chart to what other engines run: plain SCXML with ECMAScript expressions, and sismic's YAML.

One reaction is one external event ``react`` whose data are the inputs and the time. SCXML tests the innermost state
first, always; preemption is therefore written into the guards: a transition is guarded by the negation of every
preemptive guard of the states around its source. Parameters and variables are data of the plain chart; constants are
written out. Outputs, types and decisions are not part of SCXML and are left behind.
"""

import ast
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import yaml

from pace_drake.statechart.compile import CompiledChart
from pace_drake.statechart.expressions import Expression, conjunction, negation, to_text
from pace_drake.statechart.model import Chart, Transition

EVENT = "react"


def lowered_guard(chart: Chart, transition: Transition) -> ast.expr:
    """The guard of a transition for an engine that tests the innermost state first."""
    around = chart.ancestors(transition.source)[1:]
    earlier = [t for t in chart.transitions if t.preemptive and t.source in around]
    guard = [] if transition.guard.text == "1 == 1" and earlier else [transition.guard.tree]
    return conjunction([*guard, *(negation(t.guard.tree) for t in earlier)])


def to_scxml(compiled: CompiledChart, parameters: Mapping[str, float] | None = None, **initial: float) -> str:
    """Plain SCXML (W3C, ECMAScript data model).

    Args:
        compiled: the chart.
        parameters: values instead of the chart's own.
        **initial: values of variables instead of the chart's own.
    """
    chart = compiled.chart
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<!-- Made from {chart.name}.scxml by `pace chart lower`; do not edit. One reaction is one event {EVENT!r},",
        f"     with the inputs {', '.join(chart.inputs) or '(none)'} and the time {chart.time} [s] as its data. -->",
        f'<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name={quoteattr(chart.name)} '
        f'datamodel="ecmascript" initial={quoteattr(chart.initial)}>',
        "  <datamodel>",
    ]
    for name, value in _data(chart, parameters or {}, initial).items():
        lines.append(f'    <data id={quoteattr(name)} expr="{_number(value)}"/>')
    lines.append("  </datamodel>")
    for state in chart.states.values():
        if state.parent is None:
            lines += _state(chart, state.id, "  ")
    return "\n".join([*lines, "</scxml>"]) + "\n"


def _data(chart: Chart, parameters: Mapping[str, float], initial: Mapping[str, float]) -> dict[str, float]:
    return chart.parameters | dict(parameters) | chart.variables | dict(initial)


def _number(value: float) -> str:
    return to_text(ast.Constant(float(value)))


def _ecmascript(chart: Chart, tree: ast.expr) -> str:
    def name(text: str) -> str:
        if text in chart.inputs or text == chart.time:
            return f"_event.data.{text}"
        return _number(chart.constants[text]) if text in chart.constants else text

    return to_text(tree, name)


def _state(chart: Chart, state: str, indent: str) -> list[str]:
    initial = chart.states[state].initial
    opening = f"{indent}<state id={quoteattr(state)}" + (f" initial={quoteattr(initial)}" if initial else "")
    inside: list[str] = []
    history = chart.states[state].history
    if history is not None:
        default = quoteattr(chart.states[state].history_default or str(initial))
        inside.append(
            f'{indent}  <history id={quoteattr(history)} type="deep"><transition target={default}/></history>'
        )
    for transition in chart.transitions:
        if transition.source != state:
            continue
        guard = quoteattr(_ecmascript(chart, lowered_guard(chart, transition)))
        target = f" target={quoteattr(transition.target)}" if transition.target is not None else ""
        head = f'{indent}  <transition event="{EVENT}" cond={guard}{target}'
        if not transition.effects:
            inside.append(f"{head}/>")
            continue
        inside.append(f"{head}>")
        for name, expression in transition.effects:
            value = quoteattr(_ecmascript(chart, expression.tree))
            inside.append(f"{indent}    <assign location={quoteattr(name)} expr={value}/>")
        inside.append(f"{indent}  </transition>")
    for child in chart.states.values():
        if child.parent == state:
            inside += _state(chart, child.id, indent + "  ")
    return [f"{opening}>", *inside, f"{indent}</state>"] if inside else [f"{opening}/>"]


def to_sismic(compiled: CompiledChart, parameters: Mapping[str, float] | None = None, **initial: float) -> str:
    """A statechart of the Python package sismic, as YAML; its expressions are Python.

    Args:
        compiled: the chart.
        parameters: values instead of the chart's own.
        **initial: values of variables instead of the chart's own.
    """
    chart = compiled.chart
    values = _data(chart, parameters or {}, initial)
    preamble = [f"{name} = {_number(value)}" for name, value in values.items()]
    top = [state.id for state in chart.states.values() if state.parent is None]
    root = {"name": "ROOT", "initial": chart.initial, "states": [_sismic_state(chart, state) for state in top]}
    chart_data = {"statechart": {"name": chart.name, "preamble": "\n".join(preamble), "root state": root}}
    return yaml.safe_dump(chart_data, sort_keys=False, width=1000)


def _sismic_state(chart: Chart, state: str) -> dict:
    found: dict = {"name": state}
    children = [child.id for child in chart.states.values() if child.parent == state]
    if children:
        found["initial"] = chart.states[state].initial
        found["states"] = [_sismic_state(chart, child) for child in children]
    history = chart.states[state].history
    if history is not None:
        memory = chart.states[state].history_default or chart.states[state].initial
        found["states"].append({"name": history, "type": "deep history", "memory": memory})
    transitions = []
    for transition in chart.transitions:
        if transition.source != state:
            continue
        entry = {"event": EVENT, "guard": _python(chart, lowered_guard(chart, transition))}
        if transition.target is not None:
            entry["target"] = transition.target
        if transition.effects:
            entry["action"] = "\n".join(f"{n} = {_python(chart, e.tree)}" for n, e in transition.effects)
        transitions.append(entry)
    if transitions:
        found["transitions"] = transitions
    return found


def _python(chart: Chart, tree: ast.expr) -> str:
    def resolve(name: str) -> ast.expr:
        if name in chart.inputs or name == chart.time:
            return ast.Attribute(ast.Name("event", ast.Load()), name, ast.Load())
        return ast.Constant(chart.constants[name]) if name in chart.constants else ast.Name(name, ast.Load())

    return ast.unparse(ast.fix_missing_locations(Expression("", tree).python(resolve)))
