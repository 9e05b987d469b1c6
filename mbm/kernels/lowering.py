"""SymPy → CasADi by a walk over the DAG: equal subexpressions become one node, nothing is simplified or expanded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial, reduce
from operator import mul
from typing import Any

import casadi
import sympy

from mbm.expression.nodes import External, Outlined
from mbm.kernels.serialised import applied
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
    variables: Iterable[sympy.Symbol] | None = None,
) -> Lowered:
    """``expressions`` in CasADi; ``symbols`` gives the CasADi scalar of every SymPy symbol, ``variables`` are those by
    which derivatives will be made (None: by data, which then have no limits).

    A power or x·log x whose data are 0 is 0 whatever the variables are, and so are its derivatives; the chain rule
    would find 0·∞ there. What else it is multiplied by must be finite.

    Raises:
        UnsupportedOperationError: a node nobody translates.
    """
    memo: dict[sympy.Basic, Any] = dict(symbols)
    steps, given = _Steps(), frozenset(variables or ())
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
            limit = None if variables is None else _vanishing(node, varies)
            if limit is not None:
                known = reduce(mul, (memo[each] for each in limit.factors))
                known = known if limit.exponent is None else casadi.power(known, memo[limit.exponent])
                value = steps.chosen(((steps.held(known), memo[limit.zero] == 0), (value, casadi.SX(1))))
            memo[node] = value
    return Lowered(tuple(memo[e] for e in expressions), tuple(steps.every))


@dataclass(frozen=True, slots=True)
class _Limit:
    """Where ``zero`` is 0, a node is the product of ``factors`` to the ``exponent`` (None: 1), with no slope."""

    zero: sympy.Basic
    factors: tuple[sympy.Basic, ...]
    exponent: sympy.Basic | None = None


def _vanishing(node: sympy.Basic, varies: Mapping[sympy.Basic, bool]) -> _Limit | None:
    """The number of a row that makes a power, or a product with its own logarithm, vanish where it is 0; None: no such.

    ``varies`` says of each node whether a variable is below it: SymPy would walk a DAG as a tree. The logarithm's place
    is taken by what it is of, which is 0 with the number unless another part of it is infinite.
    """
    if isinstance(node, sympy.Pow):
        base, exponent = node.args
        steep = varies[exponent] or (exponent.is_Rational and 0 < exponent < 1)
        if steep:
            known = (each for each in _factors(base) if (each == 0 if each.is_Number else not varies[each]))
            return next((_Limit(zero, (base,), exponent) for zero in known), None) if varies[node] else None
    elif isinstance(node, sympy.Mul):
        factors = tuple(_factors(node))
        for log in (each for each in factors if isinstance(each, sympy.log)):
            shared = (each for each in _factors(log.args[0]) if each in factors)
            zero = next((each for each in shared if not (each.is_Number or varies[each])), None)
            if zero is not None:
                return _Limit(zero, (log.args[0], *(each for each in factors if each is not log)))
    return None


def _factors(node: sympy.Basic) -> Iterator[sympy.Basic]:
    """The factors of a product of products, each product that stands in several places once."""
    stack, seen = [node], set[int]()
    while stack:
        each = stack.pop()
        if id(each) in seen:
            continue
        seen.add(id(each))
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
