"""The unit in which the residuals of each observation are reported: that of what was measured.

One unknown noise factor belongs to one dimension: that of what it multiplies to give standard deviations.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from mbm.expression.dimension import NONE, Dimension
from mbm.expression.inference import Inference
from mbm.expression.nodes import Column, Expression, Number, leaves
from mbm.expression.units import TAKE_PREFIXES, Unit, parse_unit, unit_called
from mbm.problem import faults
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, NoiseKind
from mbm.text.types import Diagnostic, Label, Span
from mbm.values import dataclass


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
        return f"1{self.measured.suffix() or ('rad' if self.component.angle else '')}"


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
