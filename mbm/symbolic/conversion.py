"""Sheets of silhouettes → SymPy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from fractions import Fraction

import sympy
from sympy.core.symbol import Str
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanFunction

from mbm.expression.nodes import (
    Apply,
    Column,
    ColumnMember,
    Component,
    Constant,
    Expression,
    Number,
    Opaque,
    Operation,
    Output,
    Sheet,
    postorder,
)
from mbm.expression.rows import RowChoice
from mbm.problem.naming import scalar_name


class Finite(BooleanFunction):  # type: ignore[misc]
    """Whether a number is neither missing nor infinite."""


class Held(sympy.Function):  # type: ignore[misc]
    """A number whose derivative is zero, whatever it depends on."""

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        """Zero."""
        return sympy.Integer(0)


class Called(sympy.Expr):  # type: ignore[misc]  # SymPy has no types
    """One number that a function in Python gives: its name, its index (as it is shown), all of it, the arguments.

    ``output`` is what the texts stand for; copies that SymPy makes for printing lack it.
    """

    is_commutative = True
    output: Output


def _called(output: Output, arguments: Iterable[sympy.Basic]) -> Called:
    index = f"[{output.index + 1}]" if output.external.size > 1 else ""
    texts = (Str(text) for text in (output.external.function, index, repr(output)))
    made: Called = sympy.Basic.__new__(Called, *texts, *arguments)
    made.output = output
    return made


def _wrap(a: sympy.Expr) -> sympy.Expr:
    turn = 2 * sympy.pi
    return a - turn * sympy.ceiling(a / turn - sympy.Rational(1, 2))


def _piecewise(condition: sympy.Basic, then: sympy.Expr, other: sympy.Expr) -> sympy.Expr:
    """Made past SymPy's constructors: they fold and expand conditions that hold piecewise values themselves."""
    pairs = (sympy.Tuple.__new__(ExprCondPair, *pair) for pair in ((then, condition), (other, sympy.true)))
    return sympy.Basic.__new__(sympy.Piecewise, *pairs)


def _as_written(operation: type[sympy.Basic]) -> Callable[..., sympy.Basic]:
    """`Min`, `And` and the like, past their constructors, which sort and compare what they hold down to the leaves."""

    def make(*arguments: sympy.Basic) -> sympy.Basic:
        made = sympy.Basic.__new__(operation, *arguments)
        made._argset = frozenset(arguments)
        return made

    return make


_OWN: Mapping[Operation, Callable[..., sympy.Basic]] = {
    Operation.ADD: sympy.Add,
    Operation.SUBTRACT: lambda a, b: sympy.Add(a, sympy.Mul(sympy.Integer(-1), b)),
    Operation.NEGATE: lambda a: sympy.Mul(sympy.Integer(-1), a),
    Operation.MULTIPLY: sympy.Mul,
    Operation.DIVIDE: lambda a, b: sympy.Mul(a, sympy.Pow(b, sympy.Integer(-1))),
    Operation.POWER: sympy.Pow,
    Operation.SQRT: lambda a: sympy.Pow(a, sympy.Rational(1, 2)),
    Operation.MINIMUM: _as_written(sympy.Min),
    Operation.MAXIMUM: _as_written(sympy.Max),
    Operation.HYPOT: lambda a, b: sympy.Pow(
        sympy.Add(sympy.Pow(a, sympy.Integer(2)), sympy.Pow(b, sympy.Integer(2))), sympy.Rational(1, 2)
    ),
    Operation.WRAP: _wrap,
    Operation.AS_ANGLE: lambda a: a,
    Operation.HELD: Held,
    Operation.IF: _piecewise,
    Operation.LESS: sympy.StrictLessThan,
    Operation.LESS_EQUAL: sympy.LessThan,
    Operation.EQUAL: sympy.Equality,
    Operation.NOT: sympy.Not,
    Operation.AND: _as_written(sympy.And),
    Operation.OR: _as_written(sympy.Or),
    Operation.FINITE: Finite,
}
"""What SymPy has no function for, or writes as something else."""

ELEMENTARY: Mapping[Operation, type[sympy.Function]] = {
    operation: sympy.Abs if operation is Operation.ABS else getattr(sympy, operation.value)
    for operation in Operation
    if operation not in _OWN and operation is not Operation.EXTERNAL
}
"""The functions that SymPy has by their names."""

_OPERATIONS: Mapping[Operation, Callable[..., sympy.Basic]] = {**_OWN, **ELEMENTARY}


def as_written() -> AbstractContextManager[None]:
    """Within, SymPy leaves expressions as they are made. Once for many: it empties its caches where that changes."""
    return sympy.evaluate(False)  # type: ignore[no-any-return]


class Converter:
    """Converts expressions; remembers the symbol of every input. One for each block, so that its inputs are its own."""

    def __init__(self) -> None:
        self.components: dict[object, tuple[Component, sympy.Symbol]] = {}
        self.columns: dict[object, tuple[Column, sympy.Symbol]] = {}
        self.constants: dict[str, tuple[Constant, sympy.Symbol]] = {}
        self._memo: dict[int, sympy.Basic] = {}
        self._interned: dict[sympy.Basic, sympy.Basic] = {}
        self._names: set[str] = set()

    def convert(self, roots: tuple[Expression, ...]) -> tuple[sympy.Expr, ...]:
        """``roots`` in SymPy; numbers are exact where they were written exactly."""
        with as_written():
            for node in postorder(roots):
                if id(node) not in self._memo:
                    made = self._leaf(node) if not isinstance(node, Apply) else self._apply(node)
                    self._memo[id(node)] = self._interned.setdefault(made, made)
        return tuple(self._memo[id(root)] for root in roots)

    def symbol(self, component: Component) -> sympy.Symbol:
        """The symbol of one number of an unknown, made where no expression holds it."""
        return self._leaf(component)

    def _apply(self, node: Apply) -> sympy.Basic:
        arguments = [self._memo[id(a)] for a in node.arguments]
        output = node.output
        made = _OPERATIONS[node.operation](*arguments) if output is None else _called(output, arguments)
        # SymPy asks for this from the root down and remembers the answer: asked here, nothing is left to recurse into.
        _ = made.is_commutative
        return made

    def _leaf(self, node: Expression) -> sympy.Basic:
        if isinstance(node, Number):
            return _number(node.value)
        if isinstance(node, Component):
            known = self.components.get(node.identity)
            if known is None:
                known = (node, self._symbol(component_name(node)))
                self.components[node.identity] = known
            return known[1]
        if isinstance(node, Column):
            found = self.columns.get(node.identity)
            if found is None:
                found = (node, self._symbol(column_name(node)))
                self.columns[node.identity] = found
            return found[1]
        if isinstance(node, Constant):
            constant = self.constants.get(node.name)
            if constant is None:
                constant = (node, self._symbol(node.name))
                self.constants[node.name] = constant
            return constant[1]
        message = "a form that was never evaluated reached the symbolic stage"
        raise TypeError(message if isinstance(node, Opaque) else type(node).__name__)

    def _symbol(self, name: str) -> sympy.Symbol:
        """A real symbol of its own: two inputs never share a name."""
        unique, count = name, 2
        while unique in self._names:
            unique, count = f"{name}'{count}", count + 1
        self._names.add(unique)
        return sympy.Symbol(unique, real=True)


def component_name(node: Component) -> str:
    """How equations show one number of an unknown: ``p[1]``, ``q["waist"]``, ``cam[camera][2]``."""
    if isinstance(node.member, ColumnMember):
        return scalar_name(f"{node.unknown}[{node.member.column}]", None, node.index)
    return scalar_name(node.unknown, None if node.member is None else node.member.key, node.index)


def column_name(node: Column) -> str:
    """How equations show a cell: ``x`` of the row at hand, ``first.x``, ``d.x[3]``; ``count(d)`` is how many rows."""
    if isinstance(node.row, int):
        return f"{node.table}.{node.name}[{node.row + 1}]"
    if node.row is RowChoice.COUNT:
        return f"count({node.table})"
    return node.name if node.row is RowChoice.EACH else f"{node.row}.{node.name}"


def _number(value: int | Fraction | float) -> sympy.Expr:
    if isinstance(value, int):
        return sympy.Integer(value)
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    return sympy.Float(value, precision=53)


def converted(sheet: Sheet) -> tuple[tuple[sympy.Expr, ...], dict[int, sympy.Symbol]]:
    """u, v and the depth, and the symbols of the sheet's constants by their position; those not met are absent."""
    converter = Converter()
    with as_written():
        expressions = converter.convert(sheet.point)
    return expressions, {int(name): symbol for name, (_, symbol) in converter.constants.items()}
