"""Reads a chart from the SCXML subset that ``docs/statechart.md`` describes. Files are parsed, never executed."""

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from pace_drake.errors import InputError
from pace_drake.statechart.disjoint import UnprovenError, can_both_hold
from pace_drake.statechart.expressions import (
    TIME,
    Expression,
    ExpressionError,
    Unit,
    is_name,
    parse_expression,
    to_text,
    unit_of,
)
from pace_drake.statechart.model import TYPES, Chart, State, Transition, time_bounds

SCXML = "http://www.w3.org/2005/07/scxml"
PACE = "urn:pace-drake:statechart"
_MAX_BYTES = 1_000_000
_MAX_DEPTH = 40

#: element -> (attributes of SCXML, attributes of our namespace)
_ATTRIBUTES: dict[str, tuple[set[str], set[str]]] = {
    "scxml": ({"version", "name", "initial", "datamodel"}, {"time"}),
    "datamodel": (set(), set()),
    "data": ({"id", "expr"}, {"role", "type"}),
    "state": ({"id", "initial"}, {"output", "decision", "final"}),
    "history": ({"id", "type"}, set()),
    "transition": ({"cond", "target"}, {"id", "preemptive"}),
    "assign": ({"location", "expr"}, set()),
}
_CHILDREN = {
    "scxml": {"datamodel", "state"},
    "datamodel": {"data"},
    "state": {"state", "history", "transition"},
    "history": {"transition"},
    "transition": {"assign"},
}
_ROLES = ("input", "parameter", "constant", "output", "variable")


@dataclass
class _Element:
    tag: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    marks: dict[str, str] = field(default_factory=dict)
    children: list["_Element"] = field(default_factory=list)


def load_chart(path: str | Path) -> Chart:
    """Reads and checks one chart.

    Raises:
        InputError: the file cannot be read, is not XML, or holds an element, attribute, name, target or value that
            the subset does not know; the message names file and line.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot read the chart: {error.strerror}") from error
    if len(data) > _MAX_BYTES:
        raise InputError(f"{path}: larger than {_MAX_BYTES} bytes; this is not a chart")
    return _Builder(str(path), _parse_xml(str(path), data)).build()


def _parse_xml(path: str, data: bytes) -> _Element:
    parser = expat.ParserCreate(namespace_separator=" ")
    root: list[_Element] = []
    stack: list[_Element] = []

    def fail(what: str) -> InputError:
        return InputError(f"{path}:{parser.CurrentLineNumber}: {what}")

    def start(name: str, attributes: dict[str, str]) -> None:
        namespace, _, tag = name.rpartition(" ")
        if namespace != SCXML or tag not in _ATTRIBUTES:
            raise fail(f"unknown element <{tag}>; known are {', '.join(sorted(_ATTRIBUTES))}")
        if stack and tag not in _CHILDREN.get(stack[-1].tag, set()):
            raise fail(f"<{tag}> cannot stand inside <{stack[-1].tag}>")
        element = _Element(tag, parser.CurrentLineNumber)
        for key, value in attributes.items():
            space, _, attribute = key.rpartition(" ")
            known = _ATTRIBUTES[tag][1 if space == PACE else 0]
            if space not in ("", PACE) or attribute not in known:
                raise fail(f"unknown attribute {attribute!r} of <{tag}>; remove it")
            (element.marks if space == PACE else element.attributes)[attribute] = value
        if len(stack) == _MAX_DEPTH:
            raise fail(f"elements nested deeper than {_MAX_DEPTH}; this is not a chart")
        (stack[-1].children if stack else root).append(element)
        stack.append(element)

    def end(_name: str) -> None:
        stack.pop()

    def text(content: str) -> None:
        if content.strip():
            raise fail(f"unexpected text {content.strip()[:30]!r}; remove it")

    def doctype(*_: object) -> None:
        raise fail("a document type is not allowed in a chart; remove it")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = text, doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{path}:{error.lineno}: not well-formed XML: {expat.ErrorString(error.code)}") from error
    if root[0].tag != "scxml":
        raise InputError(f"{path}:{root[0].line}: the root element must be <scxml>")
    return root[0]


class _Builder:
    """From elements to a checked Chart."""

    def __init__(self, path: str, root: _Element) -> None:
        self.path = path
        self.root = root
        self.time = root.marks.get("time", "now")
        #: Every name of the chart -> what it names; one namespace, so that a name says one thing everywhere.
        self.names: dict[str, str] = {}
        self.data: dict[str, dict[str, float]] = {role: {} for role in _ROLES if role != "output"}
        self.outputs: dict[str, Expression] = {}
        self.types: dict[str, str] = {}
        self.units: dict[str, Unit] = {self.time: TIME}
        self.states: dict[str, State] = {}
        self.transitions: list[tuple[_Element, str]] = []

    def fail(self, element: _Element, what: str) -> InputError:
        return InputError(f"{self.path}:{element.line}: {what}")

    def required(self, element: _Element, attribute: str) -> str:
        if attribute not in element.attributes:
            raise self.fail(element, f"<{element.tag}> needs the attribute {attribute!r}")
        return element.attributes[attribute]

    def flag(self, element: _Element, mark: str) -> bool:
        text = element.marks.get(mark, "false")
        if text not in ("true", "false"):
            raise self.fail(element, f"pace:{mark} must be true or false, not {text!r}")
        return text == "true"

    def claim(self, element: _Element, name: str, kind: str) -> None:
        if not is_name(name):
            raise self.fail(element, f"{name!r} cannot name a {kind}; use letters, digits, _, and no reserved word")
        if name in self.names:
            raise self.fail(element, f"{name!r} is used twice, as {self.names[name]} and as {kind}; rename one")
        self.names[name] = kind

    def build(self) -> Chart:
        root = self.root
        self.claim(root, self.time, "time")
        data = [datum for child in root.children if child.tag == "datamodel" for datum in child.children]
        for datum in data:
            self.read_data(datum)
        for datum in data:
            if datum.marks.get("role") == "output":
                text = datum.attributes.get("expr", "0")
                what = f"output {datum.attributes['id']!r}"
                self.outputs[datum.attributes["id"]] = self.stored_value(datum, what, text, datum.attributes["id"])
        for child in root.children:
            if child.tag == "state":
                self.read_state(child, None)
        if not self.states:
            raise self.fail(root, "the chart has no state; add <state id=.../>")
        for state in self.states.values():
            self.check_initial(state)
        initial = root.attributes.get("initial", next(iter(self.states)))
        if initial not in self.states:
            raise self.fail(root, f"initial state {initial!r} does not exist")
        histories = {state.history: state.id for state in self.states.values() if state.history is not None}
        sources = [source for _, source in self.transitions]
        transitions = tuple(
            self.read_transition(element, source, sources[: k + 1].count(source), histories)
            for k, (element, source) in enumerate(self.transitions)
        )
        for (element, _), transition in zip(self.transitions, transitions, strict=True):
            self.claim(element, transition.id, "transition")
        chart = Chart(
            name=root.attributes.get("name", Path(self.path).stem),
            path=self.path,
            initial=initial,
            states=self.states,
            transitions=transitions,
            inputs=self.data["input"],
            parameters=self.data["parameter"],
            constants=self.data["constant"],
            variables=self.data["variable"],
            outputs=self.outputs,
            types=self.types,
            time=self.time,
        )
        self.check_reachable(chart)
        self.check_deterministic(chart)
        return chart

    def read_data(self, element: _Element) -> None:
        name, role = self.required(element, "id"), element.marks.get("role", "variable")
        if role not in _ROLES:
            raise self.fail(element, f"unknown role {role!r} of {name!r}; use {', '.join(_ROLES)}")
        kind = element.marks.get("type", "real")
        if kind not in TYPES:
            raise self.fail(element, f"unknown type {kind!r} of {name!r}; use {', '.join(TYPES)}")
        self.claim(element, name, role)
        self.types[name], self.units[name] = kind, TYPES[kind]
        if role == "output":
            return
        text = element.attributes.get("expr", "0")
        try:
            value = float(text)
        except ValueError:
            raise self.fail(element, f"the value of {name!r} must be a number, not {text!r}") from None
        if not math.isfinite(value):
            raise self.fail(element, f"the value of {name!r} must be finite, not {text!r}")
        self.data[role][name] = value

    def read_state(self, element: _Element, parent: str | None) -> None:
        name = self.required(element, "id")
        self.claim(element, name, "state")
        histories = [c for c in element.children if c.tag == "history"]
        if len(histories) > 1 or any(h.attributes.get("type") != "deep" for h in histories):
            raise self.fail(histories[0], f"state {name!r} may have one history, of type 'deep'")
        children = [c for c in element.children if c.tag == "state"]
        history = default = None
        if histories:
            if not children:
                raise self.fail(histories[0], f"a history needs a compound state; {name!r} has no states inside")
            history, default = self.read_history(histories[0])
        first = element.attributes.get("initial")
        if children and first is None:
            first = self.required(children[0], "id")
        decision = element.marks.get("decision")
        if decision is not None:
            if decision not in self.data["input"]:
                raise self.fail(element, f"pace:decision names the unknown input {decision!r}")
            if children:
                raise self.fail(element, f"pace:decision belongs to a leaf; {name!r} has states inside")
            others = {s.decision for s in self.states.values() if s.decision is not None}
            if others - {decision}:
                raise self.fail(element, f"pace:decision must name {others.pop()!r}, as elsewhere in the chart")
        self.states[name] = State(
            id=name,
            parent=parent,
            initial=first,
            line=element.line,
            outputs=self.read_outputs(element, name),
            decision=decision,
            final=self.flag(element, "final"),
            history=history,
            history_default=default,
        )
        for child in element.children:
            if child.tag == "transition":
                self.transitions.append((child, name))
            elif child.tag == "state":
                self.read_state(child, name)

    def read_history(self, element: _Element) -> tuple[str, str | None]:
        """The id and the target of the default transition."""
        name = self.required(element, "id")
        self.claim(element, name, "history")
        defaults = element.children
        if len(defaults) > 1 or any(set(d.attributes) != {"target"} or d.marks or d.children for d in defaults):
            raise self.fail(element, f"history {name!r} may have one transition, with nothing but a target")
        return name, defaults[0].attributes["target"] if defaults else None

    def read_outputs(self, element: _Element, state: str) -> dict[str, Expression]:
        """Reads ``pace:output="name = expression; name = expression"``."""
        outputs: dict[str, Expression] = {}
        for part in filter(str.strip, element.marks.get("output", "").split(";")):
            name, equals, text = (piece.strip() for piece in part.partition("="))
            if not equals:
                raise self.fail(element, f"pace:output of {state!r}, {part.strip()!r}: write name = expression")
            if name not in self.outputs:
                raise self.fail(
                    element,
                    f"state {state!r} gives the unknown output {name!r}; declare it as "
                    f"<data id={name!r} pace:role='output'/>",
                )
            outputs[name] = self.stored_value(element, f"output {name!r} of {state!r}", text, name)
        return outputs

    def stored_value(self, element: _Element, what: str, text: str, output: str) -> Expression:
        """An output is a number that depends on what is stored, never on inputs or the time (Moore)."""
        expression = self.expression(element, what, text, condition=False)
        unit = unit_of(expression.tree, self.units)
        if unit != self.units[output]:
            raise self.fail(element, f"{what} is {unit}, but its type says {self.units[output]}; give it another type")
        for name in expression.names():
            if self.names[name] not in ("variable", "parameter", "constant"):
                raise self.fail(element, f"{what} may not use the {self.names[name]} {name!r}, only what is stored")
        return expression

    def check_initial(self, state: State) -> None:
        if state.initial is not None and (
            state.initial not in self.states or self.states[state.initial].parent != state.id
        ):
            raise InputError(
                f"{self.path}:{state.line}: initial state {state.initial!r} is not directly inside {state.id!r}"
            )
        default = state.history_default
        if default is not None:
            at: str | None = default
            while at in self.states and at != state.id:
                at = self.states[at].parent
            if at != state.id or default == state.id:
                raise InputError(
                    f"{self.path}:{state.line}: the history of {state.id!r} has the default target {default!r}, "
                    "which is not inside it"
                )

    def read_transition(self, element: _Element, source: str, ordinal: int, histories: dict[str, str]) -> Transition:
        target = element.attributes.get("target")
        name = element.marks.get("id", f"{source}_{ordinal}")
        if target is not None and target not in self.states and target not in histories:
            raise self.fail(element, f"transition {name!r} has the unknown target {target!r}")
        if target is None and not element.children:
            raise self.fail(element, f"transition {name!r} has neither target nor effect; remove it")
        if target in histories and source != histories[target] and self.is_inside(source, histories[target]):
            raise self.fail(
                element, f"transition {name!r} enters the history of {histories[target]!r} from inside; target a state"
            )
        guard = self.expression(element, f"guard of {name!r}", element.attributes.get("cond", "1 == 1"), condition=True)
        deadlines, _, others = time_bounds(guard, self.time)
        if others:
            raise self.fail(
                element,
                f"guard of {name!r} reads the time in {to_text(others[0])!r}; write {self.time} >= ... or "
                f"{self.time} < ..., joined by &&, so that a simulation can step exactly there",
            )
        effects = []
        for assign in element.children:
            location, text = self.required(assign, "location"), self.required(assign, "expr")
            if location not in self.data["variable"]:
                raise self.fail(assign, f"effect of {name!r} assigns to {location!r}, which is not a variable")
            what = f"effect of {name!r}"
            expression = self.expression(assign, what, text, condition=False)
            unit = unit_of(expression.tree, self.units)
            # A constant may set the origin of a scale; nothing else may move from one scale to another.
            if unit != self.units[location]:
                raise self.fail(
                    assign, f"{what} assigns {text!r}, {unit}, to {location!r}, which is {self.units[location]}"
                )
            effects.append((location, expression))
        preemptive = self.flag(element, "preemptive")
        return Transition(name, source, target, guard, tuple(effects), preemptive, element.line, tuple(deadlines))

    def is_inside(self, state: str, region: str) -> bool:
        at: str | None = state
        while at is not None and at != region:
            at = self.states[at].parent
        return at == region

    def expression(self, element: _Element, what: str, text: str, condition: bool) -> Expression:
        try:
            expression = parse_expression(text)
            for name in expression.names():
                if self.names.get(name) not in ("time", "input", "parameter", "constant", "variable"):
                    raise self.fail(
                        element, f"{what} uses the unknown name {name!r}; declare it as <data id={name!r} .../>"
                    )
            if condition and not expression.is_condition():
                raise ExpressionError(f"a number where a condition is needed; write {expression.text} != 0")
            if not condition and expression.is_condition():
                raise ExpressionError("a condition where a number is needed")
            unit_of(expression.tree, self.units)
        except ExpressionError as error:
            raise self.fail(element, f"{what}, {text!r}: {error}") from None
        return expression

    def check_reachable(self, chart: Chart) -> None:
        """Reachable with guards aside: a history leads to where its region was left, or to its default."""
        reached = {chart.initial_leaf(chart.initial)}
        grown = True
        while grown:
            grown = False
            for leaf in list(reached):
                for transition in chart.candidates(leaf):
                    if transition.target is None:
                        continue
                    ends = [leaf for leaf in chart.possible_leaves(transition) if leaf in reached]
                    if transition.target in chart.histories:
                        ends.append(chart.history_default_leaf(transition.target))
                    else:
                        ends = chart.possible_leaves(transition)
                    grown = grown or not reached.issuperset(ends)
                    reached.update(ends)
        for leaf in chart.leaves:
            if leaf not in reached:
                raise InputError(
                    f"{self.path}:{chart.states[leaf].line}: state {leaf!r} can never be reached; remove it or add "
                    "a transition"
                )

    def check_deterministic(self, chart: Chart) -> None:
        """No two transitions of one state are ever enabled together, so that no engine has to choose."""
        for state in chart.states:
            own = [t for t in chart.transitions if t.source == state]
            for first, second in itertools.combinations(own, 2):
                try:
                    example = can_both_hold(chart, first.guard, second.guard)
                except UnprovenError:
                    example = "not proven otherwise"
                if example is not None:
                    raise InputError(
                        f"{self.path}:{second.line}: transitions {first.id!r} and {second.id!r} of state {state!r} can "
                        f"both be enabled ({example}); make their guards exclude each other"
                    )
