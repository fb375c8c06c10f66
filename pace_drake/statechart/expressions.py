"""The expressions of guards, effects and outputs: numbers, names, ``+ - * %``, comparisons, ``&& || !``, parentheses.

They are parsed by the grammar below into Python syntax trees made of a handful of node types; the text of a chart is
never evaluated. Conditions and numbers are kept apart, as they are not in ECMAScript and Python, so that every engine
that runs a chart gives an expression the same value.

    implies := or ("=>" implies)?           only in the properties of a check
    or      := and ("||" and)*
    and     := not ("&&" not)*
    not     := "!" not | compare
    compare := sum (("==" | "!=" | "<" | "<=" | ">" | ">=") sum)?
    sum     := product (("+" | "-") product)*
    product := unary (("*" | "%") unary)*
    unary   := "-" unary | NUMBER | NAME | "(" or ")"

``%`` has the sign of the dividend, as in ECMAScript and C.
"""

import ast
import keyword
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_NUMBER = r"(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)"
_OPERATOR = r"(?P<op>=>|&&|\|\||==|!=|<=|>=|[<>!+\-*%()])"
_TOKEN = re.compile(rf"\s*(?:{_NUMBER}|(?P<name>[A-Za-z_]\w*)|{_OPERATOR})", re.ASCII)
_DOTTED_TOKEN = re.compile(rf"\s*(?:{_NUMBER}|(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*'?)|{_OPERATOR})", re.ASCII)
_COMPARE: dict[str, type[ast.cmpop]] = {
    "==": ast.Eq, "!=": ast.NotEq, "<": ast.Lt, "<=": ast.LtE, ">": ast.Gt, ">=": ast.GtE,
}  # fmt: skip
_ARITHMETIC: dict[str, type[ast.operator]] = {"+": ast.Add, "-": ast.Sub, "*": ast.Mult, "%": ast.Mod}
_MAX_LENGTH = 500
_MAX_DEPTH = 50
#: Names that mean something in an engine to which a chart may be lowered.
_RESERVED = frozenset(
    re.findall(
        r"\w+",
        """
        abstract any arguments break case catch class const continue debugger default delete do else enum eval event
        export extends false finally for function if implements import in In instanceof interface let new null package
        private protected public return static super switch this throw true try typeof undefined var void while with
        yield NaN Infinity Math active after idle sent received time
        """,
    )
)

#: Gives the syntax tree that reads a name, or raises ExpressionError.
Resolver = Callable[[str], ast.expr]


class ExpressionError(ValueError):
    """An expression outside the grammar or without a unit, or a name that the chart does not declare."""


@dataclass(frozen=True)
class Unit:
    """What a number counts, by its degree: how many times the origin of a scale is in it.

    A point in time and a number of a sequence have degree 1 (move the origin by c, and they move by c), a difference
    of two has degree 0. If every guard and effect keeps degrees, a chart behaves the same wherever the origins are;
    exploration rests on this.
    """

    time: int = 0
    sequence: int = 0

    def __str__(self) -> str:
        names = {Unit(): "a plain number or duration", Unit(time=1): "a time", Unit(sequence=1): "a sequence number"}
        return names.get(self, "a mix of times or sequence numbers")


NUMBER, TIME, SEQUENCE = Unit(), Unit(time=1), Unit(sequence=1)


@dataclass(frozen=True)
class Expression:
    """A parsed expression.

    Attributes:
        text: as written, with single blanks.
        tree: of ``ast`` nodes Constant, Name, UnaryOp, BinOp, Compare (of two) and BoolOp.
    """

    text: str
    tree: ast.expr

    def names(self) -> Iterator[str]:
        """The names that occur, in no order."""
        return (node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name))

    def conjuncts(self) -> list[ast.expr]:
        """The conditions that must all hold."""
        return list(_conjuncts(self.tree))

    def python(self, resolve: Resolver) -> ast.expr:
        """A Python expression, which numba compiles too."""
        return _ToPython(resolve).visit(self.tree)

    def is_condition(self) -> bool:
        """Whether the value is true or false rather than a number."""
        return _is_condition(self.tree)


def is_name(text: str) -> bool:
    """Whether ``text`` can name something in a chart: an identifier that no engine reserves."""
    if re.fullmatch(r"[A-Za-z]\w*", text, re.ASCII) is None:
        return False
    return not keyword.iskeyword(text) and text not in _RESERVED


def parse_expression(text: str, dotted: bool = False) -> Expression:
    """Parses one expression.

    Args:
        text: in the grammar of this module.
        dotted: also take names such as ``robot.kind'`` and the operator ``=>``.

    Raises:
        ExpressionError: text outside the grammar, too long or too deep, a number where a condition is needed or the
            other way round, or a constant divisor 0.
    """
    parser = _Parser(_tokenize(text, _DOTTED_TOKEN if dotted else _TOKEN), implication=dotted)
    tree = parser.top()
    if parser.kind != "end":
        raise ExpressionError(f"unexpected {parser.value!r}")
    return Expression(" ".join(text.split()), tree)


def unit_of(tree: ast.expr, units: Mapping[str, Unit]) -> Unit:
    """The unit of a number; for a condition NUMBER, after its parts were compared.

    Raises:
        ExpressionError: two different units are compared, or one is multiplied.
    """
    match tree:
        case ast.Constant():
            return NUMBER
        case ast.Name(id=name):
            return units[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            unit = unit_of(operand, units)
            return Unit(-unit.time, -unit.sequence)
        case ast.UnaryOp(operand=operand):
            return unit_of(operand, units)
        case ast.BinOp(left=left, op=op, right=right):
            a, b = unit_of(left, units), unit_of(right, units)
            if isinstance(op, ast.Add):
                return Unit(a.time + b.time, a.sequence + b.sequence)
            if isinstance(op, ast.Sub):
                return Unit(a.time - b.time, a.sequence - b.sequence)
            for part, unit in ((left, a), (right, b)):
                if unit != NUMBER:
                    raise ExpressionError(f"{to_text(part)!r} is {unit} and cannot be multiplied or divided")
            return NUMBER
        case ast.Compare(left=left, comparators=[right]):
            a, b = unit_of(left, units), unit_of(right, units)
            if a != b:
                raise ExpressionError(f"{to_text(left)!r} is {a}, {to_text(right)!r} is {b}; they cannot be compared")
            return NUMBER
        case ast.BoolOp(values=values):
            for value in values:
                unit_of(value, units)
            return NUMBER
    raise AssertionError(ast.dump(tree))


def function_of(tree: ast.expr, arguments: Sequence[str] = ()) -> Callable[..., Any]:
    """A Python function with the value of a Python expression, as ``Expression.python`` gives it."""
    names = [ast.arg(argument) for argument in arguments]
    signature = ast.arguments(posonlyargs=[], args=names, kwonlyargs=[], kw_defaults=[], defaults=[])
    function = ast.fix_missing_locations(ast.Expression(ast.Lambda(signature, tree)))
    return eval(compile(function, "<expression>", "eval"), {})


_SYMBOL: dict[type[ast.AST], str] = {
    **{node: symbol for symbol, node in (_COMPARE | _ARITHMETIC).items()},
    ast.And: "&&",
    ast.Or: "||",
}


def to_text(tree: ast.expr, name: Callable[[str], str] = str) -> str:
    """The expression in the grammar of this module, which is ECMAScript too.

    Args:
        tree: as in ``Expression.tree``.
        name: gives the text of a name.
    """

    def inner(part: ast.expr, above: int) -> str:
        text = to_text(part, name)
        return text if _strength(part) >= above else f"({text})"

    own = _strength(tree)
    match tree:
        case ast.Constant(value=value):
            number = float(value)  # type: ignore[arg-type]
            return str(int(number)) if number.is_integer() else repr(number)
        case ast.Name(id=identifier):
            return name(identifier)
        case ast.UnaryOp(op=op, operand=operand):
            return ("!" if isinstance(op, ast.Not) else "-") + inner(operand, _ATOM)
        case ast.BinOp(left=left, op=op, right=right):
            return f"{inner(left, own)} {_SYMBOL[type(op)]} {inner(right, own + 1)}"
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return f"{inner(left, own + 1)} {_SYMBOL[type(op)]} {inner(right, own + 1)}"
        case ast.BoolOp(op=op, values=values):
            return f" {_SYMBOL[type(op)]} ".join(inner(value, own + 1) for value in values)
    raise AssertionError(ast.dump(tree))


_ATOM = 8


def _strength(tree: ast.expr) -> int:
    """How strongly an operator binds, in ECMAScript; of a negative number weakly enough for parentheses."""
    match tree:
        case ast.Constant(value=value) if value < 0:  # type: ignore[operator]
            return 7
        case ast.BoolOp(op=ast.Or()):
            return 1
        case ast.BoolOp():
            return 2
        case ast.Compare():
            return 4
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            return 5
        case ast.BinOp():
            return 6
        case ast.UnaryOp():
            return 7
    return _ATOM


def conjunction(trees: list[ast.expr]) -> ast.expr:
    """All of them; an always true comparison if there are none."""
    if not trees:
        return ast.Compare(ast.Constant(1.0), [ast.Eq()], [ast.Constant(1.0)])
    return trees[0] if len(trees) == 1 else ast.BoolOp(ast.And(), trees)


def negation(tree: ast.expr) -> ast.expr:
    """Not ``tree``."""
    return ast.UnaryOp(ast.Not(), tree)


def _conjuncts(tree: ast.expr) -> Iterator[ast.expr]:
    if isinstance(tree, ast.BoolOp) and isinstance(tree.op, ast.And):
        for value in tree.values:
            yield from _conjuncts(value)
    else:
        yield tree


def _is_condition(tree: ast.expr) -> bool:
    return isinstance(tree, (ast.Compare, ast.BoolOp)) or (
        isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.Not)
    )


def _remainder(a: ast.expr, b: ast.expr) -> ast.expr:
    """``a % b`` with the sign of a. Python's own has that of b, and numba knows no ``math.fmod``."""
    size = ast.Call(ast.Name("abs", ast.Load()), [b], [])
    back = ast.UnaryOp(ast.USub(), ast.BinOp(ast.UnaryOp(ast.USub(), a), ast.Mod(), size))
    return ast.IfExp(ast.Compare(a, [ast.GtE()], [ast.Constant(0.0)]), ast.BinOp(a, ast.Mod(), size), back)


class _ToPython(ast.NodeTransformer):
    def __init__(self, resolve: Resolver) -> None:
        self._resolve = resolve

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._resolve(node.id)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        left, right = self.visit(node.left), self.visit(node.right)
        if isinstance(node.op, ast.Mod):
            return _remainder(left, right)
        return ast.BinOp(left, node.op, right)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        return ast.UnaryOp(node.op, self.visit(node.operand))

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        return ast.Compare(self.visit(node.left), node.ops, [self.visit(c) for c in node.comparators])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        return ast.BoolOp(node.op, [self.visit(value) for value in node.values])


def _tokenize(text: str, pattern: re.Pattern[str]) -> list[tuple[str, str]]:
    if len(text) > _MAX_LENGTH:
        raise ExpressionError(f"longer than {_MAX_LENGTH} characters")
    tokens, at = [], 0
    text = text.rstrip()
    while at < len(text):
        match = pattern.match(text, at)
        if match is None or match.lastgroup is None:
            raise ExpressionError(f"{text[at:].split()[0]!r} is not part of the expression language")
        tokens.append((match.lastgroup, match.group(match.lastgroup)))
        at = match.end()
    if not tokens:
        raise ExpressionError("is empty")
    return tokens


class _Parser:
    """Recursive descent over the tokens; one method per grammar rule."""

    def __init__(self, tokens: list[tuple[str, str]], implication: bool) -> None:
        self._tokens = [*tokens, ("end", "end of the expression")]
        self._at = 0
        self._depth = 0
        self._implication = implication

    @property
    def kind(self) -> str:
        return self._tokens[self._at][0]

    @property
    def value(self) -> str:
        return self._tokens[self._at][1]

    def _accept(self, *operators: str) -> str | None:
        if self.kind == "op" and self.value in operators:
            self._at += 1
            return self._tokens[self._at - 1][1]
        return None

    def top(self) -> ast.expr:
        left = self._either()
        if self._implication and self._accept("=>"):
            return ast.BoolOp(ast.Or(), [negation(_condition(left)), _condition(self.top())])
        return left

    def _either(self) -> ast.expr:
        return self._boolean("||", ast.Or(), self._both)

    def _both(self) -> ast.expr:
        return self._boolean("&&", ast.And(), self._not)

    def _boolean(self, operator: str, node: ast.boolop, term: Callable[[], ast.expr]) -> ast.expr:
        terms = [term()]
        while self._accept(operator):
            terms.append(term())
        return terms[0] if len(terms) == 1 else ast.BoolOp(op=node, values=[_condition(t) for t in terms])

    def _not(self) -> ast.expr:
        self._enter()
        try:
            return negation(_condition(self._not())) if self._accept("!") else self._compare()
        finally:
            self._depth -= 1

    def _compare(self) -> ast.expr:
        left = self._sum()
        if operator := self._accept(*_COMPARE):
            return ast.Compare(left=_number(left), ops=[_COMPARE[operator]()], comparators=[_number(self._sum())])
        return left

    def _sum(self) -> ast.expr:
        return self._arithmetic(("+", "-"), self._product)

    def _product(self) -> ast.expr:
        return self._arithmetic(("*", "%"), self._unary)

    def _arithmetic(self, operators: tuple[str, ...], term: Callable[[], ast.expr]) -> ast.expr:
        left = term()
        while operator := self._accept(*operators):
            right = _number(term())
            if operator == "%" and isinstance(right, ast.Constant) and right.value == 0:
                raise ExpressionError("the remainder of a division by 0 has no value")
            left = ast.BinOp(left=_number(left), op=_ARITHMETIC[operator](), right=right)
        return left

    def _unary(self) -> ast.expr:
        self._enter()
        try:
            if self._accept("-"):
                operand = _number(self._unary())
                if isinstance(operand, ast.Constant):
                    return ast.Constant(-operand.value)  # type: ignore[operator]
                return ast.UnaryOp(op=ast.USub(), operand=operand)
            if self._accept("("):
                inner = self._either() if not self._implication else self.top()
                if not self._accept(")"):
                    raise ExpressionError(f"expected ')' before {self.value!r}")
                return inner
        finally:
            self._depth -= 1
        kind, value = self.kind, self.value
        self._at += 1
        if kind == "number":
            return ast.Constant(float(value))
        if kind == "name":
            return ast.Name(value, ast.Load())
        raise ExpressionError(f"expected a number or a name, not {value!r}")

    def _enter(self) -> None:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ExpressionError(f"nested deeper than {_MAX_DEPTH}")


def _condition(tree: ast.expr) -> ast.expr:
    # In a property, a dotted name may be a state or a transition; who resolves it knows.
    if _is_condition(tree) or (isinstance(tree, ast.Name) and "." in tree.id):
        return tree
    raise ExpressionError(f"{to_text(tree)!r} is a number where a condition is needed; write {to_text(tree)} != 0")


def _number(tree: ast.expr) -> ast.expr:
    if _is_condition(tree):
        raise ExpressionError(f"{to_text(tree)!r} is a condition where a number is needed")
    return tree
