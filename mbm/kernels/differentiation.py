"""Lowered expressions → values and Jacobians, by the chain rule through choices and calls of functions in Python.

A call gives its values and their derivatives by its arguments as numbers: symbols stand for both, and what depends on
them is differentiated as everything else is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi

from mbm.expression.nodes import Outlined
from mbm.kernels.instructions import program_of
from mbm.kernels.lowering import Call, Choice, Constancy, Lowered
from mbm.kernels.outlines.sheets import programs_of
from mbm.kernels.types import ExternalCall
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class DifferentiatedCall:
    """A call with symbols for what it gives.

    ``inner`` (w, variables) are the total derivatives of the ``wanted`` arguments, the only ones that depend on a
    variable; ``slopes`` (n, w) and ``bends`` (n, w·w) the symbols of first and second derivatives of the n ``values``.
    """

    call: Call
    arguments: casadi.SX
    wanted: tuple[int, ...]
    inner: casadi.SX
    slopes: casadi.SX
    bends: casadi.SX | None = None

    @property
    def values(self) -> tuple[casadi.SX, ...]:
        """The symbols of what the function gives."""
        return self.call.symbols

    def results(self) -> list[casadi.SX]:
        """All symbols, in the order of `mbm.kernels.types.ExternalCall`."""
        tables = [table for table in (self.slopes, self.bends) if table is not None]
        return [*self.values, *(symbol for table in tables for symbol in casadi.vertsplit(casadi.vec(table.T)))]


@dataclass(frozen=True, slots=True, eq=False)
class Differentiated:
    """Values (outputs,) and their Jacobian (outputs, variables), with symbols for what ``calls`` give."""

    values: casadi.SX
    jacobian: casadi.SX
    calls: tuple[DifferentiatedCall, ...] = ()

    def with_results(self, inputs: casadi.SX) -> casadi.SX:
        """The inputs of the programs: those of a row, and behind them what the calls give."""
        return casadi.vertcat(inputs, *(symbol for each in self.calls for symbol in each.results()))

    def with_stand_ins(self, expression: casadi.SX) -> casadi.SX:
        """``expression`` with a function of all arguments for each number that a call gives: for its dependence."""
        symbols, stand_ins = [], []
        for each in self.calls:
            stand_in = casadi.sum1(casadi.exp(each.arguments)) if each.arguments.numel() else casadi.SX(0)
            results = each.results()
            symbols += results
            stand_ins += [stand_in] * len(results)
        return casadi.substitute_inplace(symbols, stand_ins, [expression])[1][0] if symbols else expression

    def derivative(self, expression: casadi.SX, variables: casadi.SX) -> tuple[Differentiated, casadi.SX]:
        """The total derivative of an expression that the Jacobian is in; ``variables`` are those that this is by.

        Beside it, the same with the second derivatives of the calls.
        """
        rule = _ChainRule(variables)
        calls = []
        for number, each in enumerate(self.calls):
            w = len(each.wanted)
            bends = casadi.SX.sym(f"bend{number}", each.call.external.size, w * w)
            rule.add(each.values, casadi.mtimes(each.slopes, each.inner))
            for j in range(w):
                lines = casadi.mtimes(bends[:, j * w : (j + 1) * w], each.inner)
                rule.add(casadi.vertsplit(each.slopes[:, j]), lines)
            calls.append(replace(each, bends=bends))
        return replace(self, calls=tuple(calls)), rule.total(expression)

    def programs(self, inputs: casadi.SX) -> tuple[ExternalCall, ...]:
        """The calls as kernels have them."""
        return tuple(self._programs(inputs))

    def _programs(self, inputs: casadi.SX) -> Iterator[ExternalCall]:
        whole, first = self.with_results(inputs), int(inputs.numel())
        for each in self.calls:
            made = ExternalCall(
                external=each.call.external,
                arguments=program_of(casadi.Function("arguments", [whole], [casadi.densify(each.arguments)])),
                wanted=each.wanted,
                bent=each.bends is not None,
                first=first,
                sheets=programs_of(external.figure) if isinstance(external := each.call.external, Outlined) else (),
            )
            first += made.results
            yield made


class _ChainRule:
    """Total derivatives by ``variables``, where symbols stand for values that depend on them. Local to one block."""

    def __init__(self, variables: casadi.SX) -> None:
        self._variables = variables
        self._slopes: dict[int, casadi.SX] = {}

    def add(self, symbols: Sequence[casadi.SX], slopes: casadi.SX) -> None:
        """The derivatives of what ``symbols`` stand for, one line of (symbols, variables) each."""
        for i, symbol in enumerate(symbols):
            self._slopes[symbol.element_hash()] = slopes[i, :]

    def total(self, expression: casadi.SX) -> casadi.SX:
        """The Jacobian of ``expression`` with that of the symbols in it."""
        result = casadi.jacobian(expression, self._variables)
        used = [symbol for symbol in casadi.symvar(expression) if symbol.element_hash() in self._slopes]
        if used:  # all at once: one after the other, each would go through the whole expression
            by_symbol = casadi.jacobian(expression, casadi.vertcat(*used))
            slopes = casadi.vertcat(*(self._slopes[symbol.element_hash()] for symbol in used))
            result = result + casadi.mtimes(by_symbol, slopes)
        return result

    def chosen(self, choice: Choice) -> casadi.SX:
        """The derivative of a piecewise value, (1, variables)."""
        then, other = casadi.densify(self.total(choice.then)), casadi.densify(self.total(choice.other))
        pairs = [casadi.if_else(choice.test, then[j], other[j]) for j in range(int(self._variables.numel()))]
        return casadi.sparsify(casadi.horzcat(*pairs)) if pairs else casadi.SX(1, 0)

    def called(self, call: Call, number: int) -> DifferentiatedCall:
        """A call with symbols for its derivatives, which the rule takes in."""
        arguments = casadi.vertcat(casadi.SX(0, 1), *call.arguments)
        every = casadi.sparsify(self.total(arguments))
        wanted = tuple(i for i in range(len(call.arguments)) if every[i, :].nnz())
        inner = every[list(wanted), :]
        slopes = casadi.SX.sym(f"slope{number}", call.external.size, len(wanted))
        self.add(call.symbols, casadi.mtimes(slopes, inner))
        return DifferentiatedCall(call, arguments, wanted, inner, slopes)


def differentiated(lowered: Lowered, variables: casadi.SX) -> Differentiated:
    """Values and Jacobian. Piecewise values are differentiated branch by branch and then chosen from.

    Automatic differentiation of a choice multiplies the derivative of the branch not taken by zero, which makes NaN of
    the infinite slope of ``sqrt`` at zero that the condition was there to avoid.
    """
    values = casadi.densify(casadi.vertcat(*lowered.expressions))
    if not lowered.steps:
        return Differentiated(values, casadi.jacobian(values, variables))
    rule = _ChainRule(variables)
    known: list[casadi.SX] = []
    chosen: list[casadi.SX] = []
    calls: list[DifferentiatedCall] = []
    varying = _varying(lowered)
    for step in lowered.steps:
        if isinstance(step, Call):
            calls.append(rule.called(step, len(calls)))
            continue
        known.append(step.symbol)
        if isinstance(step, Constancy):
            chosen.append(step.value)
            continue
        if step.symbol.element_hash() in varying:
            rule.add([step.symbol], rule.chosen(step))
        chosen.append(casadi.if_else(step.test, step.then, step.other))
    found = [values, rule.total(values), *(part for each in calls for part in (each.arguments, each.inner))]
    if known:
        _, found = casadi.substitute_inplace(known, chosen, found)
    parts = iter(found[2:])
    calls = [replace(each, arguments=next(parts), inner=next(parts)) for each in calls]
    return Differentiated(found[0], found[1], tuple(calls))


def _varying(lowered: Lowered) -> frozenset[int]:
    """The symbols, by their hashes, on which the expressions depend otherwise than through what is held or a test."""
    found: set[int] = set()

    def note(*parts: casadi.SX) -> None:
        found.update(symbol.element_hash() for part in parts for symbol in casadi.symvar(part))

    note(*lowered.expressions)
    for step in reversed(lowered.steps):
        if isinstance(step, Call):
            note(*step.arguments)
        elif isinstance(step, Choice) and step.symbol.element_hash() in found:
            note(step.then, step.other)
    return frozenset(found)
