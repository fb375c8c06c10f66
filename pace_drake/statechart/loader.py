"""Reads a chart from the SCXML subset that ``docs/statechart.md`` describes. Files are parsed, never executed."""

import ast
import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from pace_drake.errors import InputError
from pace_drake.statechart.expressions import ExpressionError, names_in, parse_expression
from pace_drake.statechart.model import Chart, State, Transition

SCXML = "http://www.w3.org/2005/07/scxml"
PACE = "urn:pace-drake:statechart"
_MAX_BYTES = 1_000_000

#: element -> (attributes of SCXML, attributes of our namespace)
_ATTRIBUTES: dict[str, tuple[set[str], set[str]]] = {
    "scxml": ({"version", "name", "initial", "datamodel"}, {"time", "sequence"}),
    "datamodel": (set(), set()),
    "data": ({"id", "expr"}, {"role"}),
    "state": ({"id", "initial"}, {"command", "index", "decision", "waiting", "final"}),
    "history": ({"id", "type"}, set()),
    "transition": ({"cond", "target"}, {"id", "preemptive", "deadline"}),
    "assign": ({"location", "expr"}, set()),
}
_CHILDREN = {
    "scxml": {"datamodel", "state"},
    "datamodel": {"data"},
    "state": {"state", "history", "transition"},
    "transition": {"assign"},
}


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
        self.states: dict[str, State] = {}
        self.transitions: list[tuple[_Element, str]] = []
        self.data: dict[str, dict[str, float]] = {"input": {}, "parameter": {}, "variable": {}}

    def fail(self, element: _Element, what: str) -> InputError:
        return InputError(f"{self.path}:{element.line}: {what}")

    def required(self, element: _Element, attribute: str) -> str:
        if attribute not in element.attributes:
            raise self.fail(element, f"<{element.tag}> needs the attribute {attribute!r}")
        return element.attributes[attribute]

    def build(self) -> Chart:
        root = self.root
        for child in root.children:
            if child.tag == "datamodel":
                for datum in child.children:
                    self.read_data(datum)
        for child in root.children:
            if child.tag == "state":
                self.read_state(child, None)
        if not self.states:
            raise self.fail(root, "the chart has no state")
        histories = {s.history for s in self.states.values() if s.history is not None}
        for state in self.states.values():
            self.check_initial(state)
        initial = root.attributes.get("initial", next(iter(self.states)))
        if initial not in self.states:
            raise self.fail(root, f"initial state {initial!r} does not exist")
        time = root.marks.get("time", "now")
        transitions = tuple(
            self.read_transition(element, source, histories, time) for element, source in self.transitions
        )
        ids = [t.id for t in transitions]
        for (element, _), transition in zip(self.transitions, transitions, strict=True):
            if ids.count(transition.id) > 1:
                raise self.fail(element, f"transition id {transition.id!r} is used twice")
        chart = Chart(
            name=root.attributes.get("name", Path(self.path).stem),
            path=self.path,
            initial=initial,
            states=self.states,
            transitions=transitions,
            inputs=self.data["input"],
            parameters=self.data["parameter"],
            variables=self.data["variable"],
            time=time,
            marks=root.marks,
        )
        self.check_reachable(chart)
        return chart

    def read_data(self, element: _Element) -> None:
        name, role = self.required(element, "id"), element.marks.get("role", "variable")
        if role not in self.data:
            raise self.fail(element, f"unknown role {role!r} of {name!r}; use input, parameter, or none")
        if any(name in group for group in self.data.values()) or name == self.root.marks.get("time", "now"):
            raise self.fail(element, f"{name!r} is declared twice")
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
        histories = [c for c in element.children if c.tag == "history"]
        taken = [*self.states, *(s.history for s in self.states.values() if s.history)]
        for identifier in [name, *(self.required(h, "id") for h in histories)]:
            if identifier in taken:
                raise self.fail(element, f"state id {identifier!r} is used twice")
        if len(histories) > 1 or any(h.attributes.get("type") != "deep" for h in histories):
            raise self.fail(element, f"state {name!r} may have one history, of type 'deep'")
        children = [c for c in element.children if c.tag == "state"]
        if histories and not children:
            raise self.fail(histories[0], f"a history needs a compound state; {name!r} has no states inside")
        first = element.attributes.get("initial")
        if children and first is None:
            first = self.required(children[0], "id")
        self.states[name] = State(
            id=name,
            parent=parent,
            initial=first,
            line=element.line,
            marks=element.marks,
            history=histories[0].attributes["id"] if histories else None,
        )
        for mark in ("index", "waiting"):
            if mark in element.marks and element.marks[mark] not in self.data["variable"]:
                raise self.fail(element, f"pace:{mark} names the unknown variable {element.marks[mark]!r}")
        if "decision" in element.marks and element.marks["decision"] not in self.data["input"]:
            raise self.fail(element, f"pace:decision names the unknown input {element.marks['decision']!r}")
        for child in element.children:
            if child.tag == "transition":
                self.transitions.append((child, name))
            elif child.tag == "state":
                self.read_state(child, name)

    def check_initial(self, state: State) -> None:
        if state.initial is not None and (
            state.initial not in self.states or self.states[state.initial].parent != state.id
        ):
            raise InputError(
                f"{self.path}:{state.line}: initial state {state.initial!r} is not directly inside {state.id!r}"
            )

    def read_transition(self, element: _Element, source: str, histories: set[str], time: str) -> Transition:
        target = element.attributes.get("target", source)
        name = element.marks.get("id", f"{source}_{element.line}")
        if target not in self.states and target not in histories:
            raise self.fail(element, f"transition {name!r} has the unknown target {target!r}")
        if "target" not in element.attributes and not element.children:
            raise self.fail(element, f"transition {name!r} has neither target nor effect; remove it")
        preemptive = element.marks.get("preemptive", "false")
        if preemptive not in ("true", "false"):
            raise self.fail(element, f"pace:preemptive of {name!r} must be true or false, not {preemptive!r}")
        guard = element.attributes.get("cond", "1 == 1")
        self.check_expression(element, f"guard of {name!r}", guard, time)
        if (deadline := element.marks.get("deadline")) is not None:
            self.check_expression(element, f"deadline of {name!r}", deadline, time)
        effects = []
        for assign in element.children:
            location, expression = self.required(assign, "location"), self.required(assign, "expr")
            if location not in self.data["variable"]:
                raise self.fail(assign, f"effect of {name!r} assigns to {location!r}, which is not a variable")
            self.check_expression(assign, f"effect of {name!r}", expression, time)
            effects.append((location, expression))
        return Transition(name, source, target, guard, tuple(effects), preemptive == "true", deadline, element.line)

    def check_expression(self, element: _Element, what: str, text: str, time: str) -> None:
        known = {time}.union(*self.data.values())
        try:
            for name in names_in(text):
                if name not in known:
                    raise self.fail(
                        element,
                        f"{what} uses the unknown name {name!r}; declare it as <data id={name!r} .../>",
                    )
            parse_expression(text, _no_value)
        except ExpressionError as error:
            raise self.fail(element, f"{what}, {text!r}: {error}") from None

    def check_reachable(self, chart: Chart) -> None:
        reached: set[str] = set()
        queue = [chart.initial_leaf(chart.initial)]
        while queue:
            leaf = queue.pop()
            if leaf in reached:
                continue
            reached.add(leaf)
            active = set(chart.ancestors(leaf))
            for transition in chart.transitions:
                if transition.source in active:
                    # A history only leads to leaves that were active before, or to the initial one.
                    state = chart.histories.get(transition.target, transition.target)
                    queue.append(chart.initial_leaf(state))
        for leaf in chart.leaves:
            if leaf not in reached:
                raise InputError(
                    f"{self.path}:{chart.states[leaf].line}: state {leaf!r} can never be reached; remove it or add "
                    "a transition"
                )


def _no_value(_name: str) -> ast.expr:
    """Resolver for checking the grammar alone."""
    return ast.Constant(0.0)
