"""The expressions of guards and effects: numbers, names, ``+ - * %``, comparisons, ``&& || !``, parentheses.

They are parsed by the grammar below into Python syntax trees whose only names are indexed reads of numeric vectors;
the text of a chart is never evaluated.

    or      := and ("||" and)*
    and     := not ("&&" not)*
    not     := "!" not | compare
    compare := sum (("==" | "!=" | "<" | "<=" | ">" | ">=") sum)?
    sum     := product (("+" | "-") product)*
    product := unary (("*" | "%") unary)*
    unary   := "-" unary | NUMBER | NAME | "(" or ")"
"""

import ast
import re
from collections.abc import Callable

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<op>&&|\|\||==|!=|<=|>=|[<>!+\-*%()]))"
)
_COMPARE = {"==": ast.Eq, "!=": ast.NotEq, "<": ast.Lt, "<=": ast.LtE, ">": ast.Gt, ">=": ast.GtE}
_ARITHMETIC = {"+": ast.Add, "-": ast.Sub, "*": ast.Mult, "%": ast.Mod}
_MAX_LENGTH = 500

#: Turns a name into the syntax tree that reads its value, or raises ExpressionError.
Resolver = Callable[[str], ast.expr]


class ExpressionError(ValueError):
    """An expression outside the grammar, or a name that the chart does not declare."""


def names_in(text: str) -> list[str]:
    """Returns the names that occur in an expression, in order."""
    return [value for kind, value in _tokenize(text) if kind == "name"]


def parse_expression(text: str, resolve: Resolver) -> ast.expr:
    """Parses one expression.

    Args:
        text: the expression, in the grammar of this module.
        resolve: gives the syntax tree that reads a name.

    Returns:
        A Python expression tree made of arithmetic, comparisons, boolean operators and what ``resolve`` gave.

    Raises:
        ExpressionError: text outside the grammar, or too long.
    """
    parser = _Parser(_tokenize(text), resolve)
    tree = parser.either()
    if parser.kind != "end":
        raise ExpressionError(f"unexpected {parser.value!r}")
    return tree


def _tokenize(text: str) -> list[tuple[str, str]]:
    if len(text) > _MAX_LENGTH:
        raise ExpressionError(f"longer than {_MAX_LENGTH} characters")
    tokens, at = [], 0
    text = text.rstrip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            raise ExpressionError(f"{text[at:].split()[0]!r} is not part of the expression language")
        tokens.append((match.lastgroup, match.group(match.lastgroup)))
        at = match.end()
    if not tokens:
        raise ExpressionError("is empty")
    return tokens


class _Parser:
    """Recursive descent over the tokens; one method per grammar rule."""

    def __init__(self, tokens: list[tuple[str, str]], resolve: Resolver) -> None:
        self._tokens = [*tokens, ("end", "end of the expression")]
        self._at = 0
        self._resolve = resolve

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

    def either(self) -> ast.expr:
        terms = [self._both()]
        while self._accept("||"):
            terms.append(self._both())
        return terms[0] if len(terms) == 1 else ast.BoolOp(op=ast.Or(), values=terms)

    def _both(self) -> ast.expr:
        terms = [self._not()]
        while self._accept("&&"):
            terms.append(self._not())
        return terms[0] if len(terms) == 1 else ast.BoolOp(op=ast.And(), values=terms)

    def _not(self) -> ast.expr:
        if self._accept("!"):
            return ast.UnaryOp(op=ast.Not(), operand=self._not())
        return self._compare()

    def _compare(self) -> ast.expr:
        left = self._sum()
        if operator := self._accept(*_COMPARE):
            return ast.Compare(left=left, ops=[_COMPARE[operator]()], comparators=[self._sum()])
        return left

    def _sum(self) -> ast.expr:
        left = self._product()
        while operator := self._accept("+", "-"):
            left = ast.BinOp(left=left, op=_ARITHMETIC[operator](), right=self._product())
        return left

    def _product(self) -> ast.expr:
        left = self._unary()
        while operator := self._accept("*", "%"):
            left = ast.BinOp(left=left, op=_ARITHMETIC[operator](), right=self._unary())
        return left

    def _unary(self) -> ast.expr:
        if self._accept("-"):
            return ast.UnaryOp(op=ast.USub(), operand=self._unary())
        if self._accept("("):
            inner = self.either()
            if not self._accept(")"):
                raise ExpressionError(f"expected ')' before {self.value!r}")
            return inner
        kind, value = self.kind, self.value
        if kind == "number":
            self._at += 1
            return ast.Constant(float(value))
        if kind == "name":
            self._at += 1
            return self._resolve(value)
        raise ExpressionError(f"expected a number or a name, not {value!r}")
