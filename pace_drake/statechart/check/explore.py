"""Explores every state of a composition, breadth first, so that what it finds comes after as few ticks as can be."""

import ast
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pace_drake.errors import InputError
from pace_drake.statechart.check.component import (
    Component,
    Observed,
    Successor,
    Values,
    check_steps_of_one,
    horizon_of,
)
from pace_drake.statechart.check.spec import Formula, Name, Property, Spec
from pace_drake.statechart.compile import NoRestError
from pace_drake.statechart.expressions import Expression, function_of

#: One id for each component.
State = tuple[int, ...]
#: What each component does in one tick.
Step = tuple[Successor, ...]
#: (source component, whether it is read after its reaction, place of the value, leaves of a state that is read).
_Reader = tuple[int, bool, int, frozenset[float] | None]
MAX_STATES = 1_000_000
#: A chart that fails, and in which state.
_FAILURES = (ArithmeticError, ValueError, NoRestError)


class Composition:
    """The charts of a check, and what all of them together may do in one tick."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        horizon = max(map(horizon_of, spec.components)) if spec.horizon is None else spec.horizon
        self.components = [
            Component(
                part,
                self._observed(k),
                {name: values for (index, name), values in spec.free.items() if index == k},
                {name for index, name in spec.connections if index == k},
                horizon,
            )
            for k, part in enumerate(spec.components)
        ]
        if spec.sequences:
            for k, part in enumerate(spec.components):
                check_steps_of_one(part, {name for index, name in spec.sequences if index == k})
        #: For each component and leaf, how its connected inputs are read: (source, immediate, place, leaves).
        self._readers = [
            [[self._reader(k, name) for name in names] for names in component.connected_reads]
            for k, component in enumerate(self.components)
        ]
        self._needs: dict[tuple[int, ...], list[frozenset[str]]] = {}
        self._anew: dict[State, State] = {}

    def initial(self) -> State:
        """The state at the start."""
        return tuple(component.initial() for component in self.components)

    def steps(self, state: State, fixed: dict[tuple[int, str], float] | None = None) -> Iterator[tuple[Step, State]]:
        """All steps from ``state``: (what happens, the state of the next tick).

        Args:
            state: ids.
            fixed: free inputs that have one value.
        """
        before = [component.values[k] for component, k in zip(self.components, state, strict=True)]
        leaves = tuple(int(values[0]) for values in before)
        if leaves not in self._needs:
            self._needs[leaves] = [self._needed(k, leaves) for k in range(len(self.components))]
        needs = self._needs[leaves]
        partial: list[Step] = [()]
        for k, component in enumerate(self.components):
            readers = self._readers[k][leaves[k]]
            pinned = tuple((name, value) for (index, name), value in (fixed or {}).items() if index == k)
            if not any(immediate for _, immediate, _, _ in readers):
                given = tuple(self._value(reader, before[reader[0]]) for reader in readers)
                choices = component.successors(state[k], given, needs[k], pinned)
                partial = [(*step, choice) for step in partial for choice in choices]
                continue
            grown: list[Step] = []
            for step in partial:
                given = tuple(
                    self._value(
                        reader,
                        self.components[reader[0]].values[step[reader[0]].after] if reader[1] else before[reader[0]],
                    )
                    for reader in readers
                )
                grown += [(*step, choice) for choice in component.successors(state[k], given, needs[k], pinned)]
            partial = grown
        for step in partial:
            yield step, self._counted_anew(tuple([choice.next for choice in step]))

    @staticmethod
    def _value(reader: _Reader, values: Values) -> float:
        _, _, place, active = reader
        return values[place] if active is None else float(values[0] in active)

    def _counted_anew(self, state: State) -> State:
        """Sequence numbers as distances from the first, with distances of more than 2 between neighbours as 2."""
        if not self.spec.sequences:
            return state
        if state not in self._anew:
            index, name = self.spec.sequences[0]
            reference = self.components[index]
            base = reference.values[state[index]][reference.place[name]]
            present = {v for component, k in zip(self.components, state, strict=True) for v in component.numbers(k)}
            anew = {base: 0.0}
            for side in (1.0, -1.0):
                last = base
                for value in sorted((v for v in present if (v - base) * side > 0), key=lambda v: (v - base) * side):
                    anew[value] = anew[last] + side * min(abs(value - last), 2.0)
                    last = value
            self._anew[state] = tuple(
                component.counted_anew(k, anew) for component, k in zip(self.components, state, strict=True)
            )
        return self._anew[state]

    def _observed(self, k: int) -> Observed:
        before: set[str] = set()
        immediate: set[str] = set()
        for connection in self.spec.connections.values():
            if connection.source == k and connection.kind != "state":
                (immediate if k in self.spec.immediate else before).add(connection.name)
        before |= {name for index, name in self.spec.sequences if index == k}
        names = [n for formula in formulas(self.spec) for n in formula.names.values() if n.component == k]
        values = [n for n in names if n.kind in ("variable", "output")]
        return Observed(
            before=frozenset(before | {n.name for n in values if not n.primed}),
            after=frozenset(n.name for n in values if n.primed),
            immediate=frozenset(immediate),
            inputs=frozenset(n.name for n in names if n.kind == "input"),
            fired=any(n.kind == "transition" for n in names),
        )

    def _reader(self, k: int, name: str) -> _Reader:
        connection = self.spec.connections[k, name]
        component = self.components[connection.source]
        active = _leaves_of(component, connection.name) if connection.kind == "state" else None
        place = 0 if active is not None else component.place[connection.name]
        return connection.source, connection.source in self.spec.immediate, place, active

    def _needed(self, k: int, leaves: tuple[int, ...]) -> frozenset[str]:
        """Names of component k that are read at once by the others, in these leaves."""
        if k not in self.spec.immediate:
            return frozenset()
        return frozenset(
            self.spec.connections[reader, name].name
            for reader, component in enumerate(self.components)
            for name in component.connected_reads[leaves[reader]]
            if self.spec.connections[reader, name].source == k and self.spec.connections[reader, name].kind != "state"
        )


def formulas(spec: Spec) -> Iterator[Formula]:
    """All formulas of a check."""
    for prop in spec.properties:
        yield prop.formula
        if prop.start is not None:
            yield prop.start
        for fairness in prop.fairness:
            yield fairness.when
            yield fairness.then


def _leaves_of(component: Component, state: str) -> frozenset[float]:
    chart = component.chart
    return frozenset(float(k) for k, leaf in enumerate(chart.leaves) if state in chart.ancestors(leaf))


class Predicates:
    """Formulas as one function of a step that gives a bit for each."""

    def __init__(self, composition: Composition, formulas: list[Formula]) -> None:
        self._components = composition.components
        bits: list[ast.expr] = [
            ast.IfExp(self._condition(formula), ast.Constant(1 << k), ast.Constant(0))
            for k, formula in enumerate(formulas)
        ]
        total: ast.expr = ast.Constant(0)
        for bit in bits:
            total = ast.BinOp(total, ast.BitOr(), bit)
        self._mentioned = sorted({k for formula in formulas for k in formula.components})
        # Each component's values before and after, transitions and inputs, by a name of their own: quickest to read.
        arguments = [f"{side}{k}" for k in self._mentioned for side in "bafu"]
        self._function = function_of(total, arguments)

    def __call__(self, state: State, step: Step) -> int:
        """Bit k: whether the k-th formula holds in this step."""
        arguments: list[Sequence[float]] = []
        for k in self._mentioned:
            values, choice = self._components[k].values, step[k]
            arguments += (values[state[k]], values[choice.after], choice.fired, choice.u)
        return self._function(*arguments)

    def _condition(self, formula: Formula) -> ast.expr:
        return Expression(formula.text, formula.tree).python(lambda text: self._read(formula.names[text]))

    def _read(self, name: Name) -> ast.expr:
        if name.component < 0:
            return ast.Constant(name.value)
        component = self._components[name.component]

        def item(side: str, place: int) -> ast.expr:
            return ast.Subscript(ast.Name(f"{side}{name.component}", ast.Load()), ast.Constant(place), ast.Load())

        side = "a" if name.primed else "b"
        if name.kind == "state":
            leaves = ast.Tuple([ast.Constant(leaf) for leaf in sorted(_leaves_of(component, name.name))], ast.Load())
            return ast.Compare(item(side, 0), [ast.In()], [leaves])
        if name.kind == "transition":
            number = [t.id for t in component.chart.transitions].index(name.name)
            return ast.Compare(ast.Constant(number), [ast.In()], [ast.Name(f"f{name.component}", ast.Load())])
        if name.kind == "input":
            return item("u", component.spec.compiled.input_index[name.name])
        return item(side, component.place[name.name])


@dataclass
class Graph:
    """All reachable states and the steps between them.

    Attributes:
        states: in the order in which they were found.
        came: state -> (state before, step) by which it was found first; None for the first.
        found: property -> (state, step) in which its formula was first found to hold (``reachable``) or to be broken.
        failed: (state, what) where a chart itself fails; None if none does.
        sources, targets: of every step.
        marks: (steps, predicates) whether each of the predicates asked for holds in it.
    """

    states: list[State] = field(default_factory=list)
    came: list[tuple[int, Step] | None] = field(default_factory=list)
    found: dict[str, tuple[int, Step]] = field(default_factory=dict)
    failed: tuple[int, str] | None = None
    sources: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    targets: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    marks: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))

    def path(self, state: int) -> list[tuple[int, Step]]:
        """The steps from the start to ``state``, as few as possible: (state before, step)."""
        steps: list[tuple[int, Step]] = []
        while (before := self.came[state]) is not None:
            steps.append(before)
            state = before[0]
        return steps[::-1]


def explore(
    composition: Composition, properties: list[Property], marked: list[Formula], max_states: int = MAX_STATES
) -> Graph:
    """Visits every reachable state once.

    Args:
        composition: the charts.
        properties: ``always``, ``never`` and ``reachable``.
        marked: formulas to be noted of every step.
        max_states: give up beyond.

    Raises:
        InputError: there are more than ``max_states`` states.
    """
    graph = Graph()
    start = composition.initial()
    index = {start: 0}
    graph.states.append(start)
    graph.came.append(None)
    watched = Predicates(composition, [p.formula for p in properties])
    # What is looked for: the formula itself, or its being broken.
    broken_if = sum(1 << k for k, p in enumerate(properties) if p.form == "always")
    left = (1 << len(properties)) - 1
    recorder = _Recorder(composition, marked)
    at = 0
    while at < len(graph.states):
        state = graph.states[at]
        try:
            steps = list(composition.steps(state))
        except _FAILURES as error:
            graph.failed = (at, f"{type(error).__name__}: {error}")
            break
        for step, following in steps:
            if following not in index:
                if len(graph.states) == max_states:
                    raise InputError(
                        f"{composition.spec.path}: more than {max_states} states; give times and sequence numbers "
                        "their pace:type, bound what counts, or lower the parameters"
                    )
                index[following] = len(graph.states)
                graph.states.append(following)
                graph.came.append((at, step))
            if hits := (watched(state, step) ^ broken_if) & left:
                left &= ~hits
                graph.found |= {p.name: (at, step) for k, p in enumerate(properties) if hits >> k & 1}
            recorder.add(at, index[following], state, step)
        at += 1
    graph.sources, graph.targets, graph.marks = recorder.arrays()
    return graph


def restricted_steps(
    composition: Composition, graph: Graph, fixed: dict[tuple[int, str], float], marked: list[Formula]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sources, targets and marks of all steps in which free inputs have the one value of ``fixed``."""
    index = {state: k for k, state in enumerate(graph.states)}
    recorder = _Recorder(composition, marked)
    for at, state in enumerate(graph.states):
        for step, following in composition.steps(state, fixed):
            recorder.add(at, index[following], state, step)
    return recorder.arrays()


class _Recorder:
    """Collects steps in little memory; several steps alike are one."""

    def __init__(self, composition: Composition, marked: list[Formula]) -> None:
        self._number = len(marked)
        self._marks = Predicates(composition, marked)
        self._rows: set[tuple[int, int, int]] = set()
        self._of = -1
        self._sources, self._targets, self._bits = array("q"), array("q"), array("q")

    def add(self, source: int, target: int, state: State, step: Step) -> None:
        if source != self._of:
            self._of, self._rows = source, set()
        row = (source, target, self._marks(state, step))
        if row not in self._rows:
            self._rows.add(row)
            self._sources.append(row[0])
            self._targets.append(row[1])
            self._bits.append(row[2])

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sources, targets, and a column of truth values for each formula."""
        bits = np.array(self._bits)[:, None] >> np.arange(self._number) & 1
        return np.array(self._sources), np.array(self._targets), bits.astype(bool)
