"""One chart of a composition, with its states made small: what can never matter again is forgotten.

A state is kept relative to now and to a sequence number, which is sound because every guard and effect keeps the
degrees of times and sequence numbers (``expressions.Unit``):

- a time is stored as ``v - now``, cut off at the horizon: times further back are alike to every guard;
- a sequence number as its distance from the reference of the composition;
- a variable or history that no guard, connection or property can read before it is written again is set to 0 (-1).
"""

import ast
import itertools
from collections.abc import Iterable
from dataclasses import dataclass

from pace_drake.errors import InputError
from pace_drake.statechart.check.spec import ComponentSpec
from pace_drake.statechart.compile import Vector
from pace_drake.statechart.expressions import SEQUENCE, TIME, Expression, function_of
from pace_drake.statechart.model import Transition, time_bounds

#: Values of one state: leaf, histories, variables, then outputs.
Values = tuple[float, ...]
#: A leaf and the memories of the histories.
_Node = tuple[int, ...]
#: Names of variables and histories.
_Live = frozenset[str]


@dataclass(frozen=True)
class Successor:
    """What one component may do in one tick.

    Attributes:
        after: id of the state after it, with all that properties and immediate readers see.
        next: id of the state at the beginning of the next tick.
        fired: indices of the transitions taken.
        u: the inputs that were read.
    """

    after: int
    next: int
    fired: tuple[int, ...]
    u: tuple[float, ...]


@dataclass(frozen=True)
class Observed:
    """What others see of a component.

    Attributes:
        before: variables and outputs that are read before a tick, by connections or properties.
        after: variables and outputs that properties read after it.
        immediate: outputs that connections read after it.
        inputs: inputs that properties read.
        fired: whether properties tell transitions apart.
    """

    before: frozenset[str] = frozenset()
    after: frozenset[str] = frozenset()
    immediate: frozenset[str] = frozenset()
    inputs: frozenset[str] = frozenset()
    fired: bool = False


class Component:
    """States and successors of one chart, each found once and numbered.

    Args:
        spec: the chart and its values.
        observed: what others see of it.
        free: input -> values that it may have.
        connected: inputs that other components give.
        horizon: [ticks].
    """

    def __init__(
        self,
        spec: ComponentSpec,
        observed: Observed,
        free: dict[str, tuple[float, ...]],
        connected: set[str],
        horizon: float,
    ) -> None:
        self.spec = spec
        self.chart = spec.compiled.chart
        self._p = spec.compiled.parameters(**spec.parameters).tolist()
        self._defaults = spec.compiled.inputs().tolist()
        self._observed = observed
        self._free = free
        self._horizon = horizon
        self._histories = list(self.chart.histories)
        self._size = 1 + len(self._histories) + len(self.chart.variables)
        #: Place of a history, variable or output in the values of a state.
        self.place = (
            {name: 1 + k for k, name in enumerate(self._histories)}
            | spec.compiled.variable_index
            | {name: self._size + k for k, name in enumerate(self.chart.outputs)}
        )
        units = self.chart.units()
        self._times = [k for name, k in spec.compiled.variable_index.items() if units[name] == TIME]
        self._sequences = [k for name, k in spec.compiled.variable_index.items() if units[name] == SEQUENCE]
        reads = [self._inputs_read(leaf) for leaf in self.chart.leaves]
        self._open = [[name for name in names if name in free] for names in reads]
        #: For each leaf, inputs that it reads from other components.
        self.connected_reads = [[name for name in names if name in connected] for names in reads]
        self._dead, self._dead_after = self._liveness()
        self._ids: dict[Values, int] = {}
        self.values: list[Values] = []
        self._successors: dict[tuple, list[Successor]] = {}

    # ---- states

    def initial(self) -> int:
        """Id of the initial state."""
        return self._intern(self.spec.compiled.initial_state(**self.spec.initial).tolist(), self._dead)

    def numbers(self, state: int) -> list[float]:
        """Sequence numbers that are stored."""
        values = self.values[state]
        return [values[place] for place in self._sequences]

    def counted_anew(self, state: int, anew: dict[float, float]) -> int:
        """The same state with every sequence number replaced."""
        if not self._sequences:
            return state
        x = list(self.values[state][: self._size])
        for place in self._sequences:
            x[place] = anew[x[place]]
        return self._intern(x, self._dead)

    def _intern(self, x: list[float], dead: dict[_Node, list[tuple[int, float]]]) -> int:
        for place, value in dead[tuple(int(v) for v in x[: 1 + len(self._histories)])]:
            x[place] = value
        key = tuple(x)
        if key not in self._ids:
            self._ids[key] = len(self.values)
            self.values.append(key + tuple(self.spec.compiled.outputs(x, self._p)))
        return self._ids[key]

    def _next(self, y: list[float]) -> int:
        """The state at the beginning of the next tick: one older."""
        x = y.copy()
        for place in self._times:
            x[place] = max(x[place] - 1.0, -self._horizon)
        return self._intern(x, self._dead)

    # ---- successors

    def successors(
        self, state: int, given: tuple[float, ...], needed: frozenset[str], fixed: tuple[tuple[str, float], ...] = ()
    ) -> list[Successor]:
        """All that can happen in one tick.

        Args:
            state: id.
            given: values of ``connected_reads`` of its leaf.
            needed: outputs that are read at once; two successors that differ in others alone are one.
            fixed: free inputs that have one value.

        Raises:
            ArithmeticError, ValueError, NoRestError: the chart itself fails.
        """
        key = (state, given, needed, fixed)
        if key not in self._successors:
            self._successors[key] = self._react(state, given, needed, dict(fixed))
        return self._successors[key]

    def _react(
        self, state: int, given: tuple[float, ...], needed: frozenset[str], fixed: dict[str, float]
    ) -> list[Successor]:
        x = list(self.values[state][: self._size])
        leaf = int(x[0])
        u = self._defaults.copy()
        index = self.spec.compiled.input_index
        for name, value in zip(self.connected_reads[leaf], given, strict=True):
            u[index[name]] = value
        told_apart = [self.place[name] for name in sorted(self._observed.after | needed)]
        inputs = [index[name] for name in sorted(self._observed.inputs)]
        unique: dict[tuple, Successor] = {}
        names = self._open[leaf]
        for values in itertools.product(*((fixed[n],) if n in fixed else self._free[n] for n in names)):
            for name, value in zip(names, values, strict=True):
                u[index[name]] = value
            y, fired = self.step(x, u)
            following, after = self._next(list(y)), self._intern(list(y), self._dead_after)
            signature = (
                following,
                fired if self._observed.fired else (),
                tuple(self.values[after][k] for k in told_apart),
                tuple(u[k] for k in inputs),
            )
            unique.setdefault(signature, Successor(after, following, fired, tuple(u)))
        return list(unique.values())

    def open_reads(self, leaf: int) -> list[str]:
        """Free inputs that are read in a leaf."""
        return self._open[leaf]

    @property
    def tells_transitions_apart(self) -> bool:
        """Whether ``Successor.fired`` is the one choice, and not one of several that end alike."""
        return self._observed.fired

    def step(self, x: list[float], u: list[float], time: float = 0.0) -> tuple[Vector, tuple[int, ...]]:
        """What the chart does in one tick: (x after it, transitions taken)."""
        compiled, decision = self.spec.compiled, self.chart.decision
        if self.spec.to_rest:
            answer = None if decision is None else lambda: u[compiled.input_index[decision]]
            y, fired, _ = compiled.react_to_rest(x, u, self._p, time, answer)
            return y, tuple(fired)
        y, transition = compiled.react(x, u, self._p, time)
        return y, () if transition < 0 else (transition,)

    def _inputs_read(self, leaf: str) -> list[str]:
        if self.spec.to_rest:
            return list(self.chart.inputs)
        names = set(self._observed.inputs)
        for transition in self.chart.candidates(leaf):
            names.update(transition.guard.names(), *(e.names() for _, e in transition.effects))
        return [name for name in self.chart.inputs if name in names]

    # ---- what can matter again

    def _liveness(self) -> tuple[dict[_Node, list[tuple[int, float]]], dict[_Node, list[tuple[int, float]]]]:
        """Places to be cleared, and their value then: before a tick, and after its reaction.

        The backward analysis of compilers, on the graph of leaves and memories with guards aside.
        """
        chart = self.chart
        memories = [
            [-1, *(k for k, leaf in enumerate(chart.leaves) if chart.histories[name] in chart.ancestors(leaf))]
            for name in self._histories
        ]
        nodes = list(itertools.product(range(len(chart.leaves)), *memories))
        seen_after = [
            self._variables_behind(leaf, self._observed.after | self._observed.immediate) for leaf in chart.leaves
        ]
        live: dict[_Node, _Live] = {node: frozenset() for node in nodes}
        changed = True
        while changed:
            changed = False
            for node in nodes:
                found = self._live_before(node, live, seen_after)
                if found != live[node]:
                    live[node], changed = found, True
        everything = {*chart.variables, *self._histories}

        def dead(kept: Iterable[str]) -> list[tuple[int, float]]:
            return [(self.place[n], -1.0 if n in chart.histories else 0.0) for n in everything.difference(kept)]

        return (
            {node: dead(live[node]) for node in nodes},
            {node: dead(live[node] | seen_after[node[0]]) for node in nodes},
        )

    def _variables_behind(self, leaf: str, names: Iterable[str]) -> set[str]:
        """Variables that are read to give variables and outputs in ``leaf``."""
        found: set[str] = set()
        for name in names:
            read = self.chart.output(leaf, name).names() if name in self.chart.outputs else [name]
            found |= self.chart.variables.keys() & set(read)
        return found

    def _live_before(self, node: _Node, live: dict[_Node, _Live], seen_after: list[set[str]]) -> _Live:
        chart, leaf = self.chart, self.chart.leaves[node[0]]
        found = self._variables_behind(leaf, self._observed.before)
        candidates = chart.candidates(leaf)
        if not any(t.guard.text == "1 == 1" for t in candidates):
            found |= seen_after[node[0]] | live[node]  # perhaps nothing fires
        for transition in candidates:
            found |= set(transition.guard.names())
            exited = chart.exited(leaf, transition)
            written = {name for name in self._histories if chart.histories[name] in exited}
            end = self._end(node, transition, written)
            kept = set(live[end] | seen_after[end[0]])
            for name, expression in reversed(transition.effects):
                if name in kept:
                    kept.discard(name)
                    kept |= set(expression.names())
            if transition.target in chart.histories:
                kept.add(transition.target)
            found |= kept - written
        return frozenset(found & {*chart.variables, *self._histories})

    def _end(self, node: _Node, transition: Transition, written: set[str]) -> _Node:
        chart = self.chart
        memory = [node[0] if name in written else node[1 + k] for k, name in enumerate(self._histories)]
        if transition.target is None:
            return (node[0], *memory)
        if transition.target not in chart.histories:
            return (chart.leaves.index(chart.initial_leaf(transition.target)), *memory)
        remembered = memory[self._histories.index(transition.target)]
        if remembered < 0:
            remembered = chart.leaves.index(chart.history_default_leaf(transition.target))
        return (remembered, *memory)


def check_steps_of_one(spec: ComponentSpec, counters: set[str]) -> None:
    """Sequence numbers further apart than 2 are alike if only counters move, by at most 1 at a time, and no comparison
    looks further than 1; then exploration may draw them together.

    Raises:
        InputError: a transition does something else with sequence numbers.
    """
    chart = spec.compiled.chart
    units = chart.units()
    values = chart.parameters | spec.parameters | chart.constants

    def offset(transition: Transition, tree: ast.expr) -> float:
        expression = Expression("", tree)
        numbers = {n: 0.0 for n in expression.names() if units[n] == SEQUENCE} | values
        if set(expression.names()) - set(numbers):
            raise fail(transition)
        return abs(function_of(expression.python(lambda name: ast.Constant(numbers[name])))())

    def fail(transition: Transition) -> InputError:
        return InputError(
            f"{chart.path}:{transition.line}: {transition.id!r} looks or steps further than 1 in a sequence; type its "
            "numbers as integer, or count in steps of one"
        )

    for transition in chart.transitions:
        for condition in ast.walk(transition.guard.tree):
            if isinstance(condition, ast.Compare) and any(
                units[n] == SEQUENCE for n in Expression("", condition).names()
            ):
                difference = ast.BinOp(condition.left, ast.Sub(), condition.comparators[0])
                if offset(transition, difference) > 1:
                    raise fail(transition)
        for name, expression in transition.effects:
            if units[name] == SEQUENCE and offset(transition, expression.tree) > (name in counters):
                raise fail(transition)


def horizon_of(spec: ComponentSpec) -> float:
    """[ticks] How far back a time can matter to a chart: its longest timer, and one tick more.

    Raises:
        InputError: this cannot be told from the chart.
    """
    chart = spec.compiled.chart
    units = chart.units()
    values = chart.parameters | spec.parameters | chart.constants
    durations = {
        name
        for transition in chart.transitions
        for name, expression in transition.effects
        if units[name] != TIME and any(units[n] == TIME for n in expression.names())
    }
    longest = 0.0
    for transition in chart.transitions:
        lower, upper, _ = time_bounds(transition.guard, chart.time)
        timed = set().union(*(bound.names() for bound in (*lower, *upper)))
        untimed = [name for name in transition.guard.names() if name not in timed and name != chart.time]
        open_length = {n for n in timed if units[n] != TIME and n not in values}
        if open_length or durations.intersection(untimed) or any(units[n] == TIME for n in untimed):
            raise InputError(
                f"{chart.path}:{transition.line}: how far back {transition.id!r} looks depends on "
                "more than parameters; state the 'horizon' of the check, longer than every duration that matters"
            )
        for bound in (*lower, *upper):
            length = function_of(bound.python(lambda name: ast.Constant(values.get(name, 0.0))))()
            longest = max(longest, abs(length))
    return longest + 1.0
