"""Unknowns and derived quantities → how they are shown: their units, and the names of their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.layout import Entry
from mbm.estimation.search.solution import Solution
from mbm.expression.dimension import Dimension
from mbm.expression.units import Unit
from mbm.problem.tables import Table
from mbm.problem.types import Derived, Problem, Unknown, UnknownKind
from mbm.report.elements import GEOMETRIC, coordinate_factors, element_names
from mbm.report.types import Floats, Key, Kind, Quantity
from mbm.scales import SI, Scale
from mbm.values import dataclass

UNIT_ONE = "1"
"""`:unit 1` says of an unknown that it is a pure number; nobody wants to read it beside the value."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """How all that a solution estimates is shown: unknowns and derived quantities in their order.

    ``names`` (M,) are those of all coordinates of all unknowns, ``factors`` (M,) SI per unit shown of differences.
    """

    unknowns: tuple[Quantity, ...]
    derived: tuple[Quantity, ...]
    names: tuple[str, ...]
    factors: Floats


def shown(problem: Problem, solution: Solution) -> Shown:
    """How the estimates of a solution are shown."""
    entries = solution.layout.entries
    unknowns = tuple(quantity_of(problem, entry.unknown) for entry in entries)
    pairs = tuple(zip(entries, unknowns, strict=True))
    return Shown(
        unknowns=unknowns,
        derived=tuple(derived_quantity(problem, problem.derived[one.owner]) for one in solution.derived),
        names=tuple(name for entry, quantity in pairs for name in element_names(quantity, entry.keys)),
        factors=np.concatenate([np.empty(0), *(entry_factors(quantity, entry) for entry, quantity in pairs)]),
    )


def quantity_of(problem: Problem, unknown: Unknown) -> Quantity:
    """How an unknown is shown."""
    unit, scale = _unit(unknown.unit, unknown.kind is UnknownKind.ANGLE, problem, unknown.name, _united(unknown))
    if unknown.unit is None and unit is not None and _is_rate_of_angle(problem, unknown):
        unit = f"rad{unit.removeprefix('1')}"
    return Quantity(
        name=unknown.name,
        kind=Kind(unknown.kind.value),
        shape=unknown.shape,
        dimension=unknown.dimension,
        unit=unit,
        scale=scale,
        doc=unknown.doc or None,
        over=_steps(problem) if unknown.is_state else None,
    )


def repeated(values: NDArray[Any], steps: tuple[int, ...]) -> NDArray[Any]:
    """The values, for all ``steps`` (their number) where a state does not change."""
    return np.tile(values, (*steps, *(1,) * values.ndim)) if steps else values


def entry_factors(quantity: Quantity, entry: Entry) -> Floats:
    """SI per unit shown for each coordinate of an unknown, members one after the other."""
    if quantity.kind in GEOMETRIC:
        return np.tile(coordinate_factors(quantity), entry.members)
    return np.full(entry.count, quantity.scale.factor)


def _steps(problem: Problem) -> str | None:
    return None if problem.sequence is None else problem.sequence.column


def derived_quantity(problem: Problem, derived: Derived) -> Quantity:
    """How a derived quantity is shown."""
    sequence = problem.sequence
    over = _steps(problem) if sequence is not None and derived.table == sequence.steps else None
    size = len(derived.cases[0].values) if derived.cases else 1
    if derived.kind is not None:
        square = derived.dimension**2
        lengths = range(square, square + derived.dimension) if derived.kind is not UnknownKind.ROTATION else range(0)
        unit, scale = _unit(derived.unit, False, problem, derived.name, lengths)
        kind = Kind(derived.kind.value)
        shape, dimension = derived.shape, derived.dimension
        return Quantity(
            name=derived.name, kind=kind, shape=shape, dimension=dimension, unit=unit, scale=scale, over=over
        )
    unit, scale = _unit(derived.unit, derived.angle, problem, derived.name, range(size))
    kind = Kind.ANGLE if derived.turns else Kind.VECTOR if derived.shape else Kind.REAL
    return Quantity(name=derived.name, kind=kind, shape=derived.shape, unit=unit, scale=scale, over=over)


def keys_over(derived: Derived, tables: Mapping[str, Table]) -> tuple[str | None, tuple[Key, ...] | None]:
    """What a derived quantity ranges over, and where it has its values there; None twice for one value."""
    if derived.table is None:
        return None, None
    if derived.grid is not None:
        return derived.grid.variable, tuple(derived.grid.shown().tolist())
    table = tables[derived.table]
    return derived.table, tuple(table.keys()) if table.key is not None else tuple(float(r) for r in table.rows)


def _is_rate_of_angle(problem: Problem, unknown: Unknown) -> bool:
    sequence = problem.sequence
    of = {state.name: state.rate_of for state in sequence.states} if sequence is not None else {}
    kinds = {each.name: each.kind for each in problem.unknowns}
    return kinds.get(of.get(unknown.name) or "") is UnknownKind.ANGLE


def _united(unknown: Unknown) -> range:
    """The numbers that have the unit: all of them, or those of the translation."""
    if not unknown.dimension:
        return range(unknown.size)
    if unknown.kind in (UnknownKind.POSE, UnknownKind.SIMILARITY):
        first = 4 if unknown.dimension == 3 else 1
        return range(first, first + unknown.dimension)
    return range(0)


def _unit(stated: Unit | None, angle: bool, problem: Problem, name: str, numbers: range) -> tuple[str | None, Scale]:
    if stated is not None:
        return (None if stated.symbol == UNIT_ONE else stated.symbol), stated.scale
    if angle:
        return "rad", SI
    found: set[Dimension | None] = {problem.dimensions.get((name, i)) for i in numbers}
    dimension = next(iter(found)) if len(found) == 1 else None
    return (dimension.symbol() or None, SI) if dimension is not None else (None, SI)
