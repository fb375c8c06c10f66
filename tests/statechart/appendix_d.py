"""A reference interpreter of SCXML: the algorithm of Appendix D of the W3C recommendation, procedure by procedure.

Slow and plain on purpose. Names are those of the appendix in Python's spelling. Time is virtual: delayed events are due
when ``advance`` says so. Not there: ``<invoke>`` and event processors other than SCXML's own.
"""

import heapq
import itertools
import json
import re
import subprocess
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol

from pace_drake.statechart.expressions import Expression, function_of, parse_expression

SCXML_PROCESSOR = "http://www.w3.org/TR/scxml/#SCXMLEventProcessor"
_EVENT_FIELDS = ["name", "type", "sendid", "origin", "origintype", "invokeid", "data"]
_SYSTEM = ("_event", "_name", "_sessionid", "_ioprocessors", "_x")


class EvaluationError(Exception):
    """An expression without a value: error.execution."""


class DataModel(Protocol):
    """Evaluates what a document says in its own language."""

    def declare(self, name: str, expression: str | None) -> None: ...
    def evaluate(self, expression: str) -> Any: ...
    def assign(self, location: str, expression: str) -> None: ...
    def execute(self, script: str) -> None: ...
    def set_event(self, event: dict[str, Any]) -> None: ...
    def set_configuration(self, states: list[str]) -> None: ...


class ExpressionDataModel:
    """Numbers and the expressions of ``pace_drake.statechart.expressions``: enough for lowered charts, without node."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}
        self._functions: dict[str, Callable[[dict, dict], Any]] = {}
        self._data: dict[str, float] = {}

    def declare(self, name: str, expression: str | None) -> None:
        self._values[name] = self.evaluate(expression or "0")

    def evaluate(self, expression: str) -> Any:
        if expression not in self._functions:
            parsed: Expression = parse_expression(expression, dotted=True)
            self._functions[expression] = function_of(parsed.python(self._read), ["v", "e"])
        return self._functions[expression](self._values, self._data)

    @staticmethod
    def _read(name: str) -> Any:
        import ast

        vector, key = ("e", name.removeprefix("_event.data.")) if name.startswith("_event.") else ("v", name)
        return ast.Subscript(ast.Name(vector, ast.Load()), ast.Constant(key), ast.Load())

    def assign(self, location: str, expression: str) -> None:
        if location not in self._values:
            raise EvaluationError(location)
        self._values[location] = self.evaluate(expression)

    def execute(self, script: str) -> None:
        raise EvaluationError("no scripts")

    def set_event(self, event: dict[str, Any]) -> None:
        self._data = event.get("data") or {}

    def set_configuration(self, states: list[str]) -> None:
        pass


#: Requests and answers are lines of JSON; every interpreter has a context of its own.
_NODE = r"""
const vm = require('vm'), readline = require('readline');
const contexts = new Map();
const ops = {
  open(c, a) {
    const fixed = {_event: undefined, _name: a.name, _sessionid: a.session, _ioprocessors: a.processors, _x: {}};
    const context = vm.createContext({});
    vm.runInContext('var __in = new Set(); function In(id) { return __in.has(id); }', context);
    for (const key of Object.keys(fixed)) context[key] = fixed[key];
    contexts.set(a.context, context);
  },
  close(c, a) { contexts.delete(a.context); },
  evaluate(c, a) { const v = vm.runInContext('(' + a.text + '\n)', c); return v === undefined ? null : v; },
  declared(c, a) { vm.runInContext('(' + a.text + ', 0)', c); },
  declare(c, a) {
    vm.runInContext('var ' + a.name + ';', c);
    if (a.text !== null) vm.runInContext(a.name + ' = (' + a.text + '\n);', c);
  },
  assign(c, a) { vm.runInContext('"use strict"; ' + a.name + ' = (' + a.text + '\n);', c); },
  execute(c, a) { vm.runInContext(a.text, c); },
  event(c, a) { c._event = Object.assign(Object.fromEntries(a.fields.map(f => [f, undefined])), a.event); },
  configuration(c, a) { vm.runInContext('__in = new Set(' + JSON.stringify(a.states) + ')', c); },
};
readline.createInterface({input: process.stdin}).on('line', line => {
  const request = JSON.parse(line);
  let answer;
  try {
    const value = ops[request.op](contexts.get(request.context), request);
    answer = JSON.stringify({value: value === undefined ? null : value});
  } catch (error) { answer = JSON.stringify({error: String(error)}); }
  process.stdout.write(answer + '\n');
});
"""


class NodeProcess:
    """One node process that evaluates for any number of interpreters."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            ["node", "-e", _NODE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self._contexts = itertools.count()

    def request(self, op: str, **arguments: Any) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"op": op, **arguments}) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        if "error" in answer:
            raise EvaluationError(answer["error"])
        return answer["value"]

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait(10)
        self._process.stdout.close()

    def datamodel(self, name: str = "", session: str = "session") -> "NodeDataModel":
        return NodeDataModel(self, next(self._contexts), name, session)


class NodeDataModel:
    """ECMAScript, by node."""

    def __init__(self, process: NodeProcess, context: int, name: str, session: str) -> None:
        self._process, self._context = process, context
        processors = {"scxml": {"location": f"#_scxml_{session}"}, SCXML_PROCESSOR: {"location": f"#_scxml_{session}"}}
        self._request("open", name=name, session=session, processors=processors)

    def _request(self, op: str, **arguments: Any) -> Any:
        return self._process.request(op, context=self._context, **arguments)

    def declare(self, name: str, expression: str | None) -> None:
        self._request("declare", name=name, text=expression)

    def evaluate(self, expression: str) -> Any:
        return self._request("evaluate", text=expression)

    def assign(self, location: str, expression: str) -> None:
        if re.match(r"\w+", location.strip()) is None or re.split(r"\W", location.strip())[0] in _SYSTEM:
            raise EvaluationError(f"{location} cannot be assigned")
        self._request("declared", text=location)  # fails if it is not
        self._request("assign", name=location, text=expression)

    def execute(self, script: str) -> None:
        self._request("execute", text=script)

    def set_event(self, event: dict[str, Any]) -> None:
        self._request("event", event=event, fields=_EVENT_FIELDS)

    def set_configuration(self, states: list[str]) -> None:
        self._request("configuration", states=states)


def _tag(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


class State:
    """A state, parallel, final, history or the document itself."""

    def __init__(self, element: ET.Element, parent: "State | None", order: int) -> None:
        self.kind = _tag(element)
        self.parent, self.order = parent, order
        self.id = element.get("id", f"__{self.kind}{order}")
        self.element = element
        self.children: list[State] = []
        self.transitions: list[Transition] = []
        self.initial: Transition | None = None
        self.is_history_deep = element.get("type") == "deep"

    def of(self, tag: str) -> list[ET.Element]:
        return [e for e in self.element if _tag(e) == tag]

    @property
    def child_states(self) -> list["State"]:
        return [c for c in self.children if c.kind in ("state", "parallel", "final")]

    @property
    def is_atomic(self) -> bool:
        return self.kind == "final" or (self.kind == "state" and not self.child_states)

    @property
    def is_compound(self) -> bool:
        return self.kind in ("state", "scxml") and bool(self.child_states)

    def is_descendant(self, other: "State | None") -> bool:
        return other in proper_ancestors(self, None)


class Transition:
    """A transition; also the one inside ``<initial>`` and ``<history>``."""

    def __init__(self, source: State, element: ET.Element | None, targets: list[str], order: int) -> None:
        self.source, self.order, self.target_ids = source, order, targets
        get = element.get if element is not None else lambda *_: None
        self.events = (get("event") or "").split()
        self.cond = get("cond")
        self.is_internal = get("type") == "internal"
        self.content = list(element) if element is not None else []


def proper_ancestors(state: State, above: State | None) -> list[State]:
    """getProperAncestors: from the parent outwards, up to and without ``above``."""
    found: list[State] = []
    at = state.parent
    while at is not None and at is not above:
        found.append(at)
        at = at.parent
    return found


class Interpreter:
    """Runs one document.

    Args:
        source: SCXML text.
        datamodel: evaluates its expressions.
        folder: where scripts named by ``src`` are.
        session: ``_sessionid``.
    """

    def __init__(self, source: str, datamodel: DataModel, folder: Path | None = None, session: str = "session") -> None:
        self.datamodel, self.folder, self.session = datamodel, folder, session
        self._count = itertools.count()
        self._states: dict[str, State] = {}
        self._documents = self._build(ET.fromstring(source), None)
        self._configuration: set[State] = set()
        self._history: dict[str, list[State]] = {}
        self._internal: deque[dict] = deque()
        self._external: deque[dict] = deque()
        self._delayed: list[tuple[float, int, str | None, dict, bool]] = []
        self._initialised: set[str] = set()
        self._late = self._documents.element.get("binding") == "late"
        self._sends = itertools.count()
        self.time = 0.0
        self.running = False

    def _build(self, element: ET.Element, parent: State | None) -> State:
        state = State(element, parent, next(self._count))
        self._states[state.id] = state
        for child in element:
            tag = _tag(child)
            if tag in ("state", "parallel", "final", "history"):
                state.children.append(self._build(child, state))
            elif tag == "transition":
                targets = child.get("target", "").split()
                state.transitions.append(Transition(state, child, targets, next(self._count)))
            elif tag == "initial":
                inner = next(e for e in child if _tag(e) == "transition")
                state.initial = Transition(state, inner, inner.get("target", "").split(), next(self._count))
        if state.initial is None and state.is_compound:
            default = [state.child_states[0].id]
            state.initial = Transition(state, None, element.get("initial", "").split() or default, next(self._count))
        return state

    # ---- what tests use

    def start(self) -> None:
        """interpret: enters the initial states and runs until nothing is left to do."""
        self.running = True
        if not self._late:
            self._initialise([e for s in self._states.values() for d in s.of("datamodel") for e in d])
        else:
            self._initialise([e for d in self._documents.of("datamodel") for e in d], late=True)
        for script in self._documents.of("script"):
            self._execute([script])
        assert self._documents.initial is not None
        self._enter_states([self._documents.initial])
        self._main_event_loop()

    def configuration(self) -> set[str]:
        """Ids of the active states."""
        return {s.id for s in self._configuration if s.kind != "scxml"}

    def atomic(self) -> set[str]:
        """Ids of the active atomic states."""
        return {s.id for s in self._configuration if s.is_atomic}

    def send(self, name: str, data: Any = None) -> None:
        """Puts one external event and runs until nothing is left to do."""
        self._external.append(self._event(name, "external", data))
        self._main_event_loop()

    def advance(self, duration: float) -> None:
        """Lets virtual time [s] pass."""
        until = self.time + duration
        while self.running and self._delayed and self._delayed[0][0] <= until:
            self.time, _, _, event, internal = heapq.heappop(self._delayed)
            (self._internal if internal else self._external).append(event)
            self._main_event_loop()
        self.time = until

    # ---- Appendix D

    def _main_event_loop(self) -> None:
        while self.running:
            self._macrostep()
            if not self.running or not self._external:
                return
            event = self._external.popleft()
            self.datamodel.set_event(event)
            enabled = self._select_transitions(event)
            if enabled:
                self._microstep(enabled)

    def _macrostep(self) -> None:
        while self.running:
            enabled = self._select_transitions(None)
            if not enabled:
                if not self._internal:
                    return
                event = self._internal.popleft()
                self.datamodel.set_event(event)
                enabled = self._select_transitions(event)
            if enabled:
                self._microstep(enabled)

    def _exit_interpreter(self) -> None:
        self.running = False
        for state in sorted(self._configuration, key=lambda s: -s.order):
            for block in state.of("onexit"):
                self._execute(list(block))

    def _select_transitions(self, event: dict | None) -> list[Transition]:
        """selectTransitions and selectEventlessTransitions."""
        enabled: list[Transition] = []
        for state in sorted((s for s in self._configuration if s.is_atomic), key=lambda s: s.order):
            for at in [state, *proper_ancestors(state, None)]:
                found = next((t for t in at.transitions if self._matches(t, event) and self._holds(t)), None)
                if found is not None:
                    if found not in enabled:
                        enabled.append(found)
                    break
        return self._remove_conflicting(enabled)

    @staticmethod
    def _matches(transition: Transition, event: dict | None) -> bool:
        """nameMatch: a descriptor matches an event of which it is a prefix, token by token."""
        if event is None:
            return not transition.events
        name = event["name"]
        descriptors = [d.removesuffix(".*").removesuffix(".") for d in transition.events]
        return any(d == "*" or name == d or name.startswith(d + ".") for d in descriptors)

    def _holds(self, transition: Transition) -> bool:
        """conditionMatch."""
        if transition.cond is None:
            return True
        try:
            return bool(self._evaluate(f"!!({transition.cond})" if self._is_node else transition.cond))
        except EvaluationError as error:
            self._raise_error("error.execution", error)
            return False

    def _remove_conflicting(self, enabled: list[Transition]) -> list[Transition]:
        kept: list[Transition] = []
        for first in enabled:
            preempted, removed = False, []
            for second in kept:
                if self._exit_set([first]) & self._exit_set([second]):
                    if first.source.is_descendant(second.source):
                        removed.append(second)
                    else:
                        preempted = True
                        break
            if not preempted:
                kept = [t for t in kept if t not in removed] + [first]
        return kept

    def _microstep(self, enabled: list[Transition]) -> None:
        self._exit_states(enabled)
        for transition in enabled:
            self._execute(transition.content)
        self._enter_states(enabled)

    def _exit_set(self, transitions: Iterable[Transition]) -> set[State]:
        left: set[State] = set()
        for transition in transitions:
            if transition.target_ids:
                domain = self._domain(transition)
                left |= {s for s in self._configuration if s.is_descendant(domain)}
        return left

    def _exit_states(self, enabled: list[Transition]) -> None:
        leaving = sorted(self._exit_set(enabled), key=lambda s: -s.order)
        for state in leaving:
            for history in (c for c in state.children if c.kind == "history"):
                active = sorted(self._configuration, key=lambda s: s.order)
                if history.is_history_deep:
                    self._history[history.id] = [s for s in active if s.is_atomic and s.is_descendant(state)]
                else:
                    self._history[history.id] = [s for s in active if s.parent is state]
        for state in leaving:
            for block in state.of("onexit"):
                self._execute(list(block))
            self._configuration.remove(state)
            self._tell_configuration()

    def _enter_states(self, enabled: list[Transition]) -> None:
        entering: set[State] = set()
        default_entry: set[State] = set()
        history_content: dict[str, list[ET.Element]] = {}
        for transition in enabled:
            domain = self._domain(transition)
            for target in self._targets(transition):
                self._add_descendants(target, entering, default_entry, history_content)
            for state in self._effective_targets(transition):
                self._add_ancestors(state, domain, entering, default_entry, history_content)
        for state in sorted(entering, key=lambda s: s.order):
            self._configuration.add(state)
            self._tell_configuration()
            if self._late and state.id not in self._initialised:
                self._initialised.add(state.id)
                self._initialise([e for d in state.of("datamodel") for e in d])
            for block in state.of("onentry"):
                self._execute(list(block))
            if state in default_entry and state.initial is not None:
                self._execute(state.initial.content)
            self._execute(history_content.get(state.id, []))
            if state.kind == "final":
                self._enter_final(state)

    def _enter_final(self, state: State) -> None:
        parent = state.parent
        assert parent is not None
        if parent.kind == "scxml":
            self._exit_interpreter()
            return
        data = None
        for donedata in state.of("donedata"):
            try:
                data = self._payload(donedata)
            except EvaluationError as error:
                self._raise_error("error.execution", error)
        self._internal.append(self._event(f"done.state.{parent.id}", "internal", data))
        grandparent = parent.parent
        regions = grandparent.child_states if grandparent is not None and grandparent.kind == "parallel" else []
        if regions and all(self._is_in_final(region) for region in regions):
            self._internal.append(self._event(f"done.state.{grandparent.id}", "internal"))

    def _is_in_final(self, state: State) -> bool:
        if state.kind == "parallel":
            return all(self._is_in_final(s) for s in state.child_states)
        return state.is_compound and any(s.kind == "final" and s in self._configuration for s in state.child_states)

    def _add_descendants(self, state: State, entering: set, default_entry: set, history_content: dict) -> None:
        if state.kind == "history":
            remembered = self._history.get(state.id)
            if remembered is None:
                default = state.transitions[0]
                history_content[state.parent.id] = default.content
                remembered = self._targets(default)
            for target in remembered:
                self._add_descendants(target, entering, default_entry, history_content)
            for target in remembered:
                self._add_ancestors(target, state.parent, entering, default_entry, history_content)
            return
        entering.add(state)
        if state.is_compound:
            default_entry.add(state)
            for target in self._targets(state.initial):
                self._add_descendants(target, entering, default_entry, history_content)
            for target in self._targets(state.initial):
                self._add_ancestors(target, state, entering, default_entry, history_content)
        elif state.kind == "parallel":
            self._add_regions(state, entering, default_entry, history_content)

    def _add_ancestors(
        self, state: State, above: State | None, entering: set, default_entry: set, history_content: dict
    ) -> None:
        for ancestor in proper_ancestors(state, above):
            entering.add(ancestor)
            if ancestor.kind == "parallel":
                self._add_regions(ancestor, entering, default_entry, history_content)

    def _add_regions(self, parallel: State, entering: set, default_entry: set, history_content: dict) -> None:
        for child in parallel.child_states:
            if not any(s is child or s.is_descendant(child) for s in entering):
                self._add_descendants(child, entering, default_entry, history_content)

    def _targets(self, transition: Transition) -> list[State]:
        return [self._states[identifier] for identifier in transition.target_ids]

    def _effective_targets(self, transition: Transition) -> list[State]:
        found: list[State] = []
        for target in self._targets(transition):
            if target.kind != "history":
                found.append(target)
            elif target.id in self._history:
                found += self._history[target.id]
            else:
                found += self._effective_targets(target.transitions[0])
        return list(dict.fromkeys(found))

    def _domain(self, transition: Transition) -> State | None:
        """getTransitionDomain; None only for the transition that enters the document."""
        if transition is self._documents.initial:
            return None
        targets = self._effective_targets(transition)
        source = transition.source
        if transition.is_internal and source.is_compound and all(t.is_descendant(source) for t in targets):
            return source
        return next(  # findLCCA
            s
            for s in proper_ancestors(source, None)
            if (s.is_compound or s.kind == "scxml") and all(t.is_descendant(s) for t in targets)
        )

    # ---- executable content

    @property
    def _is_node(self) -> bool:
        return isinstance(self.datamodel, NodeDataModel)

    def _tell_configuration(self) -> None:
        self.datamodel.set_configuration(sorted(self.configuration()))

    def _evaluate(self, text: str) -> Any:
        return self.datamodel.evaluate(text)

    def _event(self, name: str, kind: str, data: Any = None, **fields: Any) -> dict:
        event = {"name": name, "type": kind, **fields}
        return event if data is None else {**event, "data": data}

    def _raise_error(self, name: str, error: object, **fields: Any) -> None:
        self._internal.append(self._event(name, "platform", str(error), **fields))

    def _initialise(self, data: list[ET.Element], late: bool = False) -> None:
        if late:
            self._initialised.add(self._documents.id)
        for element in data:
            name, text = element.get("id", ""), element.get("expr")
            if element.get("src") is not None and self.folder is not None:
                file = self.folder / element.get("src", "").removeprefix("file:")
                text = _literal(file.read_text()) if file.exists() else "undefined"
            elif text is None:
                text = _literal(element.text) if (element.text or "").strip() else None
            try:
                self.datamodel.declare(name, text)
            except EvaluationError as error:
                if element.text and element.get("expr") is None:
                    self.datamodel.declare(name, json.dumps(" ".join(element.text.split())))
                else:
                    self._raise_error("error.execution", error)

    def _execute(self, content: list[ET.Element]) -> None:
        """Executes a block; an error ends it."""
        try:
            for element in content:
                self._execute_one(element)
        except _SentError:
            return
        except EvaluationError as error:
            self._raise_error("error.execution", error)

    def _execute_one(self, element: ET.Element) -> None:
        tag = _tag(element)
        if tag == "raise":
            self._internal.append(self._event(element.get("event", ""), "internal"))
        elif tag == "assign":
            text = element.get("expr")
            self.datamodel.assign(element.get("location", ""), text if text is not None else _literal(element.text))
        elif tag == "log":
            if element.get("expr"):
                self._evaluate(element.get("expr", ""))
        elif tag == "script":
            source = element.get("src")
            text = (self.folder / source).read_text() if source and self.folder else element.text or ""
            self.datamodel.execute(text)
        elif tag == "if":
            self._execute_if(element)
        elif tag == "foreach":
            self._execute_foreach(element)
        elif tag == "send":
            self._execute_send(element)
        elif tag == "cancel":
            identifier = element.get("sendid") or self._evaluate(element.get("sendidexpr", ""))
            self._delayed = [d for d in self._delayed if d[2] != identifier]
            heapq.heapify(self._delayed)
        elif tag:
            raise EvaluationError(f"<{tag}> is not supported")

    def _execute_if(self, element: ET.Element) -> None:
        active = bool(self._evaluate(element.get("cond", "")))
        done = active
        for child in element:
            if _tag(child) in ("elseif", "else"):
                active = not done and (_tag(child) == "else" or bool(self._evaluate(child.get("cond", ""))))
                done = done or active
            elif active:
                self._execute_one(child)

    def _execute_foreach(self, element: ET.Element) -> None:
        array, item, index = element.get("array", ""), element.get("item", ""), element.get("index")
        copy = f"__array{next(self._sends)}"
        self.datamodel.declare(
            copy, f"(a => {{ if (!Array.isArray(a)) throw Error('no array'); return a.slice() }})({array})"
        )
        for name in filter(None, (item, index)):
            self.datamodel.declare(name, None)
        for k in range(int(self._evaluate(f"{copy}.length"))):
            self.datamodel.assign(item, f"{copy}[{k}]")
            if index is not None:
                self.datamodel.assign(index, str(k))
            for child in element:
                self._execute_one(child)

    def _attribute(self, element: ET.Element, name: str) -> Any:
        """An attribute, or what its ``...expr`` evaluates to."""
        text = element.get(f"{name}expr")
        return element.get(name) if text is None else self._evaluate(text)

    def _execute_send(self, element: ET.Element) -> None:
        identifier = element.get("id")
        if element.get("idlocation"):
            identifier = f"__send{next(self._sends)}"
            self.datamodel.assign(element.get("idlocation", ""), json.dumps(identifier))
        name, target, kind = (self._attribute(element, key) for key in ("event", "target", "type"))
        data = self._payload(element)
        delay = _seconds(self._attribute(element, "delay"))
        fields = {} if identifier is None else {"sendid": identifier}
        if kind not in (None, "", "scxml", SCXML_PROCESSOR, SCXML_PROCESSOR.partition("#")[0]):
            self._raise_error("error.execution", f"event processor {kind}", **fields)
            raise _SentError
        own = f"#_scxml_{self.session}"
        if target not in (None, "", "#_internal", own):
            name = "error.communication" if str(target).startswith("#_") else "error.execution"
            self._raise_error(name, f"target {target}", **fields)
            raise _SentError
        internal = target == "#_internal"
        if not internal:
            fields |= {"origin": own, "origintype": SCXML_PROCESSOR}
        event = self._event(str(name), "internal" if internal else "external", data, **fields)
        if delay > 0:
            heapq.heappush(self._delayed, (self.time + delay, next(self._sends), identifier, event, internal))
        else:
            (self._internal if internal else self._external).append(event)

    def _payload(self, element: ET.Element) -> Any:
        """namelist, params or content as the data of an event."""
        data: dict[str, Any] = {}
        for name in element.get("namelist", "").split():
            data[name] = self._evaluate(name)
        for child in element:
            if _tag(child) == "param":
                text = child.get("expr") or child.get("location") or ""
                try:
                    data[child.get("name", "")] = self._evaluate(text)
                except EvaluationError as error:
                    self._raise_error("error.execution", error)
            elif _tag(child) == "content":
                if child.get("expr"):
                    return self._evaluate(child.get("expr", ""))
                return self._evaluate(_literal(child.text)) if _is_literal(child.text) else " ".join(child.text.split())
        return data or None


class _SentError(EvaluationError):
    """A send that failed and has already said so."""


def _is_literal(text: str | None) -> bool:
    return re.match(r"\s*[\[{\"'\d]", text or "") is not None


def _literal(text: str | None) -> str:
    return (text or "").strip()


def _seconds(text: Any) -> float:
    """A delay such as ``1.5s`` or ``100ms``."""
    match = re.fullmatch(r"\s*(\d*\.?\d+)\s*(ms|s)?\s*", str(text or "0"))
    if match is None:
        raise EvaluationError(f"delay {text!r}")
    return float(match[1]) / (1.0 if match[2] == "s" else 1000.0)
