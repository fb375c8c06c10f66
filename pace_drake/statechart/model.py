"""What a chart is: states, transitions and data, as read from a file; nothing here runs."""

from dataclasses import dataclass, field
from functools import cached_property


@dataclass(frozen=True)
class State:
    """One state. A compound state has children and an initial child; a leaf has neither.

    Attributes:
        marks: the attributes of the project's own namespace, such as ``{"command": "PREPARE", "index": "l"}``.
        history: id of the deep history of this compound state, if it has one.
    """

    id: str
    parent: str | None
    initial: str | None
    line: int
    marks: dict[str, str] = field(default_factory=dict)
    history: str | None = None


@dataclass(frozen=True)
class Transition:
    """``guard / effect`` from a state to a state or history.

    Attributes:
        effects: assignments ``(variable, expression)``, executed in order.
        preemptive: tested before the states inside the source react.
        deadline: expression [s] of the time at which a timed guard becomes true, so that a simulation can step
            exactly there.
    """

    id: str
    source: str
    target: str
    guard: str
    effects: tuple[tuple[str, str], ...]
    preemptive: bool
    deadline: str | None
    line: int


@dataclass(frozen=True)
class Chart:
    """A whole chart.

    Attributes:
        inputs, parameters, variables: name -> value at the start (for an input: while nothing is connected).
        time: the name by which expressions read the time [s].
        marks: attributes of the project's own namespace on the root.
    """

    name: str
    path: str
    initial: str
    states: dict[str, State]
    transitions: tuple[Transition, ...]
    inputs: dict[str, float]
    parameters: dict[str, float]
    variables: dict[str, float]
    time: str
    marks: dict[str, str]

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """Leaf states in document order; a configuration is the index of its leaf."""
        parents = {state.parent for state in self.states.values()}
        return tuple(id for id in self.states if id not in parents)

    @cached_property
    def histories(self) -> dict[str, str]:
        """History id -> the compound state whose last active leaf it remembers."""
        return {state.history: state.id for state in self.states.values() if state.history is not None}

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
