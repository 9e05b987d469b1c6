"""A point of a sparse problem with everything computed there, and where steps from it lead: limited, and Newton's."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, sqrt
from typing import Protocol, runtime_checkable

import numpy as np

from mbm.equations.metric import magnitudes
from mbm.equations.types import Equations, Floats, Indices, Mask
from mbm.kernels.types import Backend
from mbm.problem.types import Method
from mbm.solver import description as of
from mbm.solver.decisions import POSITIVE_KEPT, ROUNDING_OF_BOUNDS, rounding_of_norm
from mbm.sparse.arithmetic import Arithmetic
from mbm.sparse.normal import Normal
from mbm.sparse.structure import Structure, Values
from mbm.sparse.system import Factorised, Plan
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
    return found.accumulate(here.values, np.where(here.held, 0.0, 1.0) if here.held.any() else None)


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


RULES = tuple(Method(name) for name, number in of.RULES.items() if number != of.MARQUARDT)
"""The methods whose steps are such."""


def length_of(step: Floats, squares: Floats) -> float:
    """The length of a step over the padded columns, with the metric's ``squares``."""
    return sqrt(float(squares @ np.square(step)))


def limited(rule: Method, plan: Plan, here: Place, step: Floats, squares: Floats, radius: float) -> Floats:
    """The undamped ``step`` where it is no longer than ``radius``, else the one that the rule has inside it.

    With bounds it is shortened: Powell's path might leave the box.
    """
    length = length_of(step, squares)
    if length <= radius:
        return step
    if rule is not Method.DOGLEG or here.gaps is not None:
        return step * (radius / length)
    downhill = np.where(step == 0.0, 0.0, -here.gradient / squares)
    image = plan.image(here.values, downhill)
    curvature = float(image @ image)
    slope = -float(here.gradient @ downhill)
    cauchy = downhill * (slope / curvature if curvature > 0.0 else 0.0)
    short = length_of(cauchy, squares)
    if short >= radius:
        return cauchy * (radius / short)
    onward = step - cauchy
    a, b = float(squares @ np.square(onward)), float(squares @ (cauchy * onward))
    c = short * short - radius * radius
    root = sqrt(max(b * b - a * c, 0.0))
    share = -c / (b + root) if b > 0.0 else (root - b) / a if a > 0.0 else 0.0
    return cauchy + min(share, 1.0) * onward


PRODUCTS = 50
"""Products with the Hessian in one step at most."""

FORCING = 1e-6
"""Share of the decrease that is left to the next step."""

NUDGE = 1e-4
"""Standard deviations over which gradients are compared: far above their rounding, far below what bends them."""


def newton_step(equations: BlockEquations, found: Plan, here: Place, factors: Factorised) -> tuple[Floats, float]:
    """Newton's step from a place over the padded columns, and the decrease of the cost that it promises.

    ``factors`` are those of ``JᵀJ`` there. Where the Hessian is indefinite along Gauss-Newton's step, that one.
    """
    still = found.structure.dead | here.held

    def pull(point: Floats) -> Floats:
        return found.gradient(equations.block_jacobian(point, found.arithmetic), equations.residuals(point))

    def along(force: Floats) -> Floats:
        return factors.solve(np.where(still, 0.0, force)[:, None])[:, 0]

    lengths = np.where(still, 0.0, np.sqrt(here.squares))
    bent = products(equations, here.point, pull, (here.gradient, lengths), found.structure.free)
    step, _ = conjugate(along, here.gradient, bent)
    return step, -float(here.gradient @ step)


def products(
    equations: Equations,
    point: Floats,
    pull: Callable[[Floats], Floats],
    here: tuple[Floats, Floats],
    free: Indices,
) -> Callable[[Floats], Floats]:
    """The Hessian times a direction (columns,), by differences of the gradient that ``pull`` gives at a point.

    ``here`` is the gradient at ``point``, and the lengths of the Jacobian's columns; ``free`` (n,) the estimated ones.
    """
    gradient, lengths = here

    def bent(direction: Floats) -> Floats:
        size = NUDGE / float((np.abs(direction) * lengths).max())
        return (pull(equations.retract(point, size * direction[free])) - gradient) / size

    return bent


def conjugate(
    along: Callable[[Floats], Floats], gradient: Floats, bent: Callable[[Floats], Floats]
) -> tuple[Floats, float]:
    """The step that conjugate gradients lead to, and the decrease that Gauss-Newton's would promise (Steihaug 1983).

    ``along`` is what Gauss-Newton makes of a gradient (columns,), ``bent`` the Hessian times a direction.
    """
    force = -gradient
    downhill = along(force)
    promise = left = float(force @ downhill)
    step, direction = np.zeros(len(force)), downhill
    for _ in range(PRODUCTS):
        if not left > FORCING * promise:
            break
        image = bent(direction)
        curvature = float(direction @ image)
        if not curvature > 0.0:
            return (step, promise) if step.any() else (downhill, promise)
        share = left / curvature
        step, force = step + share * direction, force - share * image
        downhill = along(force)
        left, before = float(force @ downhill), left
        direction = downhill + left / before * direction
    return step, max(promise, 0.0)
