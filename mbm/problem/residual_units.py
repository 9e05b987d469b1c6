"""What observations are the MODEL of: units that residuals are reported in, and derived quantities as new readings."""

from __future__ import annotations

import re
from binascii import crc32
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbm.expression.evaluate import Values, evaluate
from mbm.expression.inference import Inference
from mbm.expression.nodes import (
    Column,
    ColumnMember,
    Component,
    Constant,
    Expression,
    Leaf,
    Member,
    Number,
    externals,
    leaves,
)
from mbm.expression.rows import RowChoice
from mbm.expression.units import NONE, TAKE_PREFIXES, Dimension, Unit, parse_unit, unit_called
from mbm.problem import faults
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Derived, Equation, NoiseKind, Problem
from mbm.text.types import Diagnostic, Label, Span
from mbm.values import dataclass

POINTS = 12
"""Points at which two forms are compared: functions that differ agree at none of them but by a freak."""

ALIKE = 1e-9
"""Relative difference of equal forms that were written otherwise: thousands of roundings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """A block, a case and an equation of it; ``columns`` leads from those of the derived form to those of the block."""

    block: int
    case: int
    equation: int
    columns: Mapping[str, str]


def observations_of(problem: Problem, derived: Derived) -> tuple[Modelled, ...]:
    """The observations whose MODEL is the form of a derived quantity, however it is written.

    Both have one case. The names of the columns are the same, or each depends on one column. The forms are compared at
    some points.
    """
    if derived.kind is not None or len(derived.cases) != 1:
        return ()
    form = derived.cases[0].values
    found = []
    for number, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION or len(block.cases) != 1:
            continue
        for place, equation in enumerate(block.cases[0].equations):
            if equation.measured is None or len(equation.components) != len(form):
                continue
            columns = _columns(form, derived.table, equation, block.table)
            if columns is not None and _alike(form, derived, equation, block.table, columns):
                found.append(Modelled(block=number, case=0, equation=place, columns=columns))
    return tuple(found)


def columns_of(nodes: tuple[Expression, ...], table: str | None) -> frozenset[str]:
    """The columns of the row at hand that forms depend on, keys of members among them."""
    found = set()
    for leaf in leaves(nodes):
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table:
            found.add(leaf.name)
        member = leaf.member if isinstance(leaf, Component | Column) else None
        if isinstance(member, ColumnMember) and member.row is RowChoice.EACH and member.table == table:
            found.add(member.column)
    return frozenset(found)


def _columns(
    form: tuple[Expression, ...], own: str | None, equation: Equation, table: str | None
) -> Mapping[str, str] | None:
    """From the columns of a form to those of a model; None where they do not correspond."""
    mine = columns_of(form, own)
    theirs = columns_of(equation.components, table) - columns_of(equation.measured or (), table)
    if mine == theirs:
        return {name: name for name in sorted(mine)}
    if len(mine) == len(theirs) == 1:
        return dict(zip(mine, theirs, strict=True))
    return None


def _alike(
    form: tuple[Expression, ...],
    derived: Derived,
    equation: Equation,
    table: str | None,
    columns: Mapping[str, str],
) -> bool:
    """Whether MODEL − MEASURED and MEASURED add up to the form, at all points where these have values."""
    every = (*form, *equation.components)
    if next(externals(every), None) is not None:
        return False
    own = evaluate(form, lambda leaf: _number(leaf, derived.table, columns))
    away = evaluate(equation.components, lambda leaf: _number(leaf, table, {}))
    measured = evaluate(equation.measured or (), lambda leaf: _number(leaf, table, {}))
    compared = False
    with np.errstate(all="ignore"):
        for mine, difference, reading in zip(own, away, measured, strict=True):
            apart = np.asarray(difference + reading - mine)
            apart = apart - 2 * np.pi * np.rint(apart / (2 * np.pi)) if derived.angle else apart
            known = np.isfinite(apart)
            compared |= bool(known.any())
            size = np.abs(mine) + np.abs(difference) + np.abs(reading)
            if bool((known & (np.abs(apart) > ALIKE * size)).any()):
                return False
    return compared


def _number(leaf: Leaf, table: str | None, columns: Mapping[str, str]) -> Values:
    """Numbers between 0 and 1 for a leaf, the same for one that means the same in another table."""
    if isinstance(leaf, Constant):
        return leaf.value
    if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table:
        identity: tuple[object, ...] = ("row", columns.get(leaf.name, leaf.name))
    elif isinstance(leaf, Column):
        identity = (leaf.table, leaf.name, leaf.row, _member(leaf.member, table, columns), id(leaf.sampling))
    elif isinstance(leaf, Component):
        identity = (leaf.unknown, leaf.index, _member(leaf.member, table, columns))
    else:
        identity = (id(leaf),)
    return np.random.default_rng(crc32(repr(identity).encode())).uniform(0.1, 1.0, POINTS)


def _member(member: Member | None, table: str | None, columns: Mapping[str, str]) -> object:
    if isinstance(member, ColumnMember) and member.row is RowChoice.EACH and member.table == table:
        return ("row", columns.get(member.column, member.column))
    return member


@dataclass(frozen=True, slots=True, kw_only=True)
class _Use:
    """A factor has a ``dimension`` in the standard deviation of a component, which has that of what is ``measured``."""

    dimension: Dimension
    measured: Dimension
    component: Expression
    span: Span

    @property
    def label(self) -> str:
        """What the factor is here."""
        if not self.dimension.is_none:
            return self.dimension.describe()
        return "an angle" if self.component.angle else "a pure number"

    @property
    def one(self) -> str:
        """A standard deviation of the component, as a problem file writes it."""
        return f"1{self.measured.symbol() or ('rad' if self.component.angle else '')}"


def factor_faults(blocks: Iterable[Block], inference: Inference) -> Iterator[Diagnostic]:
    """The first disagreement of each factor whose dimension is known in two places."""
    first: dict[str, _Use] = {}
    told: set[str] = set()
    for block in blocks:
        name = block.factor_name
        for equation in (e for case in block.cases for e in case.equations) if block.unknown_factor else ():
            uses = tuple(_uses(equation, inference))
            for use in uses:
                known = first.setdefault(name, use)
                if known.dimension != use.dimension and name not in told:
                    told.add(name)
                    yield _fault(block, known, use, uses)


def _uses(equation: Equation, inference: Inference) -> Iterator[_Use]:
    """What the factor is for each component, as far as it is known: the component over what is stated.

    A plain number states no dimension, and neither does one quantity that stands for all components of a vector.
    """
    alone = len({noise.span for noise in equation.noise}) == 1 and len(equation.noise) > 1
    for component, noise in zip(equation.components, equation.noise, strict=True):
        dimension = NONE if component.angle else inference.dimension(component)
        stated = inference.dimension(noise)
        if stated is None and (isinstance(noise, Number) or alone):
            stated = NONE
        if dimension is not None and stated is not None:
            yield _Use(
                dimension=dimension / stated,
                measured=dimension,
                component=component,
                span=component.span or equation.span,
            )


def _fault(block: Block, known: _Use, use: _Use, uses: tuple[_Use, ...]) -> Diagnostic:
    shared = block.structure.shared
    place = use.span if use.span != known.span else block.span
    label = Label(known.span, f"here it is {known.label}") if known.span != place else None
    if shared is not None and known not in uses:
        hint = f"give each clause a size with its unit, `(unknown {known.one} :as {shared})` and `(unknown {use.one}"
        hint += f" :as {shared})`, so that the factor is a pure number"
    elif known in uses:
        hint = "state a size with its unit for each component, `:sigma (unknown ["
        hint += f"{' '.join(each.one for each in uses)}])`, or write an `observe` clause for each"
    else:
        hint = "write an `observe` clause for each, with a factor of its own"
    return faults.factor_of_several_dimensions(place, use.label, known.label, label, hint)


_RADIAN = TAKE_PREFIXES["rad"]
NO_TURNS = frozenset({"px", "%", "ppm", "ppb"})
"""Pure numbers that are no angles."""
_WRITTEN = re.compile(r"[\d.](?P<unit>[^\W\d]+|%)$")


def with_units(blocks: Iterable[Block], inference: Inference, tables: Mapping[str, Table]) -> tuple[Block, ...]:
    """The blocks, those of observations, priors and transitions with the units of their equations' components.

    A unit is that of the measured columns; where none states one, that of ``:sigma`` if it is SI (``0.3px``); else that
    of the kind of thing (px, rad), or the SI unit of its dimension.
    """

    def united(equation: Equation) -> Equation:
        units = (
            _unit(equation, place, inference.dimension(component), tables)
            for place, component in enumerate(equation.components)
        )
        return replace(equation, units=tuple(units))

    return tuple(
        replace(
            block,
            cases=tuple(replace(case, equations=tuple(map(united, case.equations))) for case in block.cases),
        )
        if block.role is not BlockRole.CONSTRAINT
        else block
        for block in blocks
    )


def _unit(equation: Equation, place: int, dimension: Dimension | None, tables: Mapping[str, Table]) -> Unit | None:
    """The unit of one component."""
    kind = equation.units[place] if place < len(equation.units) else None
    turns = equation.components[place].angle or kind == _RADIAN
    dimension = NONE if turns else dimension

    def suits(unit: Unit) -> bool:
        return dimension in (None, unit.dimension) and not (turns and unit.symbol in NO_TURNS)

    stated = {unit.symbol: unit for unit in _measured(equation, place, tables) if suits(unit)}
    if len(stated) == 1:
        return next(iter(stated.values()))
    if equation.noise_kind in (NoiseKind.SIGMA, NoiseKind.BOUND):
        unit = _written(equation.noise[place], tables)
        if unit is not None and unit.scale.is_si and suits(unit):
            return unit
    if turns or (kind is not None and suits(kind)):
        return _RADIAN if turns else kind
    symbol = "" if dimension is None else dimension.symbol()
    return Unit(symbol, 1.0, dimension) if symbol and dimension is not None else None


def _measured(equation: Equation, place: int, tables: Mapping[str, Table]) -> Iterator[Unit]:
    """The units of the columns on the measured side of a component, or of all where it cannot be told which are."""
    if equation.measured is not None:
        columns = [leaf for leaf in leaves((equation.measured[place],)) if isinstance(leaf, Column)]
    else:
        every = leaves(equation.components)
        columns = [leaf for leaf in every if isinstance(leaf, Column) and leaf.name in equation.measured_columns]
    for column in columns:
        unit = _of_column(column, tables)
        if unit is not None:
            yield unit


def _written(noise: Expression, tables: Mapping[str, Table]) -> Unit | None:
    """The unit in which a standard deviation is written, as a number or a column."""
    if isinstance(noise, Column):
        return _of_column(noise, tables)
    if not isinstance(noise, Number) or noise.span is None:
        return None
    written = _WRITTEN.search(noise.span.text)
    return None if written is None else unit_called(written["unit"])


def _of_column(column: Column, tables: Mapping[str, Table]) -> Unit | None:
    found = tables[column.table].columns.get(column.name) if column.table in tables else None
    return None if found is None or found.unit is None else parse_unit(found.unit)
