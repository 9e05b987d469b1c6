"""Unknowns and derived quantities → how they are shown: their units, and the names of their numbers."""

from __future__ import annotations

from mbm.expression.dimension import Dimension
from mbm.expression.units import Unit
from mbm.problem.types import Derived, Problem, Unknown, UnknownKind
from mbm.report.elements import element_names
from mbm.report.types import Kind, Quantity
from mbm.solution.solution import Solution

UNIT_ONE = "1"
"""`:unit 1` says of an unknown that it is a pure number; nobody wants to read it beside the value."""


def quantity_of(problem: Problem, unknown: Unknown) -> Quantity:
    """How an unknown is shown."""
    unit, factor = _unit(unknown.unit, unknown.kind is UnknownKind.ANGLE, problem, unknown.name, unknown.size)
    return Quantity(
        name=unknown.name,
        kind=Kind(unknown.kind.value),
        shape=unknown.shape,
        unit=unit,
        factor=factor,
        doc=unknown.doc or None,
    )


def derived_quantity(problem: Problem, derived: Derived) -> Quantity:
    """How a derived quantity is shown."""
    size = len(derived.cases[0].values) if derived.cases else 1
    unit, factor = _unit(derived.unit, derived.angle, problem, derived.name, size)
    kind = Kind.ANGLE if derived.angle and not derived.shape else Kind.VECTOR if derived.shape else Kind.REAL
    return Quantity(name=derived.name, kind=kind, shape=derived.shape, unit=unit, factor=factor)


def number_names(problem: Problem, solution: Solution) -> tuple[str, ...]:
    """The names of all numbers of all unknowns, in the order of ``solution.numbers`` (N,)."""
    entries = solution.layout.entries
    return tuple(name for e in entries for name in element_names(quantity_of(problem, e.unknown), e.keys))


def _unit(stated: Unit | None, angle: bool, problem: Problem, name: str, size: int) -> tuple[str | None, float]:
    if stated is not None:
        return (None if stated.symbol == UNIT_ONE else stated.symbol), stated.factor
    if angle:
        return "rad", 1.0
    found: set[Dimension | None] = {problem.dimensions.get((name, i)) for i in range(size)}
    dimension = next(iter(found)) if len(found) == 1 else None
    return (dimension.symbol() or None, 1.0) if dimension is not None else (None, 1.0)
