"""SymPy → CasADi by a walk over the DAG: equal subexpressions become one node, nothing is simplified or expanded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial, reduce
from typing import Any

import casadi
import sympy

from mbm.kernels.functions import applied
from mbm.symbolic.conversion import ELEMENTARY, Finite
from mbm.values import dataclass


class UnsupportedOperationError(Exception):
    """A SymPy node that has no counterpart in CasADi: an internal fault."""


def _power(base: casadi.SX, exponent: casadi.SX) -> casadi.SX:
    if exponent.is_constant():
        value = float(exponent)
        if value == 0.5:
            return casadi.sqrt(base)
        if value == -1:
            return 1 / base
        if value == 2:
            return base * base
    return casadi.power(base, exponent)


def _add(*terms: casadi.SX) -> casadi.SX:
    return reduce(lambda a, b: a + b, terms)


def _multiply(*factors: casadi.SX) -> casadi.SX:
    return reduce(lambda a, b: a * b, factors)


def _finite(a: casadi.SX) -> casadi.SX:
    return casadi.lt(casadi.fabs(a), casadi.inf)


_FUNCTIONS: Mapping[type, Callable[..., casadi.SX]] = {
    sympy.Add: _add,
    sympy.Mul: _multiply,
    sympy.Pow: _power,
    **{function: partial(applied, each.operator) for each, function in ELEMENTARY.items() if each.operator is not None},
    sympy.ceiling: casadi.ceil,
    sympy.Min: lambda *a: reduce(casadi.fmin, a),
    sympy.Max: lambda *a: reduce(casadi.fmax, a),
    sympy.StrictLessThan: lambda a, b: a < b,
    sympy.LessThan: lambda a, b: a <= b,
    sympy.StrictGreaterThan: lambda a, b: a > b,
    sympy.GreaterThan: lambda a, b: a >= b,
    sympy.Equality: lambda a, b: a == b,
    sympy.Unequality: lambda a, b: a != b,
    sympy.Not: casadi.logic_not,
    sympy.And: lambda *a: reduce(casadi.logic_and, a),
    sympy.Or: lambda *a: reduce(casadi.logic_or, a),
    Finite: _finite,
}


@dataclass(frozen=True, slots=True)
class Choice:
    """A piecewise value: ``symbol`` stands for ``then`` where ``test`` holds, for ``other`` elsewhere."""

    symbol: casadi.SX
    test: casadi.SX
    then: casadi.SX
    other: casadi.SX


@dataclass(frozen=True, slots=True)
class Lowered:
    """Expressions in CasADi with a symbol for each piecewise value; a choice may use the symbols of earlier ones."""

    expressions: tuple[casadi.SX, ...]
    choices: tuple[Choice, ...]


def lower(expressions: tuple[sympy.Expr, ...], symbols: Mapping[sympy.Symbol, casadi.SX]) -> Lowered:
    """``expressions`` in CasADi; ``symbols`` gives the CasADi scalar of every SymPy symbol.

    Raises:
        UnsupportedOperationError: a node nobody translates.
    """
    memo: dict[sympy.Basic, Any] = dict(symbols)
    choices: list[Choice] = []
    for expression in expressions:
        stack = [(expression, False)]
        while stack:
            node, ready = stack.pop()
            if node in memo:
                continue
            if not ready and node.args:
                stack.append((node, True))
                stack.extend((argument, False) for argument in node.args if argument not in memo)
                continue
            memo[node] = _node(node, tuple(memo[a] for a in node.args), choices)
    return Lowered(tuple(memo[e] for e in expressions), tuple(choices))


def _node(node: sympy.Basic, arguments: tuple[Any, ...], choices: list[Choice]) -> Any:
    if isinstance(node, sympy.functions.elementary.piecewise.ExprCondPair):
        return arguments
    if node is sympy.true or node is sympy.false:
        return casadi.SX(1 if node is sympy.true else 0)
    if isinstance(node, sympy.Number | sympy.NumberSymbol):
        return casadi.SX(float(node))
    if isinstance(node, sympy.Piecewise):
        return _piecewise(arguments, choices)
    function = _FUNCTIONS.get(node.func)
    if function is None:
        raise UnsupportedOperationError(type(node).__name__)
    return function(*arguments)


def _piecewise(pairs: tuple[tuple[casadi.SX, casadi.SX], ...], choices: list[Choice]) -> casadi.SX:
    result = pairs[-1][0]
    for value, test in reversed(pairs[:-1]):
        choice = Choice(casadi.SX.sym(f"choice{len(choices)}"), test, value, result)
        choices.append(choice)
        result = choice.symbol
    return result
