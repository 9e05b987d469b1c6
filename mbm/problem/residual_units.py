"""The unit in which the residuals of each observation are reported: that of what was measured."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from mbm.expression.dimension import NONE, Dimension
from mbm.expression.inference import Inference
from mbm.expression.nodes import Column, Expression, Number, leaves
from mbm.expression.units import TAKE_PREFIXES, Unit, parse_unit, unit_called
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, NoiseKind

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
