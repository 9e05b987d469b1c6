"""Programs of equations and their data → how large each unknown is, as the terms of sums count beside one another.

The terms of a sum are alike in size, and so are the two sides of an equation; what ``exp``, ``sin`` and the like take
is about 1, and so are exponents. In logarithms these are linear equations for the sizes of the unknowns, as those of
dimensional analysis are for units: their least squares solution gives each a middle, the rows a range. An unknown that
is added to a column lies among the column's values.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.layout import places_in
from mbm.equations.types import Floats, Indices, Mask
from mbm.kernels.backends.numpy_stream import FUNCTIONS
from mbm.machine.program import Instruction, Operator
from mbm.problem.types import BlockRole
from mbm.values import dataclass

MOST = 100
"""Unknown numbers up to which their sizes are looked for."""

ROWS = 400
"""Rows of a group that are looked at: of more, evenly spread pairs of neighbours."""

ROUNDED_STEP = 1e-9
"""Distance of two values beside their whole range that may be rounding."""

NARROWEST = 1.0
"""Powers of ten that a range has at least."""

SUMS = {Operator.ADD: 1.0, Operator.SUB: -1.0, Operator.MIN: -1.0, Operator.MAX: -1.0, Operator.HYPOT: -1.0}
"""Operations on what is alike in size, and the sign with which the second vanishes beside the first."""

COMPARISONS = {Operator.LESS: -1.0, Operator.LESS_EQUAL: -1.0, Operator.ATAN2: -1.0}
"""The same, where the result is about 1."""

KEEPING = frozenset({Operator.NEG, Operator.ABS, Operator.TWICE, Operator.FLOOR, Operator.CEIL})

POWERS = {Operator.SQUARE: 2.0, Operator.SQRT: 0.5, Operator.RECIPROCAL: -1.0}

PRODUCTS = {Operator.MUL: 1.0, Operator.DIV: -1.0}

BENDING = frozenset(
    {
        *(Operator.EXP, Operator.SIN, Operator.COS, Operator.TAN, Operator.ASIN, Operator.ACOS, Operator.ATAN),
        *(Operator.SINH, Operator.COSH, Operator.TANH, Operator.ASINH, Operator.ACOSH, Operator.ATANH),
        *(Operator.LOG1P, Operator.EXPM1, Operator.ERF),
    }
)
"""Functions that bend where their argument is about 1."""

TURNING = frozenset({Operator.SIN, Operator.COS, Operator.TAN})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Magnitudes:
    """Per coordinate (M,): powers of ten between which its size lies, and values among which it lies; NaN: not told.

    Absolute values that data can tell lie between ``least`` and ``most``: half a turn of an angle over the least step.
    ``turn`` makes half a turn over all rows, where an angle is as many times ``turn`` as its number is large, or, with
    ``inverse``, as its reciprocal is; NaN where no angle tells.
    """

    low: Floats
    high: Floats
    first: Floats
    last: Floats
    least: Floats
    most: Floats
    turn: Floats
    inverse: Mask

    def frequencies(self, k: int, count: int) -> Floats:
        """Absolute values (at most ``count``,) of coordinate ``k``, each half a turn over all rows from the last."""
        if np.isnan(self.turn[k]):
            return np.zeros(0)
        highest = 1.0 / self.least[k] if self.inverse[k] else self.most[k]
        values = self.turn[k] * np.arange(1, int(min(highest / self.turn[k] + ROUNDED_STEP, count)) + 1)
        return np.asarray(1.0 / values if self.inverse[k] else values)

    def apart(self, k: int, value: float) -> float:
        """How far from ``value`` the next of the `frequencies` of coordinate ``k`` is; NaN where no angle tells."""
        return float(self.turn[k] * value**2 if self.inverse[k] else self.turn[k])

    @property
    def middle(self) -> Floats:
        """The sizes (M,); 1 where nothing tells."""
        return np.asarray(np.where(np.isnan(self.low), 1.0, 10.0 ** (0.5 * (self.low + self.high))))


Term: TypeAlias = tuple[int, Floats, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Size:
    """log₁₀ of a size: ``known`` (rows,) plus ``powers`` (variables,) times those of the variables.

    ``value`` (rows,) where it is a known number; ``factor`` (rows,) where it is a single variable times that; ``terms``
    where it is a sum of such, and of others divided by a variable: the variables with factors and powers of ±1.
    """

    known: Floats
    powers: Floats
    value: Floats | None = None
    factor: Floats | None = None
    terms: tuple[Term, ...] = ()


def magnitudes(equations: Assembled, base: Floats, missing: Mask) -> Magnitudes:
    """The sizes of the coordinates (M,) that ``missing`` marks; ``base`` (N,) has the numbers that are known."""
    layout = equations.layout
    wanted = np.flatnonzero(missing & (layout.number >= 0))
    low, high, first, last = (np.full(len(layout.number), np.nan) for _ in range(4))
    least, most = np.zeros(len(layout.number)), np.full(len(layout.number), np.inf)
    turn, inverse = np.full(len(layout.number), np.nan), np.zeros(len(layout.number), dtype=bool)
    found = Magnitudes(low=low, high=high, first=first, last=last, least=least, most=most, turn=turn, inverse=inverse)
    if not 0 < len(wanted) <= MOST:
        return found
    place = places_in(layout.number[wanted], len(layout.start))
    products: list[tuple[Floats, Floats]] = []
    for group in equations.groups:
        if group.role is BlockRole.OBSERVATION and not group.kernel.calls and group.gathered is None and group.rows:
            with np.errstate(all="ignore"):
                sizes = _Sizes(group.written, base, place)
                products += sizes.products(len(wanted))
                for k, values in sizes.among():
                    first[wanted[k]] = np.fmin(first[wanted[k]], np.nanmin(values, initial=np.inf))
                    last[wanted[k]] = np.fmax(last[wanted[k]], np.nanmax(values, initial=-np.inf))
                for k, limit, each, power in sizes.limits():
                    if power > 0:
                        most[wanted[k]] = min(most[wanted[k]], limit)
                    else:
                        least[wanted[k]] = max(least[wanted[k]], 1.0 / limit)
                    turn[wanted[k]], inverse[wanted[k]] = np.fmin(turn[wanted[k]], each), power < 0
    if products:
        low[wanted], high[wanted] = _solved(products, len(wanted))
    first[~np.isfinite(first)], last[~np.isfinite(last)] = np.nan, np.nan
    return found


def _solved(products: list[tuple[Floats, Floats]], count: int) -> tuple[Floats, Floats]:
    """Ranges (count,) of log₁₀ of the sizes; each product is what is known (rows,) and the powers (count,)."""
    system = np.stack([powers for _, powers in products])
    middle = np.linalg.lstsq(system, np.array([-known.mean() for known, _ in products]), rcond=1e-9)[0]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    for known, powers in products:
        rest = known + powers @ middle
        for k in np.flatnonzero(powers):
            values = middle[k] - rest / powers[k]
            low[k], high[k] = min(low[k], values.min()), max(high[k], values.max())
    told = np.isfinite(low) & np.isfinite(high)
    wider = np.maximum(NARROWEST - (high - low), 0.0) / 2
    return np.where(told, low - wider, np.nan), np.where(told, high + wider, np.nan)


class _Sizes:
    """What a group of equations says: products of sizes that make 1, and values among which variables lie."""

    def __init__(self, group: Group, base: Floats, place: Indices) -> None:
        chosen = np.arange(group.rows)
        if group.rows > ROWS:
            first = np.linspace(0, group.rows - 2, ROWS // 2).astype(np.int64)
            chosen = np.unique(np.concatenate([first, first + 1]))
        self._index = place[np.asarray(group.index)[chosen]]
        self._shared = group.shared
        self._products: list[tuple[Floats, Floats]] = []
        self._among: list[tuple[int, Floats]] = []
        self._turns: list[Term] = []
        self._none = np.zeros(self._index.shape[1])
        program = group.kernel.value_program
        inputs = np.hstack([base[np.asarray(group.index)[chosen]], group.parameters[chosen]])
        sizes: dict[int, _Size] = {number: self._number(np.full(len(chosen), v)) for number, v in program.constants}
        for position, number in enumerate(program.inputs):
            if number >= 0:
                variable = position < len(self._none) and bool((self._index[:, position] >= 0).all())
                sizes[number] = self._variable(position) if variable else self._number(inputs[:, position])
        for each in program.instructions:
            sizes[each.target] = self._applied(each, *(sizes[argument] for argument in each.arguments))

    def products(self, count: int) -> Iterator[tuple[Floats, Floats]]:
        """What is known (rows,) and the powers (count,) of the unknowns; one for each row where members differ."""
        for known, powers in self._products:
            usable = np.flatnonzero(np.isfinite(known))
            slots = np.flatnonzero(powers)
            together = all(self._shared[slot] for slot in slots)
            for rows in [usable] if together else usable[:, None]:
                whole = np.zeros(count)
                if rows.size:
                    np.add.at(whole, self._index[rows[0], slots], powers[slots])
                    yield known[rows], whole

    def among(self) -> Iterator[tuple[int, Floats]]:
        """An unknown, and the values (some,) among which it lies."""
        for slot, values in self._among:
            finite = np.isfinite(values)
            for k in np.unique(self._index[:, slot]):
                yield int(k), values[finite & (self._index[:, slot] == k)]

    def limits(self) -> Iterator[tuple[int, float, float, float]]:
        """An unknown, what makes half a turn of an angle over the least step and over all rows, and its power of ±1.

        Uneven rows tell faster turns apart than their mean step does (Eyer and Bartholdi 1999).
        """
        for slot, factor, power in self._turns:
            for k in np.unique(self._index[:, slot]):
                steps = np.diff(np.unique(factor[self._index[:, slot] == k]))
                steps = steps[steps > ROUNDED_STEP * steps.sum()]
                if steps.size:
                    yield int(k), float(np.pi / steps.min()), float(np.pi / steps.sum()), power

    def _number(self, value: Floats) -> _Size:
        """A known number; a 0 has no size, as that of another part of a rotation has none."""
        return _Size(known=np.log10(np.abs(value)), powers=self._none, value=value)

    def _variable(self, slot: int) -> _Size:
        powers = self._none.copy()
        powers[slot] = 1.0
        rows = len(self._index)
        return _Size(known=np.zeros(rows), powers=powers, factor=np.ones(rows), terms=((slot, np.ones(rows), 1.0),))

    def _one(self) -> _Size:
        return _Size(known=np.zeros(len(self._index)), powers=self._none)

    def _about_one(self, one: _Size) -> None:
        if one.powers.any():
            self._products.append((one.known, one.powers))

    def _applied(self, instruction: Instruction, one: _Size, other: _Size | None = None) -> _Size:
        """What an instruction makes of what it takes."""
        operator = instruction.operator
        if one.value is not None and (other is None or other.value is not None):
            values = (one.value,) if other is None else (one.value, other.value)
            return self._number(np.asarray(FUNCTIONS[operator](*values), dtype=np.float64))
        if other is not None:
            return self._of_two(operator, one, other)
        if operator in POWERS:
            return _Size(known=one.known * POWERS[operator], powers=one.powers * POWERS[operator])
        if operator in KEEPING:
            sign = -1.0 if operator is Operator.NEG else 2.0 if operator is Operator.TWICE else 1.0
            factor = None if one.factor is None else sign * one.factor
            return _Size(known=one.known, powers=one.powers, factor=factor, terms=_times(one.terms, sign))
        if operator in BENDING:
            self._about_one(one)
        if operator in TURNING:
            self._turns += one.terms
        return self._one()

    def _of_two(self, operator: Operator, one: _Size, other: _Size) -> _Size:
        if operator in SUMS:
            return self._summed(one, other, SUMS[operator])
        if operator in COMPARISONS:
            self._summed(one, other, COMPARISONS[operator])
            return self._one()
        if operator in PRODUCTS:
            sign = PRODUCTS[operator]
            return _Size(
                known=one.known + sign * other.known,
                powers=one.powers + sign * other.powers,
                factor=_factor(one, other, sign),
                terms=_product(one, other, sign),
            )
        if operator is Operator.POW and other.value is not None:
            exponent = float(np.median(other.value))
            return _Size(known=one.known * exponent, powers=one.powers * exponent)
        if operator is Operator.POW:
            self._about_one(other)
            return one
        return other if operator is Operator.SELECT else one

    def _summed(self, one: _Size, other: _Size, sign: float) -> _Size:
        """``one + sign · other``: alike in size; a variable alone on one side lies among the values of the other."""
        self._about_one(_Size(known=one.known - other.known, powers=one.powers - other.powers))
        known, unknown = (one, other) if one.value is not None else (other, one)
        terms = (*one.terms, *_times(other.terms, sign))
        if known.value is None:
            return _Size(known=one.known, powers=one.powers, terms=terms)
        if unknown.factor is None or np.ptp(known.value) == 0.0:
            return _Size(known=known.known, powers=known.powers, terms=terms)
        self._among.append((int(np.flatnonzero(unknown.powers)[0]), -sign * known.value / unknown.factor))
        return _Size(known=_distances(known.value), powers=known.powers, terms=terms)


def _times(terms: tuple[Term, ...], factor: Floats | float) -> tuple[Term, ...]:
    """Terms times what is known (rows,)."""
    return tuple((slot, each * factor, power) for slot, each, power in terms)


def _product(one: _Size, other: _Size, sign: float) -> tuple[Term, ...]:
    """The terms of a product or, with ``sign`` -1, a quotient with what is known; of a number over a variable too."""
    if other.value is not None:
        return _times(one.terms, other.value**sign)
    if one.value is None:
        return ()
    if sign > 0:
        return _times(other.terms, one.value)
    return () if other.factor is None else tuple((slot, one.value / each, -1.0) for slot, each, _ in other.terms)


def _factor(one: _Size, other: _Size, sign: float) -> Floats | None:
    """What a single variable is multiplied by in a product or, with ``sign`` -1, a quotient."""
    if one.factor is not None and other.value is not None:
        return one.factor * other.value**sign
    if other.factor is not None and one.value is not None and sign > 0:
        return other.factor * one.value
    return None


def _distances(values: Floats) -> Floats:
    """log₁₀ of distances (rows,) from a place among values or beyond them: from their spacing to their size."""
    smallest, largest = np.ptp(values) / len(values), np.abs(values).max()
    return np.linspace(np.log10(min(smallest, largest)), np.log10(max(smallest, largest)), len(values))
