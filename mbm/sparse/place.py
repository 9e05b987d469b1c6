"""A point of a sparse problem with everything computed there, and where steps from it may lead."""

from __future__ import annotations

from math import inf, sqrt
from typing import Protocol, runtime_checkable

import numpy as np

from mbm.equations.metric import magnitudes
from mbm.equations.types import Equations, Floats, Mask
from mbm.kernels.types import Backend
from mbm.solver.decisions import POSITIVE_KEPT, ROUNDING_OF_BOUNDS, rounding_of_norm
from mbm.sparse.arithmetic import Arithmetic
from mbm.sparse.normal import Normal
from mbm.sparse.structure import Structure, Values
from mbm.sparse.system import Plan
from mbm.values import dataclass


@runtime_checkable
class BlockEquations(Equations, Protocol):
    """Equations whose Jacobian comes in blocks."""

    @property
    def backend(self) -> Backend | None:
        """What evaluates the kernels."""
        ...

    @property
    def floored(self) -> bool:
        """Some combination of residuals has hardly any noise beside others."""
        ...

    def structure(self) -> Structure:
        """Which blocks there are; the same for every point."""
        ...

    def block_jacobian(self, x: Floats, arithmetic: Arithmetic) -> Values:
        """The whitened Jacobian at ``x``, for each piece of the structure."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """A point and what depends on it alone; ``held`` (columns,) are columns at a bound that descent would leave.

    ``gradient`` (columns,) is ``Jᵀr``, zero where held, ``squares`` (columns,) the squared norms of the columns,
    ``rounding`` that of the cost, ``gaps`` the farthest steps down and up (columns,), None without bounds.
    """

    point: Floats
    residuals: Floats
    values: Values
    gradient: Floats
    squares: Floats
    held: Mask
    cost: float
    rounding: float
    gaps: tuple[Floats, Floats] | None


def place_at(equations: BlockEquations, found: Plan, point: Floats, residuals: Floats, values: Values) -> Place | None:
    """Everything at a point; None where a derivative is not finite."""
    layout = found.structure
    gradient = found.gradient(values, residuals)
    squares = found.squares(values)
    if not (np.isfinite(squares).all() and np.isfinite(gradient).all()):
        return None
    held = np.zeros(layout.columns, dtype=bool)
    coordinates = equations.coordinates(point)
    slope = gradient[layout.free]
    held[layout.free] = ((coordinates <= equations.lower) & (slope >= 0.0)) | (
        (coordinates >= equations.upper) & (slope <= 0.0)
    )
    if held.any():
        gradient = np.where(held, 0.0, gradient)
    terms = np.sqrt(squares[layout.free]) * magnitudes(equations, coordinates)
    cost = float(residuals @ residuals)
    noise = rounding_of_norm(float(terms @ terms), cost)
    return Place(
        point=point,
        residuals=residuals,
        values=values,
        gradient=gradient,
        squares=squares,
        held=held,
        cost=cost,
        rounding=2.0 * noise * sqrt(cost) + noise * noise,
        gaps=_gaps(equations, found, point),
    )


def normal_at(found: Plan, here: Place) -> Normal:
    """``JᵀJ`` at a place, zero in the columns that are held."""
    if not here.held.any():
        return found.accumulate(here.values)
    return found.accumulate(found.structure.weighted(here.values, np.where(here.held, 0.0, 1.0)))


def _gaps(equations: Equations, found: Plan, point: Floats) -> tuple[Floats, Floats] | None:
    """Farthest steps down and up (columns,); None without bounds."""
    lower, upper, positive = equations.lower, equations.upper, equations.positive
    if not (positive.any() or np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    here = equations.coordinates(point)
    layout = found.structure
    down, up = np.full(layout.columns, -inf), np.full(layout.columns, inf)
    down[layout.free] = np.where(positive, np.maximum(lower - here, (POSITIVE_KEPT - 1.0) * here), lower - here)
    up[layout.free] = upper - here
    return down, up


def inside(equations: Equations, point: Floats) -> Floats:
    """The start with its coordinates inside the bounds."""
    found = equations.coordinates(point)
    kept = np.clip(found, equations.lower, equations.upper)
    return point if np.array_equal(found, kept) else equations.placed(point, kept)


def moved(equations: Equations, here: Place, found: Plan, step: Floats) -> Floats:
    """The point after a step; what the step puts on a bound stands on it to the last bit."""
    own = step[found.structure.free]
    point = equations.retract(here.point, own)
    if here.gaps is None:
        return point
    down, up = here.gaps[0][found.structure.free], here.gaps[1][found.structure.free]
    lower, upper = equations.lower, equations.upper
    reached = equations.coordinates(point)
    kept = np.clip(reached, lower, upper)
    near = ROUNDING_OF_BOUNDS * (np.abs(own) + np.abs(kept))
    kept = np.where((own <= down) & (kept <= lower + near), lower, kept)
    kept = np.where((own >= up) & (kept >= upper - near), upper, kept)
    return point if np.array_equal(reached, kept) else equations.placed(point, kept)


def first_bad_slope(layout: Structure, values: Values) -> int:
    """The first residual of the structure with a derivative that is not finite."""
    for piece, part in zip(layout.pieces, values, strict=True):
        bad = ~np.isfinite(part).all(axis=2)
        if bad.any():
            return piece.first + int(np.argmax(bad.reshape(-1)))
    return 0


def counted_as(equations: Equations, layout: Structure, residual: int) -> int:
    """The number of a residual of the structure among those that count; constraints count on behind them."""
    if layout.rows is None:
        return residual
    found = np.flatnonzero(layout.rows == residual)
    return int(found[0]) if found.size else equations.count - layout.count + residual
