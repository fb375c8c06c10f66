"""pace_drake.statechart.expressions: the grammar, and nothing beyond it."""

import ast

import pytest

from pace_drake.statechart.expressions import ExpressionError, names_in, parse_expression

VALUES = {"a": 2.0, "b": 3.0, "zero": 0.0}


def value(text):
    tree = ast.Expression(parse_expression(text, lambda name: ast.Constant(VALUES[name])))
    return eval(compile(ast.fix_missing_locations(tree), "<test>", "eval"), {"__builtins__": {}})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("7 - 2 - 1", 4),
        ("7 % 4 + 1", 4),
        ("-a + b", 1),
        ("a == 2 && b == 3", True),
        ("a == 3 || b == 3 && zero == 1", False),
        ("!(a == 3) && zero == 0", True),
        ("a + 1 >= b", True),
        ("a != 2", False),
        ("1e2 < 1.5e2", True),
    ],
)
def test_values_and_precedence(text, expected):
    assert value(text) == expected


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a +",
        "a = 2",
        "a; b",
        "__import__('os')",
        "a.b",
        "a[0]",
        "f(a)",
        "a ** b",
        "a / b",
        "'x'",
        "a < b < a",
        "(a",
        "a b",
        "lambda: 1",
        "1 if a else 2",
        "a" * 501,
    ],
)
def test_everything_else_is_refused(text):
    with pytest.raises(ExpressionError):
        parse_expression(text, lambda _name: ast.Constant(0.0))


def test_names():
    assert names_in("a + bc * 2 >= now") == ["a", "bc", "now"]
