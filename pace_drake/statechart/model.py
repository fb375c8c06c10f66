"""What a chart is: states, transitions and data, as read from a file; nothing here runs."""

import ast
from dataclasses import dataclass, field
from functools import cached_property

from pace_drake.statechart.expressions import NUMBER, SEQUENCE, TIME, Expression, Unit, to_text

#: Type of a datum -> what its numbers count.
TYPES: dict[str, Unit] = {
    "boolean": NUMBER, "integer": NUMBER, "real": NUMBER, "time": TIME, "sequence": SEQUENCE,
}  # fmt: skip


@dataclass(frozen=True)
class State:
    """One state. A compound state has children and an initial child; a leaf has neither.

    Attributes:
        outputs: output -> its value while this state is active (a state inside may give another).
        decision: input that answers the decision asked for in this leaf; None if none is.
        final: whether the run is over here.
        history: id of the deep history of this compound state, if it has one.
        history_default: state entered through the history before the region was ever left; None: the initial one.
    """

    id: str
    parent: str | None
    initial: str | None
    line: int
    outputs: dict[str, Expression] = field(default_factory=dict)
    decision: str | None = None
    final: bool = False
    history: str | None = None
    history_default: str | None = None


@dataclass(frozen=True)
class Transition:
    """``guard / effect`` from a state to a state or history.

    Attributes:
        target: id of a state or history; None: internal, no state is left.
        effects: assignments ``(variable, expression)``, executed in order.
        preemptive: tested before the states inside the source react.
        deadlines: times [s] that must have come before the guard holds; a simulation steps exactly there.
    """

    id: str
    source: str
    target: str | None
    guard: Expression
    effects: tuple[tuple[str, Expression], ...]
    preemptive: bool
    line: int
    deadlines: tuple[Expression, ...] = ()


@dataclass(frozen=True)
class Chart:
    """A whole chart.

    Attributes:
        inputs, parameters, variables: name -> value at the start (for an input: while nothing is connected).
        constants: name -> value.
        outputs: name -> value where no active state gives one; functions of variables, parameters and constants.
        types: name -> one of ``TYPES``.
        time: the name by which expressions read the time [s].
    """

    name: str
    path: str
    initial: str
    states: dict[str, State]
    transitions: tuple[Transition, ...]
    inputs: dict[str, float]
    parameters: dict[str, float]
    constants: dict[str, float]
    variables: dict[str, float]
    outputs: dict[str, Expression]
    types: dict[str, str]
    time: str

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """Leaf states in document order; a configuration is the index of its leaf."""
        parents = {state.parent for state in self.states.values()}
        return tuple(id for id in self.states if id not in parents)

    @cached_property
    def histories(self) -> dict[str, str]:
        """History id -> the compound state whose last active leaf it remembers."""
        return {state.history: state.id for state in self.states.values() if state.history is not None}

    @cached_property
    def decision(self) -> str | None:
        """The input that answers decisions, if the chart asks for any."""
        return next((state.decision for state in self.states.values() if state.decision is not None), None)

    def ancestors(self, state: str) -> list[str]:
        """The state and all that contain it, innermost first."""
        chain: list[str] = []
        at: str | None = state
        while at is not None:
            chain.append(at)
            at = self.states[at].parent
        return chain

    def initial_leaf(self, state: str) -> str:
        """The leaf in which a reset entry of ``state`` ends."""
        while (child := self.states[state].initial) is not None:
            state = child
        return state

    def history_default_leaf(self, history: str) -> str:
        """The leaf entered through ``history`` before its region was ever left."""
        region = self.histories[history]
        return self.initial_leaf(self.states[region].history_default or region)

    def domain(self, transition: Transition) -> str | None:
        """The innermost state that stays active, as in SCXML: what properly contains source and target; None: all."""
        assert transition.target is not None
        target = self.histories.get(transition.target, transition.target)
        inside = transition.target in self.histories  # leaves of the region are entered, not the region alone
        around_target = self.ancestors(target) if inside else self.ancestors(target)[1:]
        return next((s for s in self.ancestors(transition.source)[1:] if s in around_target), None)

    def exited(self, leaf: str, transition: Transition) -> list[str]:
        """States left when ``transition`` is taken in ``leaf``, innermost first."""
        if transition.target is None:
            return []
        domain, chain = self.domain(transition), self.ancestors(leaf)
        return chain if domain is None else chain[: chain.index(domain)]

    def entered(self, leaf: str, transition: Transition) -> list[str]:
        """States entered when ``transition`` ends in ``leaf``, outermost first."""
        return self.exited(leaf, transition)[::-1]

    def candidates(self, leaf: str) -> list[Transition]:
        """Transitions that can be taken in ``leaf``, in the order in which they are tested (docs/statechart.md)."""
        inner_first = self.ancestors(leaf)
        of = {state: [t for t in self.transitions if t.source == state] for state in inner_first}
        preemptive = [t for state in reversed(inner_first) for t in of[state] if t.preemptive]
        return preemptive + [t for state in inner_first for t in of[state] if not t.preemptive]

    def possible_leaves(self, transition: Transition) -> list[str]:
        """Leaves in which ``transition`` can end, guards aside."""
        if transition.target is None:
            return [leaf for leaf in self.leaves if transition.source in self.ancestors(leaf)]
        if transition.target not in self.histories:
            return [self.initial_leaf(transition.target)]
        region = self.histories[transition.target]
        return [leaf for leaf in self.leaves if region in self.ancestors(leaf)]

    def output(self, leaf: str, name: str) -> Expression:
        """The expression of an output in ``leaf``: that of the innermost active state that gives one."""
        for state in self.ancestors(leaf):
            if name in self.states[state].outputs:
                return self.states[state].outputs[name]
        return self.outputs[name]

    def units(self) -> dict[str, Unit]:
        """Name -> what its numbers count."""
        return {name: TYPES[kind] for name, kind in self.types.items()} | {self.time: TIME}


def time_bounds(guard: Expression, time: str) -> tuple[list[Expression], list[Expression], list[ast.expr]]:
    """Finds what a guard says about the time.

    Returns:
        (E of the conditions ``time >= E``, E of ``time < E``, conditions that read the time in any other way).
    """

    def reads(tree: ast.expr) -> bool:
        return any(isinstance(node, ast.Name) and node.id == time for node in ast.walk(tree))

    lower: list[Expression] = []
    upper: list[Expression] = []
    others: list[ast.expr] = []
    for condition in guard.conjuncts():
        match condition:
            case ast.Compare(left=ast.Name(id=name), ops=[ast.GtE()], comparators=[bound]) if (
                name == time and not reads(bound)
            ):
                lower.append(Expression(to_text(bound), bound))
            case ast.Compare(left=ast.Name(id=name), ops=[ast.Lt()], comparators=[bound]) if name == time and not reads(
                bound
            ):
                upper.append(Expression(to_text(bound), bound))
            case _ if reads(condition):
                others.append(condition)
    return lower, upper, others
