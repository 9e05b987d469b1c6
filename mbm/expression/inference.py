"""Dimensions inferred through a whole problem by unification.

Every number, column, constant or unknown without a stated unit is a variable of the Abelian group of dimensions; every
sum, comparison and function call an equation in it. The equations are linear over the rationals in the exponents, so
solving them one after the other decides them: a contradiction is a clash of two known dimensions (LANGUAGE §6).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from fractions import Fraction
from typing import TypeAlias

from mbm.expression.algebra import UndefinedValueError, constant_value
from mbm.expression.derivative import substituted
from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Constant,
    Dimensions,
    Expression,
    External,
    Figure,
    Leaf,
    Number,
    Outlined,
    Parameter,
    Sheet,
    leaves,
    postorder,
)
from mbm.expression.rows import RowChoice
from mbm.expression.units import NONE, TAKE_PREFIXES, Dimension, Exponent, whole
from mbm.text.types import Span
from mbm.values import dataclass

Variable: TypeAlias = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class Term:
    """A dimension times powers of variables."""

    known: Dimension
    unknown: Mapping[Variable, Exponent] = field(default_factory=dict)

    def combine(self, other: Term, power: Exponent) -> Term:
        """self · other^power."""
        unknown = dict(self.unknown)
        for variable, each in other.unknown.items():
            value = whole(unknown.get(variable, 0) + each * power)
            if value:
                unknown[variable] = value
            else:
                unknown.pop(variable, None)
        return Term(self.known * other.known**power, unknown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Clash:
    """Two known dimensions that should be one. ``left`` and ``right`` are the expressions that carry them."""

    span: Span | None
    left: Expression
    right: Expression | None
    left_dimension: Dimension
    right_dimension: Dimension


@dataclass(frozen=True, slots=True, kw_only=True)
class Declared:
    """What is known before any use: the stated dimensions of unknowns' components and of columns, and joined names."""

    components: Mapping[tuple[str, tuple[int, ...]], Dimension]
    columns: Mapping[tuple[str, str], Dimension]
    same_column: Mapping[tuple[str, str], tuple[str, str]]


class Inference:
    """Collects equations between dimensions and solves them as they come. Local to one problem's check."""

    def __init__(self, declared: Declared) -> None:
        self._declared = declared
        self._solved: dict[Variable, Term] = {}
        self._terms: dict[int, Term] = {}
        self._alive: list[Expression] = []
        self._seen: set[tuple[Figure, tuple[int, ...]]] = set()
        self.clashes: list[Clash] = []
        self.has_absolute = False
        """Whether a number or constant is a temperature on a scale with a zero of its own."""

    def visit(self, roots: tuple[Expression, ...]) -> None:
        """Take in the equations of every node below ``roots``."""
        for node in postorder(roots):
            if id(node) not in self._terms:
                self._terms[id(node)] = self._reduce(self._term(node))
                self._alive.append(node)  # ids stay unique only while the nodes live
                if isinstance(node, Apply) and node.output is not None:
                    self._look(node, node.output.external)

    def _look(self, node: Apply, called: External | Outlined) -> None:
        """Take in the equations of what a silhouette is drawn from, which holds them within its sheets."""
        if not isinstance(called, Outlined):
            return
        own = node.arguments[: called.figure.size]
        key = called.figure, tuple(map(id, own))
        if key not in self._seen:
            self._seen.add(key)
            for image in _images(called.figure, own):
                self.visit(image)

    def equate(self, left: Expression, right: Expression, span: Span | None) -> None:
        """Two expressions have one dimension: a measured value and its sigma, an unknown and its start."""
        self.visit((left, right))
        self._equate(left, right, span)

    def settle(self) -> None:
        """Whole numbers and fractions that nothing gives a dimension are pure: the 2 and the 1/2 of formulas.

        Said last, so that it contradicts nothing; a decimal such as 9.81 stays open.
        """
        for node in self._alive:
            if isinstance(node, Number) and isinstance(node.value, int | Fraction):
                self._solve(self._reduce(self._terms[id(node)]))

    def dimension(self, node: Expression) -> Dimension | None:
        """The dimension of an expression, as far as the equations determine it."""
        self.visit((node,))
        term = self._reduce(self._terms[id(node)])
        return None if term.unknown else term.known

    def _leaf(self, node: Expression) -> Term:
        variable: Variable
        if isinstance(node, Number | Constant):
            self.has_absolute |= node.absolute
        if isinstance(node, Number):
            if node.dimension is not None:
                return Term(node.dimension)
            variable = ("number", id(node))
        elif isinstance(node, Constant):
            if node.dimension is not None:
                return Term(node.dimension)
            variable = ("constant", node.name)
        elif isinstance(node, Column):
            if node.row is RowChoice.COUNT:
                return Term(NONE)
            place = (node.table, node.name)
            place = self._declared.same_column.get(place, place)
            known = self._declared.columns.get(place)
            if known is not None:
                return Term(known)
            variable = ("column", *place)
        elif isinstance(node, Component):
            if node.angle:
                return Term(NONE)
            known = self._declared.components.get((node.unknown, node.index))
            if known is not None:
                return Term(known)
            variable = ("component", node.unknown, node.index)
        elif isinstance(node, Parameter):
            return Term(NONE)
        else:
            variable = ("opaque", id(node))
        return Term(NONE, {variable: 1})

    def _term(self, node: Expression) -> Term:
        if not isinstance(node, Apply):
            return self._leaf(node)
        rule, arguments = node.operation.dimensions, node.arguments
        terms = [self._terms[id(a)] for a in arguments]
        match rule:
            case Dimensions.ALIKE:
                left, right = arguments[-2:]
                self._equate(left, right, node.span)
                return self._carrier(left, right)
            case Dimensions.KEPT:
                return terms[0]
            case Dimensions.PRODUCT | Dimensions.QUOTIENT:
                return terms[0].combine(terms[1], 1 if rule is Dimensions.PRODUCT else -1)
            case Dimensions.ROOT:
                return Term(NONE).combine(terms[0], Fraction(1, 2))
            case Dimensions.POWER:
                return self._power(node, terms)
            case Dimensions.COMPARED:
                self._equate(arguments[0], arguments[1], node.span)
            case Dimensions.PURE:
                for argument in arguments:
                    self._pure(argument, node.span)
            case Dimensions.OPEN:
                return Term(NONE, {("external", id(node)): 1})
            case Dimensions.ANY:
                pass
        return Term(NONE)

    def _power(self, node: Apply, terms: list[Term]) -> Term:
        base, exponent = node.arguments
        self._pure(exponent, node.span)
        value = _number_of(exponent)
        if value is not None:
            return Term(NONE).combine(terms[0], whole(Fraction(value).limit_denominator(10**6)))
        self._pure(base, node.span)
        return Term(NONE)

    def _carrier(self, left: Expression, right: Expression) -> Term:
        term = self._terms[id(left)]
        return term if not self._reduce(term).unknown else self._terms[id(right)]

    def _pure(self, node: Expression, span: Span | None) -> None:
        difference = self._reduce(self._terms[id(node)])
        if not self._solve(difference):
            self.clashes.append(
                Clash(
                    span=span or node.span,
                    left=node,
                    right=None,
                    left_dimension=difference.known,
                    right_dimension=NONE,
                )
            )

    def _equate(self, left: Expression, right: Expression, span: Span | None) -> None:
        first, second = self._reduce(self._terms[id(left)]), self._reduce(self._terms[id(right)])
        if not self._solve(first.combine(second, -1)):
            self.clashes.append(
                Clash(
                    span=span or left.span or right.span,
                    left=left,
                    right=right,
                    left_dimension=first.known,
                    right_dimension=second.known,
                )
            )

    def _reduce(self, term: Term) -> Term:
        """``term`` in open variables."""
        solved = [v for v in term.unknown if v in self._solved]
        for variable in solved:
            self._shorten(variable)
        return self._substituted(term, solved) if solved else term

    def _shorten(self, variable: Variable) -> None:
        """Let a solved variable stand for open ones at once: what a long sum makes equal is a chain as long."""
        stack = [variable]
        while stack:
            term = self._solved[stack[-1]]
            solved = [v for v in term.unknown if v in self._solved]
            long = [v for v in solved if any(other in self._solved for other in self._solved[v].unknown)]
            if long:
                stack.extend(long)
            else:
                top = stack.pop()
                if solved:
                    self._solved[top] = self._substituted(term, solved)

    def _substituted(self, term: Term, variables: list[Variable]) -> Term:
        """``term`` without ``variables``, which stand for open ones."""
        for variable in variables:
            unknown = dict(term.unknown)
            exponent = unknown.pop(variable)
            term = Term(term.known, unknown).combine(self._solved[variable], exponent)
        return term

    def _solve(self, term: Term) -> bool:
        """Take in ``term = no dimension``; False where that contradicts what is known."""
        if not term.unknown:
            return term.known.is_none
        # A literal number gives way first: it says least about the world.
        variable = next((v for v in term.unknown if v[0] == "number"), next(iter(term.unknown)))
        exponent = term.unknown[variable]
        rest = Term(term.known, {v: e for v, e in term.unknown.items() if v != variable})
        self._solved[variable] = Term(NONE).combine(rest, whole(Fraction(-1) / exponent))
        return True


def _number_of(node: Expression) -> int | Fraction | float | None:
    """The value of numbers and constants, if it is one."""
    try:
        return constant_value(node)
    except UndefinedValueError:
        return None


def origin(node: Expression, inference: Inference, wanted: Dimension) -> Expression | None:
    """The leaf below ``node`` that best explains its dimension: one of the wanted dimension, else a known one."""
    known = [(leaf, inference.dimension(leaf)) for leaf in leaves((node,)) if leaf.span is not None]
    for leaf, dimension in known:
        if dimension == wanted and not isinstance(leaf, Number):
            return leaf
    for leaf, dimension in known:
        if dimension is not None and (dimension == wanted or not dimension.is_none):
            return leaf
    return None


def _images(figure: Figure, numbers: tuple[Expression, ...]) -> Iterator[tuple[Expression, ...]]:
    """A point of each patch of a figure, in terms of its ``numbers``, and one of each net."""
    share = Parameter("share")
    for sheet, places in figure.patches:
        yield _image(figure.sheets[sheet], (share, share, *(numbers[k] for k in places)))
    for seen in figure.nets:
        point = (Constant("coordinate", 0.0, TAKE_PREFIXES["m"].dimension),) * 3
        yield _image(figure.sheets[seen.point], (*point, *(numbers[k] for k in seen.of_point)))


def _image(sheet: Sheet, inputs: tuple[Expression, ...]) -> tuple[Expression, ...]:
    named: dict[Leaf, Expression] = {
        leaf: inputs[int(leaf.name)] for leaf in leaves(sheet.point) if isinstance(leaf, Constant)
    }
    return substituted(sheet.point, named)
