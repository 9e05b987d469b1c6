"""SymPy → CasADi by a walk over the DAG: equal subexpressions become one node, nothing is simplified or expanded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial, reduce
from typing import Any

import casadi
import sympy

from mbm.expression.nodes import External, Outlined
from mbm.kernels.functions import applied
from mbm.symbolic.conversion import ELEMENTARY, Called, Finite, Held
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
class Constancy:
    """A value that counts as constant where derivatives are made: ``symbol`` stands for ``value``."""

    symbol: casadi.SX
    value: casadi.SX


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function in Python: ``symbols`` stand for the numbers that it gives for ``arguments``."""

    external: External | Outlined
    arguments: tuple[casadi.SX, ...]
    symbols: tuple[casadi.SX, ...]


@dataclass(frozen=True, slots=True)
class Lowered:
    """Expressions in CasADi with symbols for piecewise values, what is held, and calls; a step may use the symbols of
    earlier ones.
    """

    expressions: tuple[casadi.SX, ...]
    steps: tuple[Choice | Constancy | Call, ...]


def lower(
    expressions: tuple[sympy.Expr, ...],
    symbols: Mapping[sympy.Symbol, casadi.SX],
    variables: Iterable[sympy.Symbol] = (),
) -> Lowered:
    """``expressions`` in CasADi; ``symbols`` gives the CasADi scalar of every SymPy symbol, ``variables`` are those by
    which derivatives will be made.

    A power or x·log x whose data are 0 is 0 whatever the variables are, and so are its derivatives; the chain rule
    would find 0·∞ there.

    Raises:
        UnsupportedOperationError: a node nobody translates.
    """
    memo: dict[sympy.Basic, Any] = dict(symbols)
    steps, given = _Steps(), frozenset(variables)
    varies = {symbol: symbol in given for symbol in symbols}
    for expression in expressions:
        stack = [(expression, False)]
        while stack:
            node, ready = stack.pop()
            if node in memo:
                continue
            operands = node.args[3:] if isinstance(node, Called) else node.args
            if not ready and operands:
                stack.append((node, True))
                stack.extend((argument, False) for argument in operands if argument not in memo)
                continue
            value = _node(node, tuple(memo[a] for a in operands), steps)
            varies[node] = any(varies[each] for each in operands)
            zero, limit = _vanishing(node, varies) if given else (None, None)
            if zero is not None:
                known = steps.held(memo[zero] if limit is None else casadi.power(memo[zero], memo[limit]))
                value = steps.chosen(((known, memo[zero] == 0), (value, casadi.SX(1))))
            memo[node] = value
    return Lowered(tuple(memo[e] for e in expressions), tuple(steps.every))


def _vanishing(node: sympy.Basic, varies: Mapping[sympy.Basic, bool]) -> tuple[sympy.Basic | None, sympy.Basic | None]:
    """The number of a row that makes a power, or a product with its own logarithm, vanish where it is 0; None: no such.

    Beside it the exponent that decides the limit, None of a product. ``varies`` says of each node whether a variable is
    below it: SymPy would walk a DAG as a tree.
    """
    if isinstance(node, sympy.Pow):
        base, exponent = node.args
        steep = varies[exponent] or (exponent.is_Rational and 0 < exponent < 1)
        if steep and varies[node]:
            known = (each for each in _factors(base) if not each.is_Number and not varies[each])
            return next(known, None), exponent
    elif isinstance(node, sympy.Mul):
        factors = tuple(_factors(node))
        arguments = (each.args[0] for each in factors if isinstance(each, sympy.log))
        return next((each for each in arguments if each in factors and not varies[each]), None), None
    return None, None


def _factors(node: sympy.Basic) -> Iterator[sympy.Basic]:
    """The factors of a product of products."""
    stack = [node]
    while stack:
        each = stack.pop()
        if isinstance(each, sympy.Mul):
            stack.extend(reversed(each.args))
        else:
            yield each


class _Steps:
    """What was met so far; local to one lowering."""

    def __init__(self) -> None:
        self.every: list[Choice | Constancy | Call] = []
        self._calls: dict[tuple[External | Outlined, tuple[sympy.Basic, ...]], Call] = {}

    def called(self, node: Called, arguments: tuple[casadi.SX, ...]) -> casadi.SX:
        """The symbol of one number that a call gives; the call is made once for all of them."""
        external = node.output.external
        key = (external, node.args[3:])
        if key not in self._calls:
            number = len(self.every)
            symbols = tuple(casadi.SX.sym(f"call{number}_{i}") for i in range(external.size))
            self._calls[key] = Call(external, arguments, symbols)
            self.every.append(self._calls[key])
        return self._calls[key].symbols[node.output.index]

    def held(self, value: casadi.SX) -> casadi.SX:
        """A value that counts as constant."""
        constancy = Constancy(casadi.SX.sym(f"held{len(self.every)}"), value)
        self.every.append(constancy)
        return constancy.symbol

    def chosen(self, pairs: tuple[tuple[casadi.SX, casadi.SX], ...]) -> casadi.SX:
        """A piecewise value."""
        result = pairs[-1][0]
        for value, test in reversed(pairs[:-1]):
            choice = Choice(casadi.SX.sym(f"choice{len(self.every)}"), test, value, result)
            self.every.append(choice)
            result = choice.symbol
        return result


def _node(node: sympy.Basic, arguments: tuple[Any, ...], steps: _Steps) -> Any:
    if isinstance(node, sympy.functions.elementary.piecewise.ExprCondPair):
        return arguments
    if node is sympy.true or node is sympy.false:
        return casadi.SX(1 if node is sympy.true else 0)
    if isinstance(node, sympy.Number | sympy.NumberSymbol):
        return casadi.SX(float(node))
    if isinstance(node, sympy.Piecewise):
        return steps.chosen(arguments)
    if isinstance(node, Called):
        return steps.called(node, arguments)
    if isinstance(node, Held):
        return steps.held(*arguments)
    function = _FUNCTIONS.get(node.func)
    if function is None:
        raise UnsupportedOperationError(type(node).__name__)
    return function(*arguments)
