"""What must hold of a chart and in which surroundings: a YAML file beside it, ``<chart>.checks.yaml``."""

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from pace_drake.errors import InputError
from pace_drake.statechart.compile import CompiledChart, compile_chart
from pace_drake.statechart.expressions import ExpressionError, Unit, parse_expression, unit_of
from pace_drake.statechart.loader import load_chart

SUFFIX = ".checks.yaml"
_MAX_BYTES = 200_000
_KEYS = {
    "parameters", "components", "connections", "free", "immediate", "sequences", "horizon", "fairness", "properties",
}  # fmt: skip
_FORMS = {"always", "never", "reachable", "eventually"}


@dataclass(frozen=True)
class Name:
    """What a dotted name of a property reads.

    Attributes:
        component: index of the component; -1 for a parameter of the whole check.
        kind: ``state``, ``transition``, ``variable``, ``output``, ``input`` or ``number``.
        name: without component and prime.
        primed: after the reaction rather than before it.
        value: of a number.
    """

    component: int
    kind: str
    name: str = ""
    primed: bool = False
    value: float = 0.0


@dataclass(frozen=True)
class Formula:
    """A condition about one step: the state before, the reactions, and (primed) the state after."""

    text: str
    tree: ast.expr
    names: dict[str, Name]

    @property
    def of_step(self) -> bool:
        """Whether it says more than something about one state."""
        return any(n.primed or n.kind in ("transition", "input") for n in self.names.values())

    @property
    def components(self) -> list[int]:
        """Components that are mentioned."""
        return sorted({n.component for n in self.names.values()} - {-1})


@dataclass(frozen=True)
class Fairness:
    """If ``when`` happens again and again, so does ``then``."""

    name: str
    when: Formula
    then: Formula


@dataclass(frozen=True)
class Property:
    """One thing that must hold.

    Attributes:
        form: ``always``, ``never``, ``reachable`` or ``eventually``.
        formula: what holds always, never, in some reachable step, or at last.
        start: of ``eventually``: from where on; None: from the start.
        fairness: of ``eventually``: what is assumed.
        at_last: of ``eventually``: free input -> the one value that it has from some point on.
    """

    name: str
    form: str
    formula: Formula
    start: Formula | None = None
    fairness: tuple[Fairness, ...] = ()
    at_last: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ComponentSpec:
    """One chart of the composition."""

    name: str
    compiled: CompiledChart
    parameters: dict[str, float]
    initial: dict[str, float]
    to_rest: bool


@dataclass(frozen=True)
class Connection:
    """Where an input gets its value: an output, a variable, or a state (1 while active) of another component."""

    source: int
    kind: str
    name: str


@dataclass(frozen=True)
class Spec:
    """A whole check.

    Attributes:
        connections, free: ``(component, input)`` -> where its value comes from, or the values that it may have.
        immediate: components whose outputs are read after their reaction, in the same tick.
        sequences: the variables that count sequence numbers up; the first is where all are counted from.
        horizon: [ticks] times further back than this are alike; None: from the charts' deadlines.
    """

    path: str
    components: tuple[ComponentSpec, ...]
    connections: dict[tuple[int, str], Connection]
    free: dict[tuple[int, str], tuple[float, ...]]
    immediate: frozenset[int]
    sequences: tuple[tuple[int, str], ...]
    horizon: float | None
    properties: tuple[Property, ...]


def checks_path(chart: Path) -> Path:
    """The file with the properties of a chart."""
    return chart.with_name(chart.name.removesuffix(".scxml") + SUFFIX)


def load_spec(
    path: Path, charts: Mapping[str, Path] | None = None, parameters: Mapping[str, float] | None = None
) -> Spec:
    """Reads a check.

    Args:
        path: the file.
        charts: component -> a chart to take instead of the one that the file names.
        parameters: values to take instead of those of the file.

    Raises:
        InputError: the file or one of its charts cannot be read; the message names file and place.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES} bytes; this is not a check")
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot read the checks: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f":{mark.line + 1}" if mark is not None else ""
        raise InputError(f"{path}{place}: not readable as YAML; {getattr(error, 'problem', error)}") from error
    return _Reader(path, data, charts or {}, parameters or {}).read()


class _Reader:
    def __init__(self, path: Path, data: Any, charts: Mapping[str, Path], parameters: Mapping[str, float]) -> None:
        self.path = path
        self.data = self.mapping(data, "the file")
        if unknown := set(self.data) - _KEYS:
            raise self.fail(f"unknown key {sorted(unknown)[0]!r}; known are {', '.join(sorted(_KEYS))}")
        self.charts = charts
        self.parameters = {str(k): self.number(v, f"parameter {k}") for k, v in self.section("parameters").items()}
        if unknown := set(parameters) - set(self.parameters):
            raise self.fail(f"no parameter {sorted(unknown)[0]!r}; there are {', '.join(self.parameters)}")
        self.parameters |= parameters
        self.components = tuple(self.component(name, value) for name, value in self.section("components").items())
        self.index = {c.name: k for k, c in enumerate(self.components)}
        if unknown := set(charts) - set(self.index):
            raise self.fail(f"no component {sorted(unknown)[0]!r}; there are {', '.join(self.index)}")

    def fail(self, what: str) -> InputError:
        return InputError(f"{self.path}: {what}")

    def mapping(self, value: Any, what: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.fail(f"{what} must be a mapping (name: value), not {value!r}"[:200])
        return value

    def section(self, key: str) -> dict[str, Any]:
        return self.mapping(self.data.get(key) or {}, key)

    def number(self, value: Any, what: str) -> float:
        if isinstance(value, str) and value in self.parameters:
            return self.parameters[value]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.fail(f"{what} must be a number, not {value!r}")
        return float(value)

    def component(self, name: str, value: Any) -> ComponentSpec:
        value = self.mapping(value, f"component {name}")
        if unknown := set(value) - {"chart", "parameters", "initial", "to_rest"}:
            raise self.fail(f"component {name}: unknown key {sorted(unknown)[0]!r}")
        if "chart" not in value:
            raise self.fail(f"component {name} needs 'chart: FILE.scxml'")
        compiled = compile_chart(load_chart(self.charts.get(name, self.path.parent / str(value["chart"]))))
        chart = compiled.chart
        given = {k: v for k, v in self.parameters.items() if k in chart.parameters}
        numbers = {
            part: {
                str(k): self.number(v, f"{part} {k} of {name}")
                for k, v in self.mapping(value.get(part) or {}, f"{part} of {name}").items()
            }
            for part in ("parameters", "initial")
        }
        for part, known in (("parameters", chart.parameters), ("initial", chart.variables)):
            if unknown := set(numbers[part]) - set(known):
                raise self.fail(f"{chart.path} has no {sorted(unknown)[0]!r} among its {part}")
        return ComponentSpec(
            name, compiled, given | numbers["parameters"], numbers["initial"], bool(value.get("to_rest", False))
        )

    def read(self) -> Spec:
        connections = {
            self.input(target): self.source(str(source)) for target, source in self.section("connections").items()
        }
        free: dict[tuple[int, str], tuple[float, ...]] = {}
        for target, values in self.section("free").items():
            key = self.input(target)
            if key in connections or not isinstance(values, list) or not values:
                raise self.fail(f"free {target} must be a list of values of an input that is not connected")
            free[key] = tuple(self.number(v, f"free {target}") for v in values)
        immediate = frozenset(self.component_index(str(name)) for name in self.data.get("immediate") or [])
        for (reader, name), connection in connections.items():
            if connection.source in immediate and connection.source >= reader:
                raise self.fail(
                    f"{self.components[reader].name}.{name} reads the immediate component "
                    f"{self.components[connection.source].name}, which must stand before it"
                )
        self.check_origins(connections)
        given = self.data.get("sequences") or []
        if not isinstance(given, list):
            raise self.fail("sequences must be a list of variables")
        found = [(str(text), self.resolve(str(text))) for text in given]
        for written, read in found:
            if read.kind != "variable":
                raise self.fail(f"sequences must name variables, not {written!r}")
        fairness = {name: self.fairness(name, value) for name, value in self.section("fairness").items()}
        entries = self.data.get("properties") or []
        if not isinstance(entries, list) or not entries:
            raise self.fail("properties must be a list with at least one property")
        properties = tuple(self.property(entry, fairness, free) for entry in entries)
        names = [prop.name for prop in properties]
        if repeated := {name for name in names if names.count(name) > 1}:
            raise self.fail(f"two properties are named {sorted(repeated)[0]!r}; rename one")
        horizon = self.data.get("horizon")
        return Spec(
            path=str(self.path),
            components=self.components,
            connections=connections,
            free=free,
            immediate=immediate,
            sequences=tuple((read.component, read.name) for _, read in found),
            horizon=None if horizon is None else self.number(horizon, "horizon"),
            properties=properties,
        )

    def check_origins(self, connections: Mapping[tuple[int, str], Connection]) -> None:
        """Times and sequence numbers may only come from where they are kept relative to now and to a counter."""
        for k, spec in enumerate(self.components):
            chart = spec.compiled.chart
            units = chart.units()
            for name in (*chart.parameters, *chart.constants):
                if units[name] != Unit():
                    raise self.fail(f"{chart.path}: {name!r} is {units[name]} that never moves; make it an input")
            for name in chart.inputs:
                connection = connections.get((k, name))
                if connection is None:
                    if units[name] != Unit():
                        raise self.fail(
                            f"{spec.name}.{name} is {units[name]}; connect it, it can be neither free nor fixed"
                        )
                    continue
                source = self.components[connection.source].compiled.chart.units().get(connection.name, Unit())
                if source != units[name]:
                    other = f"{self.components[connection.source].name}.{connection.name}"
                    raise self.fail(
                        f"{spec.name}.{name} is {units[name]}, but {other} is {source}; mend their pace:type"
                    )

    def component_index(self, name: str) -> int:
        if name not in self.index:
            raise self.fail(f"unknown component {name!r}; there are {', '.join(self.index)}")
        return self.index[name]

    def split(self, text: str) -> tuple[int, str]:
        component, dot, name = text.partition(".")
        if not dot:
            raise self.fail(f"{text!r}: write component.name")
        return self.component_index(component), name

    def input(self, text: str) -> tuple[int, str]:
        component, name = self.split(text)
        chart = self.components[component].compiled.chart
        if name not in chart.inputs:
            raise self.fail(f"{chart.path} has no input {name!r}; it has {', '.join(chart.inputs)}")
        return component, name

    def source(self, text: str) -> Connection:
        found = self.resolve(text)
        if found.kind not in ("state", "variable", "output") or found.primed:
            raise self.fail(f"{text!r} cannot be connected; name an output, a variable or a state")
        return Connection(found.component, found.kind, found.name)

    def resolve(self, text: str) -> Name:
        primed = text.endswith("'")
        plain = text.removesuffix("'")
        if "." not in plain:
            if plain not in self.parameters or primed:
                raise self.fail(f"unknown name {text!r}; write component.name, or a parameter of the check")
            return Name(-1, "number", value=self.parameters[plain])
        component, name = self.split(plain)
        spec = self.components[component]
        chart = spec.compiled.chart
        values = chart.parameters | spec.parameters | chart.constants
        if name in values and not primed:
            return Name(-1, "number", value=values[name])
        groups: dict[str, Iterable[str]] = {
            "state": chart.states, "variable": chart.variables, "output": chart.outputs,
            "input": chart.inputs, "transition": {t.id for t in chart.transitions},
        }  # fmt: skip
        for kind, group in groups.items():
            if name in group:
                if primed and kind in ("input", "transition"):
                    raise self.fail(f"{text!r}: an {kind} belongs to the step and has no value after it")
                return Name(component, kind, name, primed)
        raise self.fail(f"unknown name {text!r}: {chart.path} has no {name!r}")

    def formula(self, text: Any, what: str) -> Formula:
        if not isinstance(text, str):
            raise self.fail(f"{what} must be an expression in quotes, not {text!r}")
        try:
            expression = parse_expression(text, dotted=True)
            names = {name: self.resolve(name) for name in expression.names()}
            _check_conditions(expression.tree, names)
            unit_of(expression.tree, {name: self.unit(found) for name, found in names.items()})
        except ExpressionError as error:
            raise self.fail(f"{what}, {' '.join(text.split())!r}: {error}") from None
        return Formula(expression.text, expression.tree, names)

    def unit(self, found: Name) -> Unit:
        units = self.components[found.component].compiled.chart.units() if found.component >= 0 else {}
        return units.get(found.name, Unit())

    def fairness(self, name: str, value: Any) -> Fairness:
        value = self.mapping(value, f"fairness {name}")
        if set(value) != {"when", "then"}:
            raise self.fail(f"fairness {name} needs 'when' and 'then'")
        return Fairness(
            name, self.formula(value["when"], f"fairness {name}"), self.formula(value["then"], f"fairness {name}")
        )

    def property(
        self, entry: Any, fairness: dict[str, Fairness], free: dict[tuple[int, str], tuple[float, ...]]
    ) -> Property:
        entry = self.mapping(entry, "a property")
        name = str(entry.get("name", ""))
        forms = _FORMS & set(entry)
        if not name or len(forms) != 1:
            raise self.fail(f"a property needs 'name' and one of {', '.join(sorted(_FORMS))}: {entry!r}"[:200])
        form = forms.pop()
        extra = {"from", "fair", "at_last"} if form == "eventually" else set()
        if unknown := set(entry) - {"name", form} - extra:
            raise self.fail(f"property {name!r}: unknown key {sorted(unknown)[0]!r}")
        assumed = entry.get("fair") or []
        for item in assumed:
            if item not in fairness:
                raise self.fail(f"property {name!r}: unknown fairness {item!r}; there are {', '.join(fairness)}")
        at_last: dict[str, float] = {}
        for target, value in self.mapping(entry.get("at_last") or {}, f"at_last of {name!r}").items():
            number = self.number(value, f"at_last {target}")
            if number not in free.get(self.input(target), ()):
                raise self.fail(f"property {name!r}: {target} has no free value {value!r}")
            at_last[target] = number
        start = entry.get("from")
        return Property(
            name,
            form,
            self.formula(entry[form], f"property {name!r}"),
            None if start is None else self.formula(start, f"property {name!r}"),
            tuple(fairness[item] for item in assumed),
            at_last,
        )


def _check_conditions(tree: ast.expr, names: Mapping[str, Name], condition: bool = True) -> None:
    """States and transitions are conditions, everything else that has a name is a number."""
    match tree:
        case ast.Name(id=name):
            if (names[name].kind in ("state", "transition")) != condition:
                hint = f"write {name} != 0" if condition else "it is a state or transition, not a number"
                raise ExpressionError(f"{name!r} cannot stand here; {hint}")
        case ast.BoolOp(values=values):
            for value in values:
                _check_conditions(value, names)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            _check_conditions(operand, names)
        case ast.Compare(left=left, comparators=[right]):
            _check_conditions(left, names, False)
            _check_conditions(right, names, False)
        case ast.BinOp(left=left, right=right):
            _check_conditions(left, names, False)
            _check_conditions(right, names, False)
        case ast.UnaryOp(operand=operand):
            _check_conditions(operand, names, False)
        case ast.Constant() if condition:
            raise ExpressionError("a number where a condition is needed")
