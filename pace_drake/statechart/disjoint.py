"""Whether conditions of a chart can hold: quick where two conditions contradict each other word by word, else by z3."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING, Any

from pace_drake.statechart.expressions import Expression
from pace_drake.statechart.model import Chart

if TYPE_CHECKING:
    import z3

_FLIPPED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.Eq, ast.NotEq: ast.NotEq,
}  # fmt: skip
#: Which of a < b, a == b, a > b each comparison allows. Two exclude each other if they share none; with a NaN none of
#: them holds but !=, which excludes == alone.
_ALLOWS = {
    ast.Lt: {"<"}, ast.LtE: {"<", "="}, ast.Eq: {"="}, ast.GtE: {"=", ">"}, ast.Gt: {">"}, ast.NotEq: {"<", ">"},
}  # fmt: skip


class UnprovenError(Exception):
    """The solver gave no answer."""


def can_both_hold(chart: Chart, first: Expression, second: Expression) -> str | None:
    """An example in which both hold, as text, or None if there is none.

    Raises:
        UnprovenError: the solver does not know.
    """
    if _contradict(first, second):
        return None
    return Solver(chart).example(first.tree, second.tree)


def _contradict(first: Expression, second: Expression) -> bool:
    """Whether one condition of the first contradicts one of the second, by their words alone."""
    facts = [(*_key(a), a) for a in first.conjuncts() if isinstance(a, ast.Compare)]
    for b in second.conjuncts():
        if not isinstance(b, ast.Compare):
            continue
        left, op, right = _key(b)
        for other_left, other_op, other_right, _ in facts:
            if left != other_left:
                continue
            if right == other_right and not _ALLOWS[op] & _ALLOWS[other_op]:
                return True
            constants = right.startswith("Constant") and other_right.startswith("Constant")
            if constants and right != other_right and op is other_op is ast.Eq:
                return True
    return False


def _key(compare: ast.Compare) -> tuple[str, type[ast.cmpop], str]:
    """(left, operator, right) as text, turned round where the left side is a constant or comes later."""
    left, op, right = ast.dump(compare.left), type(compare.ops[0]), ast.dump(compare.comparators[0])
    if left.startswith("Constant") or (not right.startswith("Constant") and left > right):
        return right, _FLIPPED[op], left
    return left, op, right


class Solver:
    """Questions about the conditions of one chart, for every value of inputs, parameters, variables and time.

    Attributes:
        queries: how many were asked so far.
    """

    def __init__(self, chart: Chart) -> None:
        # Most charts need it for `pace chart check` alone: running one must not need 100 MB of solver.
        import z3

        self._z3 = z3
        self._chart = chart
        self.queries = 0

    def example(self, *conditions: ast.expr) -> str | None:
        """Values with which all conditions hold, as text, or None if there are none.

        Raises:
            UnprovenError: the solver does not know.
        """
        self.queries += 1
        solver = self._z3.Solver()
        solver.set("timeout", 5000)
        names: dict[str, z3.ArithRef] = {}
        for condition in conditions:
            solver.add(self._formula(condition, names))
        for name, symbol in names.items():
            if self._chart.types.get(name) == "boolean":
                solver.add(self._z3.Or(symbol == 0, symbol == 1))
        answer = solver.check()
        if answer == self._z3.unknown:
            raise UnprovenError(solver.reason_unknown())
        if answer == self._z3.unsat:
            return None
        model = solver.model()
        return ", ".join(f"{n} = {model.eval(s, model_completion=True)}" for n, s in names.items()) or "always"

    def _formula(self, tree: ast.expr, names: dict[str, z3.ArithRef]) -> Any:
        z3 = self._z3

        def of(part: ast.expr) -> Any:
            return self._formula(part, names)

        match tree:
            case ast.Constant(value=value):
                number = float(value)  # type: ignore[arg-type]
                return z3.IntVal(int(number)) if number.is_integer() else z3.RealVal(repr(number))
            case ast.Name(id=name):
                if name in self._chart.constants:
                    return of(ast.Constant(self._chart.constants[name]))
                if name not in names:
                    whole = self._chart.types.get(name) in ("boolean", "integer", "sequence")
                    names[name] = z3.Int(name) if whole else z3.Real(name)
                return names[name]
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return z3.Not(of(operand))
            case ast.UnaryOp(operand=operand):
                return -of(operand)
            case ast.BoolOp(op=ast.And(), values=values):
                return z3.And(*[of(v) for v in values])
            case ast.BoolOp(values=values):
                return z3.Or(*[of(v) for v in values])
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return of(left) + of(right)
            case ast.BinOp(left=left, op=ast.Sub(), right=right):
                return of(left) - of(right)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                return of(left) * of(right)
            case ast.BinOp(left=left, right=right):
                return self._remainder(of(left), of(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                a, b = of(left), of(right)
                compared = {
                    ast.Eq: a == b, ast.NotEq: a != b, ast.Lt: a < b, ast.LtE: a <= b, ast.Gt: a > b, ast.GtE: a >= b,
                }  # fmt: skip
                return compared[type(op)]
        raise AssertionError(ast.dump(tree))

    def _remainder(self, a: Any, b: Any) -> Any:
        """With the sign of the dividend; z3's own is never negative. Of real numbers: any value at all."""
        z3 = self._z3
        if a.is_int() and b.is_int():
            return z3.If(a >= 0, a % b, -((-a) % b))
        real = z3.RealSort()
        return z3.Function("remainder", real, real, real)(z3.ToReal(a) if a.is_int() else a, b)
