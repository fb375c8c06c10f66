"""pace_drake.statechart.expressions: the grammar, and nothing beyond it."""

import ast

import pytest

from pace_drake.statechart.expressions import (
    NUMBER,
    SEQUENCE,
    TIME,
    ExpressionError,
    is_name,
    parse_expression,
    to_text,
    unit_of,
)

VALUES = {"a": 2.0, "b": 3.0, "zero": 0.0}


def value(text):
    tree = ast.Expression(parse_expression(text).python(lambda name: ast.Constant(VALUES[name])))
    return eval(compile(ast.fix_missing_locations(tree), "<test>", "eval"), {"__builtins__": {"abs": abs}})


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
        ("-7 % 4", -3),  # the sign of the dividend, as in ECMAScript; Python's own gives 1
        ("7 % -4", 3),
        ("a - (b - 1)", 0),
        ("!(a == 2 || b == 2) || zero == 0", True),
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
        "a && b == 1",  # a number where a condition is needed
        "!a",
        "(a == 1) + 1",
        "(a == b) == b",
        "a % 0",
        "a.b == 1",
        "a == 1 => b == 1",  # only in properties
        "(" * 60 + "a" + ")" * 60,
        "-" * 60 + "a",
        "é == 1",
        "a" * 501,
    ],
)
def test_everything_else_is_refused(text):
    with pytest.raises(ExpressionError):
        parse_expression(text)


def test_a_number_as_condition_says_what_to_write():
    with pytest.raises(ExpressionError, match="'a' is a number where a condition is needed; write a != 0"):
        parse_expression("a && b == 1")


def test_names():
    assert sorted(parse_expression("a + bc * 2 >= now").names()) == ["a", "bc", "now"]


@pytest.mark.parametrize(
    "text", ["a + b - 2 * a", "a - (b - 1)", "(a - b) * 2 % 3", "!(a == 2) && (a < b || b >= -1)", "-(a + b) == 1e-3"]
)
def test_written_out_it_is_the_same_expression(text):
    tree = parse_expression(text).tree
    assert ast.dump(parse_expression(to_text(tree)).tree) == ast.dump(tree)


def test_properties_have_dotted_names_and_implication():
    text = "task.cmd' == task.cmd => robot.MOVING && (!human.WAITING => task.r_done)"
    expression = parse_expression(text, dotted=True)
    assert set(expression.names()) == {"task.cmd'", "task.cmd", "robot.MOVING", "human.WAITING", "task.r_done"}


UNITS = {"now": TIME, "t0": TIME, "age": NUMBER, "cmd": SEQUENCE, "done": SEQUENCE, "n": NUMBER}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("now - t0", NUMBER),
        ("t0 + 3 - n", TIME),
        ("n + now - t0", NUMBER),
        ("done + 1 - n", SEQUENCE),
        ("now >= t0 + 2", NUMBER),
        ("-(t0 - now) * 2 % 3", NUMBER),
    ],
)
def test_units(text, unit):
    assert unit_of(parse_expression(text).tree, UNITS) == unit


@pytest.mark.parametrize("text", ["now >= 3", "done == n", "t0 * 2 == n", "cmd % 4", "now == cmd", "t0 + t0 == now"])
def test_what_depends_on_an_origin_is_refused(text):
    with pytest.raises(ExpressionError, match="cannot be"):
        unit_of(parse_expression(text).tree, UNITS)


@pytest.mark.parametrize("name", ["var", "lambda", "In", "_x", "1a", "a-b", "é", "event", ""])
def test_what_some_engine_reserves_is_no_name(name):
    assert not is_name(name)
