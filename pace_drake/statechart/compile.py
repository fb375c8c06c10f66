"""Compiles a chart into one pure function: ``react(x, u, p, t) -> (x, fired)``.

All state of a chart is one numeric vector::

    x = [leaf, history_1, ..., variable_1, ...]

``leaf`` is the index of the active leaf state, ``history_k`` the leaf that was active when its region was last left
(-1 before that). One reaction (Lee & Seshia, Introduction to Embedded Systems, ch. 5) takes at most one
transition:

1. preemptive transitions, of the outermost active state first;
2. then the other transitions, of the innermost active state first;
3. transitions of one state in document order (a checked chart never has two enabled).

Taking one leaves its source, remembers the leaf in every region with history that it leaves, executes the effects in
order, and enters the target: a compound state through its initial states (reset), a history through the remembered
leaf.
"""

import ast
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pace_drake.statechart.expressions import ExpressionError, parse_expression
from pace_drake.statechart.model import Chart, Transition

#: (x, u, p, t) -> (new x, index of the transition that fired or -1); x itself is never changed.
React = Callable[[np.ndarray, np.ndarray, np.ndarray, float], tuple[np.ndarray, int]]


@dataclass(frozen=True)
class CompiledChart:
    """A chart and its reaction function.

    Attributes:
        chart: the source.
        react: pure; see the module's description.
        next_deadline: ``(x, u, p, t) -> time [s]``: when a timed guard of the active state becomes true; inf if none
            will.
        source: the Python text of both, for reading.
    """

    chart: Chart
    react: React
    next_deadline: Callable[[np.ndarray, np.ndarray, np.ndarray, float], float]
    source: str

    @cached_property
    def variable_index(self) -> dict[str, int]:
        """Name of a variable -> its place in x."""
        return _variable_index(self.chart)

    @cached_property
    def input_index(self) -> dict[str, int]:
        """Name of an input -> its place in u."""
        return {name: k for k, name in enumerate(self.chart.inputs)}

    def initial_state(self, **values: float) -> np.ndarray:
        """x before the first reaction, with the chart's values for variables where nothing is given."""
        chart = self.chart
        if unknown := set(values) - set(chart.variables):
            raise KeyError(f"{chart.name} has no variable {', '.join(sorted(unknown))}")
        leaf = chart.leaves.index(chart.initial_leaf(chart.initial))
        return np.array([leaf, *[-1.0] * len(chart.histories), *(chart.variables | values).values()], dtype=float)

    def parameters(self, **values: float) -> np.ndarray:
        """p, with the chart's defaults where nothing is given.

        Raises:
            KeyError: a name that is not a parameter of the chart.
        """
        if unknown := set(values) - set(self.chart.parameters):
            raise KeyError(f"{self.chart.name} has no parameter {', '.join(sorted(unknown))}")
        return np.array([values.get(name, default) for name, default in self.chart.parameters.items()], dtype=float)

    def inputs(self, **values: float) -> np.ndarray:
        """u, with the chart's defaults where nothing is given."""
        if unknown := set(values) - set(self.chart.inputs):
            raise KeyError(f"{self.chart.name} has no input {', '.join(sorted(unknown))}")
        return np.array([values.get(name, default) for name, default in self.chart.inputs.items()], dtype=float)

    def leaf(self, x: np.ndarray) -> str:
        """Name of the active leaf state."""
        return self.chart.leaves[int(x[0])]

    def entered_leaf(self, x: np.ndarray, target: str) -> str:
        """Name of the leaf in which a transition to ``target``, a state or a history, ends if taken from x."""
        chart = self.chart
        if target in chart.histories:
            remembered = int(x[1 + list(chart.histories).index(target)])
            return chart.leaves[remembered] if remembered >= 0 else chart.initial_leaf(chart.histories[target])
        return chart.initial_leaf(target)


def compile_chart(chart: Chart) -> CompiledChart:
    """Compiles a loaded chart. The code is built from checked syntax trees; no text of the file becomes code."""
    function = ast.FunctionDef(
        name="react",
        args=_arguments(),
        body=[
            *[_leaf_block(chart, index, leaf) for index, leaf in enumerate(chart.leaves)],
            _return(ast.Name("x", ast.Load()), -1),
        ],
        decorator_list=[],
    )
    deadline = ast.FunctionDef(name="next_deadline", args=_arguments(), body=_deadline_body(chart), decorator_list=[])
    module = ast.fix_missing_locations(ast.Module(body=[function, deadline], type_ignores=[]))
    namespace: dict = {"inf": float("inf")}
    exec(compile(module, f"<{chart.name}>", "exec"), namespace)
    return CompiledChart(chart, namespace["react"], namespace["next_deadline"], ast.unparse(module))


def _variable_index(chart: Chart) -> dict[str, int]:
    return {name: 1 + len(chart.histories) + k for k, name in enumerate(chart.variables)}


def _arguments() -> ast.arguments:
    return ast.arguments(
        posonlyargs=[], args=[ast.arg(name) for name in "xupt"], kwonlyargs=[], kw_defaults=[], defaults=[]
    )


def _item(vector: str, index: int, context: ast.expr_context | None = None) -> ast.expr:
    return ast.Subscript(ast.Name(vector, ast.Load()), ast.Constant(index), context or ast.Load())


def _set(vector: str, index: int, value: ast.expr) -> ast.stmt:
    return ast.Assign(targets=[_item(vector, index, ast.Store())], value=value, lineno=0)


def _return(x: ast.expr, fired: int) -> ast.stmt:
    return ast.Return(ast.Tuple([x, ast.Constant(fired)], ast.Load()))


def _expression(chart: Chart, text: str, variables: str) -> ast.expr:
    """Parses ``text`` with variables read from the vector named ``variables``."""
    places = {name: (variables, k) for name, k in _variable_index(chart).items()}
    places |= {name: ("u", k) for k, name in enumerate(chart.inputs)}
    places |= {name: ("p", k) for k, name in enumerate(chart.parameters)}

    def resolve(name: str) -> ast.expr:
        if name == chart.time:
            return ast.Name("t", ast.Load())
        if name not in places:
            raise ExpressionError(f"unknown name {name!r}")
        return _item(*places[name])

    return parse_expression(text, resolve)


def _ordered(chart: Chart, leaf: str) -> list[tuple[int, Transition]]:
    """Transitions that can fire in ``leaf``, in the order in which they are tested."""
    inner_first = chart.ancestors(leaf)
    of = {state: [(k, t) for k, t in enumerate(chart.transitions) if t.source == state] for state in inner_first}
    preemptive = [pair for state in reversed(inner_first) for pair in of[state] if pair[1].preemptive]
    return preemptive + [pair for state in inner_first for pair in of[state] if not pair[1].preemptive]


def _leaf_block(chart: Chart, index: int, leaf: str) -> ast.stmt:
    body: list[ast.stmt] = []
    for number, transition in _ordered(chart, leaf):
        steps: list[ast.stmt] = [
            ast.Assign(
                targets=[ast.Name("y", ast.Store())],
                value=ast.Call(ast.Attribute(ast.Name("x", ast.Load()), "copy", ast.Load()), [], []),
                lineno=0,
            )
        ]
        entered = set(chart.ancestors(chart.histories.get(transition.target, transition.target)))
        for k, region in enumerate(chart.histories.values()):
            # A self-transition of the region leaves it as well.
            left = region in chart.ancestors(leaf) and (
                region not in entered or region in chart.ancestors(transition.source)[:1]
            )
            if left:
                steps.append(_set("y", 1 + k, ast.Constant(float(index))))
        variable = _variable_index(chart)
        steps += [_set("y", variable[name], _expression(chart, text, "y")) for name, text in transition.effects]
        if transition.target in chart.histories:
            region = chart.histories[transition.target]
            remembered = _item("x", 1 + list(chart.histories).index(transition.target))
            default = ast.Constant(float(chart.leaves.index(chart.initial_leaf(region))))
            entry: ast.expr = ast.IfExp(ast.Compare(remembered, [ast.GtE()], [ast.Constant(0.0)]), remembered, default)
        else:
            entry = ast.Constant(float(chart.leaves.index(chart.initial_leaf(transition.target))))
        steps += [_set("y", 0, entry), _return(ast.Name("y", ast.Load()), number)]
        body.append(ast.If(test=_expression(chart, transition.guard, "x"), body=steps, orelse=[]))
    test = ast.Compare(_item("x", 0), [ast.Eq()], [ast.Constant(float(index))])
    return ast.If(test=test, body=[*body, _return(ast.Name("x", ast.Load()), -1)], orelse=[])


def _deadline_body(chart: Chart) -> list[ast.stmt]:
    body: list[ast.stmt] = [ast.Assign([ast.Name("best", ast.Store())], ast.Name("inf", ast.Load()), lineno=0)]
    for index, leaf in enumerate(chart.leaves):
        steps: list[ast.stmt] = []
        for _, transition in _ordered(chart, leaf):
            if transition.deadline is not None:
                at = ast.Name("at", ast.Load())
                steps += [
                    ast.Assign([ast.Name("at", ast.Store())], _expression(chart, transition.deadline, "x"), lineno=0),
                    ast.If(
                        test=ast.Compare(
                            ast.Name("t", ast.Load()),
                            [ast.Lt(), ast.Lt()],
                            [at, ast.Name("best", ast.Load())],
                        ),
                        body=[ast.Assign([ast.Name("best", ast.Store())], at, lineno=0)],
                        orelse=[],
                    ),
                ]
        if steps:
            test = ast.Compare(_item("x", 0), [ast.Eq()], [ast.Constant(float(index))])
            body.append(ast.If(test=test, body=steps, orelse=[]))
    return [*body, ast.Return(ast.Name("best", ast.Load()))]
