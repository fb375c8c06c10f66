"""Compiles a chart into one pure function: ``react(x, u, p, t) -> (x, fired)``.

All state of a chart is one numeric vector::

    x = [leaf, history_1, ..., variable_1, ...]

``leaf`` is the index of the active leaf state, ``history_k`` the leaf that was active when its region was last left
(-1 before that). One reaction (Lee & Seshia, Introduction to Embedded Systems, ch. 5) takes at most one
transition:

1. preemptive transitions, of the outermost active state first;
2. then the other transitions, of the innermost active state first;
3. transitions of one state: never two enabled (the loader proves it).

Taking one leaves its source, remembers the leaf in every region with history that it leaves, executes the effects in
order, and enters the target: a compound state through its initial states (reset), a history through the remembered
leaf. A transition without a target executes its effects and leaves nothing.

The functions are plain Python over indexed reads: they take lists and arrays, and ``numba.njit`` takes them.
"""

import ast
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from pace_drake.statechart.expressions import Expression
from pace_drake.statechart.model import Chart, Transition

#: A vector: numpy array or list.
Vector: TypeAlias = Any
#: (x, u, p, t) -> (new x, index of the transition that fired or -1); x itself is never changed.
React = Callable[[Vector, Vector, Vector, float], tuple[Vector, int]]

#: A chain of reactions at one instant ends after this many; a chart that needs more does not come to rest.
MAX_CHAIN = 8


class NoRestError(RuntimeError):
    """A chart goes on reacting at one instant."""


@dataclass(frozen=True)
class CompiledChart:
    """A chart and its functions.

    Attributes:
        chart: the source.
        react: pure; see the module's description.
        react_in_place: ``(x, u, p, t) -> fired``: the same reaction, written into x; for numba kernels.
        outputs: ``(x, p) -> tuple``: the chart's outputs, in the order in which it declares them.
        next_deadline: ``(x, u, p, t) -> time [s]``: the first time after t at which a timed guard of the active state
            may become true; inf if none will.
        source: the Python text of all, for reading.
    """

    chart: Chart
    react: React
    react_in_place: Callable[[Vector, Vector, Vector, float], int]
    outputs: Callable[[Vector, Vector], tuple[float, ...]]
    next_deadline: Callable[[Vector, Vector, Vector, float], float]
    source: str

    @cached_property
    def variable_index(self) -> dict[str, int]:
        """Name of a variable -> its place in x."""
        return _variable_index(self.chart)

    @cached_property
    def input_index(self) -> dict[str, int]:
        """Name of an input -> its place in u."""
        return {name: k for k, name in enumerate(self.chart.inputs)}

    @cached_property
    def output_index(self) -> dict[str, int]:
        """Name of an output -> its place in what ``outputs`` returns."""
        return {name: k for k, name in enumerate(self.chart.outputs)}

    def initial_state(self, **values: float) -> np.ndarray:
        """x before the first reaction, with the chart's values for variables where nothing is given.

        Raises:
            KeyError: a name that is not a variable of the chart.
        """
        chart = self.chart
        leaf = chart.leaves.index(chart.initial_leaf(chart.initial))
        variables = _values("variable", chart, chart.variables, values)
        return np.array([leaf, *[-1.0] * len(chart.histories), *variables], dtype=float)

    def parameters(self, **values: float) -> np.ndarray:
        """p, with the chart's defaults where nothing is given.

        Raises:
            KeyError: a name that is not a parameter of the chart.
        """
        return np.array(_values("parameter", self.chart, self.chart.parameters, values), dtype=float)

    def inputs(self, **values: float) -> np.ndarray:
        """u, with the chart's defaults where nothing is given.

        Raises:
            KeyError: a name that is not an input of the chart.
        """
        return np.array(_values("input", self.chart, self.chart.inputs, values), dtype=float)

    def leaf(self, x: Vector) -> str:
        """Name of the active leaf state."""
        return self.chart.leaves[int(x[0])]

    def react_to_rest(
        self, x: Vector, u: Vector, p: Vector, t: float, answer: Callable[[], float] | None = None
    ) -> tuple[Vector, list[int], list[int]]:
        """Reacts at one instant until nothing is enabled: a chain of zero-time reactions.

        All reactions read the same inputs, but for the decision: it is absent (at its declared value) except in the
        first reaction of the chain in a state that asks for it. So one answer is taken once.

        Args:
            x: state; never changed.
            u: inputs; what it holds for the decision is not read.
            p: parameters.
            t: time [s].
            answer: gives the decision, called at most once, when it is asked for; None: it stays absent.

        Returns:
            (x at rest, transitions taken, leaves in which they ended).

        Raises:
            NoRestError: more than ``MAX_CHAIN`` reactions.
        """
        fired: list[int] = []
        leaves: list[int] = []
        place = -1 if self.chart.decision is None else self.input_index[self.chart.decision]
        if place >= 0:
            u = u.copy()
            absent = self.chart.inputs[self.chart.decision]  # type: ignore[index]
            u[place] = absent
        while True:
            if answer is not None and self._decides[int(x[0])]:
                u[place], answer = answer(), None
                x_next, transition = self.react(x, u, p, t)
                u[place] = absent
            else:
                x_next, transition = self.react(x, u, p, t)
            if transition < 0:
                return x, fired, leaves
            if len(fired) == MAX_CHAIN:
                names = " ".join(self.chart.transitions[k].id for k in fired)
                raise NoRestError(f"the chart does not come to rest at t = {t} s: {names} ...")
            fired.append(transition)
            leaves.append(int(x_next[0]))
            x = x_next

    @cached_property
    def _decides(self) -> list[bool]:
        return [self.chart.states[leaf].decision is not None for leaf in self.chart.leaves]


def compile_chart(chart: Chart) -> CompiledChart:
    """Compiles a loaded chart. The code is built from checked syntax trees; no text of the file becomes code."""
    writer = _Writer(chart)
    module = ast.Module(
        body=[
            _function("react", "xupt", writer.reactions(in_place=False)),
            _function("react_in_place", "xupt", writer.reactions(in_place=True)),
            _function("outputs", "xp", writer.outputs()),
            _function("next_deadline", "xupt", writer.deadlines()),
        ],
        type_ignores=[],
    )
    ast.fix_missing_locations(module)
    namespace: dict[str, Any] = {"inf": math.inf}
    exec(compile(module, f"<{chart.name}>", "exec"), namespace)
    return CompiledChart(
        chart,
        namespace["react"],
        namespace["react_in_place"],
        namespace["outputs"],
        namespace["next_deadline"],
        ast.unparse(module),
    )


def _values(kind: str, chart: Chart, declared: dict[str, float], given: dict[str, float]) -> list[float]:
    if unknown := set(given) - set(declared):
        raise KeyError(f"{chart.name} has no {kind} {', '.join(sorted(unknown))}")
    return list((declared | given).values())


def _variable_index(chart: Chart) -> dict[str, int]:
    return {name: 1 + len(chart.histories) + k for k, name in enumerate(chart.variables)}


def _function(name: str, arguments: str, body: list[ast.stmt]) -> ast.stmt:
    names = [ast.arg(argument) for argument in arguments]
    signature = ast.arguments(posonlyargs=[], args=names, kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.FunctionDef(name=name, args=signature, body=body, decorator_list=[])


def _read(name: str) -> ast.expr:
    return ast.Name(name, ast.Load())


def _item(vector: str, index: int) -> ast.expr:
    return ast.Subscript(_read(vector), ast.Constant(index), ast.Load())


def _set(vector: str, index: int, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Subscript(_read(vector), ast.Constant(index), ast.Store())], value, lineno=0)


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(name, ast.Store())], value, lineno=0)


def _less(left: ast.expr, right: ast.expr) -> ast.expr:
    return ast.Compare(left, [ast.Lt()], [right])


class _Writer:
    """Writes the bodies of the functions."""

    def __init__(self, chart: Chart) -> None:
        self._chart = chart
        self._number = {transition.id: k for k, transition in enumerate(chart.transitions)}
        self._history = {name: 1 + k for k, name in enumerate(chart.histories)}
        self._variable = _variable_index(chart)
        self._places = {name: ("u", k) for k, name in enumerate(chart.inputs)}
        self._places |= {name: ("p", k) for k, name in enumerate(chart.parameters)}

    def reactions(self, in_place: bool) -> list[ast.stmt]:
        """The body of ``react`` or ``react_in_place``."""
        blocks = [
            [*(self._transition(leaf, t, in_place) for t in self._chart.candidates(leaf)), self._rest(in_place)]
            for leaf in self._chart.leaves
        ]
        return [_assign("leaf", _item("x", 0)), *self._by_leaf(blocks)]

    def outputs(self) -> list[ast.stmt]:
        """The body of ``outputs``."""
        blocks: list[list[ast.stmt]] = [
            [
                ast.Return(
                    ast.Tuple([self._expression(self._chart.output(leaf, o)) for o in self._chart.outputs], ast.Load())
                )
            ]
            for leaf in self._chart.leaves
        ]
        return [_assign("leaf", _item("x", 0)), *self._by_leaf(blocks)]

    def deadlines(self) -> list[ast.stmt]:
        """The body of ``next_deadline``."""
        body: list[ast.stmt] = [_assign("leaf", _item("x", 0)), _assign("best", _read("inf"))]
        for index, leaf in enumerate(self._chart.leaves):
            steps: list[ast.stmt] = []
            for bound in (bound for t in self._chart.candidates(leaf) for bound in t.deadlines):
                sooner = ast.Compare(_read("t"), [ast.Lt(), ast.Lt()], [_read("at"), _read("best")])
                steps += [
                    _assign("at", self._expression(bound)),
                    ast.If(sooner, [_assign("best", _read("at"))], []),
                ]
            if steps:
                body.append(ast.If(ast.Compare(_read("leaf"), [ast.Eq()], [ast.Constant(index)]), steps, []))
        return [*body, ast.Return(_read("best"))]

    def _by_leaf(self, blocks: Sequence[list[ast.stmt]], first: int = 0) -> list[ast.stmt]:
        """Finds the block of the active leaf by halving."""
        if len(blocks) == 1:
            return blocks[0]
        half = len(blocks) // 2
        lower, upper = self._by_leaf(blocks[:half], first), self._by_leaf(blocks[half:], first + half)
        return [ast.If(_less(_read("leaf"), ast.Constant(first + half)), lower, upper)]

    def _rest(self, in_place: bool) -> ast.stmt:
        none = ast.Constant(-1)
        return ast.Return(none if in_place else ast.Tuple([_read("x"), none], ast.Load()))

    def _transition(self, leaf: str, transition: Transition, in_place: bool) -> ast.stmt:
        chart, y = self._chart, "x" if in_place else "y"
        steps: list[ast.stmt] = []
        if not in_place:
            steps.append(_assign("y", ast.Call(ast.Attribute(_read("x"), "copy", ast.Load()), [], [])))
        exited = chart.exited(leaf, transition)
        for name, region in chart.histories.items():
            if region in exited:
                steps.append(_set(y, self._history[name], ast.Constant(float(chart.leaves.index(leaf)))))
        for name, expression in transition.effects:
            steps.append(_set(y, self._variable[name], self._expression(expression, y)))
        if transition.target is not None:
            steps.append(_set(y, 0, self._entry(transition.target, y)))
        number = ast.Constant(self._number[transition.id])
        steps.append(ast.Return(number if in_place else ast.Tuple([_read("y"), number], ast.Load())))
        return ast.If(self._expression(transition.guard), steps, [])

    def _entry(self, target: str, y: str) -> ast.expr:
        def index(leaf: str) -> ast.expr:
            return ast.Constant(float(self._chart.leaves.index(leaf)))

        if target not in self._history:
            return index(self._chart.initial_leaf(target))
        remembered = _item(y, self._history[target])
        known = ast.Compare(remembered, [ast.GtE()], [ast.Constant(0.0)])
        return ast.IfExp(known, remembered, index(self._chart.history_default_leaf(target)))

    def _expression(self, expression: Expression, x: str = "x") -> ast.expr:
        """Reads variables from the vector named ``x``."""

        def resolve(name: str) -> ast.expr:
            if name == self._chart.time:
                return _read("t")
            if name in self._chart.constants:
                return ast.Constant(self._chart.constants[name])
            if name in self._variable:
                return _item(x, self._variable[name])
            return _item(*self._places[name])

        return expression.python(resolve)
