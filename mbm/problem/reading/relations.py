"""``(= a b …) (<= a b …) … (uniform form lo hi)`` → what must be zero, and what must not be above zero.

An inequality asks for ``left − right ≤ 0``. What must hold of an angle depends on what it is compared with. Between two
limits without unknowns, it is the representative nearest their middle, so that ``(<= 170deg a 190deg)`` means what it
says; beside one such limit, the representative in (−π, π]; of two angles with unknowns, the wrapped difference counts.

Norms, absolute values and powers have no slope where they are zero: ``(= (distance p q) 0)`` takes away as many
dimensions as the points have coordinates; its derivative there takes none. So what makes them zero is demanded instead.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from itertools import pairwise, product

import numpy as np

from mbm.expression.algebra import add, constant_value, divide, negate, number, subtract, wrap
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Apply, Component, Constant, Expression, Number, Operation, externals, leaves
from mbm.language import faults as language_faults
from mbm.language.scope import difference, scalar, vector
from mbm.language.values import SCALARS, Array, ListValue, Value, describe
from mbm.language.vocabulary.rigid import geometric_difference
from mbm.problem import faults
from mbm.problem.kinds import ConstraintKind
from mbm.problem.rows import Positions, lookup
from mbm.problem.tables import Table
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

SIGNS = {"<": "<", "<=": "≤", ">": ">", ">=": "≥", "uniform": "≤", "=": "="}

EQUAL_NUMBERS = 1e-12
"""Known numbers that differ by less than this share of them are equal."""


THROUGH = frozenset({Operation.ABS, Operation.SQRT, Operation.NEGATE, Operation.HYPOT})
"""Operations that are zero where their argument is, and nowhere else."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two neighbours of a chain, in ascending order, and the component that they make."""

    left: Expression
    right: Expression
    component: Expression

    @property
    def known(self) -> bool:
        """No unknown occurs in it."""
        return not holds_unknown(self.component)


def smooth_parts(node: Expression, extreme: Operation) -> tuple[Expression, ...]:
    """The parts that a limit holds where it holds ``node``: of ``(max a b)`` below it both, of ``|a|`` a and −a.

    ``extreme`` is the maximum for a limit above, the minimum for one below. Methods need slopes, and ``node`` has a
    kink where its parts are equal: where the optimum is.
    """
    found: dict[tuple[Expression, Operation], Expression | None] = {}
    left = [(node, extreme, False)]
    while left:
        each, taken, minus = left.pop()
        if (each, taken) in found:
            continue
        found[each, taken] = None
        match each:
            case Apply(operation=operation, arguments=(a, b)) if operation is taken:
                left += [(b, taken, minus), (a, taken, minus)]
            case Apply(operation=Operation.ABS, arguments=(a,)) if taken is Operation.MAXIMUM:
                left += [(a, Operation.MINIMUM, not minus), (a, taken, minus)]
            case Apply(operation=Operation.NEGATE, arguments=(a,)):
                other = Operation.MINIMUM if taken is Operation.MAXIMUM else Operation.MAXIMUM
                left.append((a, other, not minus))
            case _:
                found[each, taken] = negate(each, each.span) if minus else each
    return tuple(part for part in found.values() if part is not None)


def holds_unknown(node: Expression) -> bool:
    """Whether an unknown occurs in ``node``."""
    return any(isinstance(leaf, Component) for leaf in leaves((node,)))


def pairs(kind: ConstraintKind, values: Sequence[Value], span: Span) -> tuple[Pair, ...]:
    """The pairs of neighbours in a chain of ``values``, element by element; numbers stand for every element.

    Raises:
        MbmError: sides of different lengths or kinds, too few of them.

    """
    wanted = 3 if kind is ConstraintKind.UNIFORM else 2
    if len(values) < wanted or (kind is ConstraintKind.UNIFORM and len(values) > wanted):
        usage = "(uniform form lo hi)" if kind is ConstraintKind.UNIFORM else f"({kind.value} a b …)"
        raise MbmError(language_faults.bad_form(span, f"`{kind.value}` wants {wanted} forms", usage))
    if kind is ConstraintKind.EQUAL:
        found: list[Pair] = []
        for left, right in pairwise(values):
            found.extend(_equal(left, right, span))
        return tuple(found)
    if kind is ConstraintKind.UNIFORM:
        values = (values[1], values[0], values[2])
    elif kind in (ConstraintKind.ABOVE, ConstraintKind.NOT_BELOW):
        values = tuple(reversed(values))
    return tuple(pair for chain in zip(*_elements(values, span), strict=True) for pair in _ascending(chain, span))


def _equal(left: Value, right: Value, span: Span) -> list[Pair]:
    geometric = geometric_difference(right, left, span)
    if geometric is not None:
        return [Pair(each, number(0, span), each) for each in geometric]
    return [pair for a, b in zip(*_elements((left, right), span), strict=True) for pair in _equal_numbers(a, b, span)]


def _equal_numbers(left: Expression, right: Expression, span: Span) -> list[Pair]:
    for one, other in ((left, right), (right, left)):
        if isinstance(other, Number) and other.value == 0 and holds_unknown(one):
            roots = tuple(root for root in vanishing(one) if not (isinstance(root, Number) and root.value == 0))
            if roots != (one,) and all(holds_unknown(root) for root in roots):
                return [Pair(root, other, difference(root, number(0, span), span)) for root in roots]
    return [Pair(left, right, difference(left, right, span))]


def _elements(values: Sequence[Value], span: Span) -> list[tuple[Expression, ...]]:
    """The elements of each value; numbers are repeated to the length of the others."""
    found: list[tuple[Expression, ...]] = []
    for value in values:
        if isinstance(value, bool | str):
            raise MbmError(language_faults.wrong_kind(span, "a number or a vector", describe(value)))
        if isinstance(value, SCALARS):
            found.append((scalar(value, span),))
        elif isinstance(value, Array) and value.is_matrix:
            found.append(value.elements)
        else:
            found.append(vector(value, span).elements)
    size = max((len(e) for e, v in zip(found, values, strict=True) if not isinstance(v, SCALARS)), default=1)
    for elements, value in zip(found, values, strict=True):
        if len(elements) != size and not isinstance(value, SCALARS):
            other = next(v for v in values if isinstance(v, Array | ListValue) and v is not value)
            raise MbmError(faults.unequal_sides(span, describe(value), describe(other)))
    return [elements * size if isinstance(v, SCALARS) else elements for elements, v in zip(found, values, strict=True)]


def _ascending(chain: tuple[Expression, ...], span: Span) -> list[Pair]:
    """``chain[0] ≤ chain[1] ≤ …`` as pairs."""
    known = [not holds_unknown(each) for each in chain]
    found: list[Pair] = []
    for i, (low, high) in enumerate(pairwise(chain)):
        over = chain[i + 2] if i + 2 < len(chain) and known[i + 2] else None
        under = chain[i - 1] if i > 0 and known[i - 1] else None
        sides = product(smooth_parts(low, Operation.MAXIMUM), smooth_parts(high, Operation.MINIMUM))
        found.extend(Pair(left, right, _excess(left, right, (under, over), span)) for left, right in sides)
    return found


def _excess(
    left: Expression, right: Expression, beyond: tuple[Expression | None, Expression | None], span: Span
) -> Expression:
    """What is not above zero where ``left ≤ right``; ``beyond`` are the known limits before and after the two."""
    known, limit = not holds_unknown(left), not holds_unknown(right)
    under, over = beyond
    if not (left.angle or right.angle) or (known and limit):
        return subtract(left, right, span)
    if not known and not limit:
        return difference(left, right, span)
    if known:
        middle = _middle(left, over, span) if over is not None else None
        return subtract(left, _near(right, middle, span), span)
    middle = _middle(under, right, span) if under is not None else None
    return subtract(_near(left, middle, span), right, span)


def _middle(low: Expression, high: Expression, span: Span) -> Expression:
    return divide(add(low, high, span), number(2, span), span)


def _near(angle: Expression, middle: Expression | None, span: Span) -> Expression:
    """The representative of ``angle`` that is nearest to ``middle`` (0 if None)."""
    if middle is None:
        return wrap(angle, span)
    return add(middle, wrap(subtract(angle, middle, span), span), span)


@np.errstate(all="ignore")  # what is no value shows in the numbers
def refuse_contradictions(
    kind: ConstraintKind,
    found: Sequence[Pair],
    table: Table | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
    span: Span,
    uncertain: Container[str] = (),
) -> None:
    """Decide the pairs that hold no unknown, for the rows at ``positions``; ``uncertain`` constants by their values.

    Raises:
        MbmError: one does not hold (`contradiction`), or has no value (`not-finite-cell`, `undefined-value`), or a
            function in Python would decide it.

    """
    for pair in found:
        if not pair.known or (positions is not None and len(positions) == 0):
            continue
        external = next(externals((pair.component,)), None)
        if external is not None:
            raise MbmError(faults.external_misplaced(external, "a constraint without unknowns"))
        numbers = evaluate((pair.left, pair.right, pair.component), lookup(table, positions, tables))
        left, right, value = np.broadcast_arrays(*(np.atleast_1d(np.asarray(each, dtype=float)) for each in numbers))
        rounding = EQUAL_NUMBERS * (np.abs(left) + np.abs(right))
        if kind is ConstraintKind.EQUAL:
            holds = np.abs(value) <= rounding
        elif kind in (ConstraintKind.BELOW, ConstraintKind.ABOVE):
            holds = value < 0
        else:
            holds = value <= rounding
        if bool(holds.all()):
            continue
        row = int(np.argmin(holds))
        place = None
        if table is not None and positions is not None and len(value) == len(positions):
            place = table.place(int(positions[row]), None)
        sign = SIGNS[kind.value]
        known = [leaf for leaf in leaves((pair.component,)) if isinstance(leaf, Constant) and leaf.name in uncertain]
        names = tuple(dict.fromkeys(leaf.name for leaf in known))
        sides = float(left[row]), float(right[row])
        if kind in (ConstraintKind.ABOVE, ConstraintKind.NOT_BELOW):
            sides = sides[::-1]  # as written
        raise MbmError(faults.contradiction(span, sides, sign, place, names))


def vanishing(node: Expression) -> tuple[Expression, ...]:
    """The expressions that are zero together where ``node`` is zero; the node itself where nothing better is known."""
    found: list[Expression] = []
    left = [node]
    while left:
        each = left.pop()
        inner = _inner(each)
        if inner is None:
            found.append(each)
        else:
            left.extend(reversed(inner))
    return tuple(found)


def _inner(node: Expression) -> tuple[Expression, ...] | None:
    """What is zero where ``node`` is, and nowhere else; None where that is the node itself."""
    if not isinstance(node, Apply):
        return None
    if node.operation in THROUGH:
        return node.arguments
    if node.operation is Operation.POWER:
        exponent = constant_value(node.arguments[1])
        return node.arguments[:1] if exponent is not None and exponent > 0 else None
    if node.operation in (Operation.ADD, Operation.MULTIPLY):
        return _roots(node)
    return None


def _roots(node: Expression) -> tuple[Expression, ...] | None:
    """The numbers whose squares ``node`` sums up; None where it is no sum of squares."""
    found: list[Expression] = []
    left = [node]
    while left:
        each = left.pop()
        if not isinstance(each, Apply):
            return None
        if each.operation is Operation.ADD:
            left.extend(reversed(each.arguments))
        elif _is_square(each):
            found.append(each.arguments[0])
        else:
            return None
    return tuple(found)


def _is_square(node: Apply) -> bool:
    if node.operation is Operation.MULTIPLY:
        return node.arguments[0] is node.arguments[1]
    return node.operation is Operation.POWER and constant_value(node.arguments[1]) == 2
