"""Where an iteration is: a point with everything computed there, the tests that end at it, and the counters."""

from __future__ import annotations

from math import inf, isfinite, sqrt

import numpy as np

from mbm.solution.solvers.box import Box, Step, box_of, boxed_step
from mbm.solution.solvers.curvature import newton_step
from mbm.solution.solvers.scaled import Scaled, column_norms, decompose, magnitudes, turning
from mbm.solution.types import Equations, Floats, Mask, Minimum, Reason
from mbm.target.decisions import (
    CAP,
    EPSILON,
    FLOOR,
    MOST_DENSE,
    NEVER,
    ROUNDED_ROTATION,
    ROUNDING_ERRORS,
    UNSCALED,
    ZERO_COST,
)
from mbm.target.step_control import relative_offset
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """A point and all that depends on it alone (and on the columns seen so far).

    ``coordinates`` (n,) are those of the point, as bounds compare them.
    ``peak`` (n,) is the largest norm that each column has had (Moré 1978), ``scale`` (n,) > 0 the metric made of it;
    ``parts`` the decomposition of the Jacobian of the coordinates that are free to move; ``full`` the undamped step;
    ``free`` is None without bounds; ``noise`` the rounding of ‖r‖; ``ending`` why nothing is left to do here, or None.
    """

    point: Floats
    coordinates: Floats
    residuals: Floats
    jacobian: Floats
    cost: float
    peak: Floats
    scale: Floats
    parts: Scaled
    full: Step
    free: Mask | None
    offset: float
    freedom: int
    noise: float
    ending: Reason | None

    @property
    def slack(self) -> float:
        """Rounding of ``cost``: smaller changes of it mean nothing."""
        return 2.0 * self.noise * sqrt(self.cost) + self.noise * self.noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """An immutable value; ``reason`` is None while there is something left to do.

    ``curvature`` (n, n) is the second-order term per unit of ``‖r‖`` once it is known to be needed; ``patience`` the
    iterations before it may be computed anew.
    """

    place: Place
    box: Box
    tolerance: float
    radius: float
    curvature: Floats | None
    patience: int
    iterations: int
    evaluations: int
    reason: Reason | None
    bad_row: int | None


def begin(equations: Equations, point: Floats, tolerance: float) -> State:
    """The state at the start, projected into the bounds; finished at once where something is not finite there.

    Among many unknowns the second-order term is not taken: it needs a Jacobian for each.
    """
    box = box_of(equations)
    x = np.array(point, dtype=np.float64)
    if box.present:
        x = equations.placed(x, box.project(equations.coordinates(x)))
    residuals = equations.residuals(x)
    row, reason = first_bad(residuals), Reason.NOT_FINITE_AT_START
    if row is None and not isfinite(float(residuals @ residuals)):
        row = int(np.argmax(np.abs(residuals)))
    jacobian = np.zeros((residuals.size, equations.dimension))
    if row is None:
        jacobian = equations.jacobian(x)
        row, reason = first_bad(jacobian), Reason.JACOBIAN_NOT_FINITE_AT_START
    if row is not None:
        jacobian = np.zeros((residuals.size, equations.dimension))
    place = place_at(equations, x, residuals, jacobian, box, tolerance, None, None)
    weighted = place.scale * place.coordinates
    size, length = sqrt(float(weighted @ weighted)), sqrt(place.cost)
    return State(
        place=place,
        box=box,
        tolerance=tolerance,
        radius=inf if equations.linear else size if size > UNSCALED * length else length,
        curvature=None,
        patience=NEVER if equations.dimension > MOST_DENSE else 0,
        iterations=0,
        evaluations=1,
        reason=place.ending if row is None else reason,
        bad_row=row,
    )


def place_at(
    equations: Equations,
    point: Floats,
    residuals: Floats,
    jacobian: Floats,
    box: Box,
    tolerance: float,
    before: Place | None,
    curvature: Floats | None,
) -> Place:
    """Everything at a point; ``before`` is the place that it was reached from."""
    x = equations.coordinates(point)
    norms = column_norms(jacobian)
    peak = norms if before is None else np.maximum(norms, before.peak)
    scale = _held(_metric(peak, x), turning(equations))
    cost = float(residuals @ residuals)
    terms = norms * magnitudes(equations, x)
    size = sqrt(float(terms @ terms))
    noise = ROUNDING_ERRORS * EPSILON * (size + sqrt(cost))
    if not isfinite(cost):
        free, finite = None, np.zeros(residuals.size)
        parts, full = _undamped_step(x, finite, jacobian, scale, box, free, None)
    else:
        free = box.free(x, residuals @ jacobian) if box.present else None
        parts, full = _undamped_step(x, residuals, jacobian, scale, box, free, curvature)
    moving = x.size if free is None else int(free.sum())
    freedom = residuals.size - min(parts.rank, moving)
    offset = relative_offset(full.predicted, max(cost - full.predicted, 0.0), moving, freedom)
    movement = norms * full.vector
    ending = None
    if cost <= max(noise * noise, ZERO_COST):
        ending = Reason.EXACT_FIT
    elif offset <= tolerance:
        ending = Reason.SMALL_OFFSET
    elif sqrt(float(movement @ movement)) <= ROUNDING_ERRORS * EPSILON * size:
        ending = Reason.ROUNDING
    return Place(
        point=point,
        coordinates=x,
        residuals=residuals,
        jacobian=jacobian,
        cost=cost,
        peak=peak,
        scale=scale,
        parts=parts,
        full=full,
        free=free,
        offset=offset,
        freedom=freedom,
        noise=noise,
        ending=ending,
    )


def _held(scale: Floats, curved: Mask | None) -> Floats:
    """``scale`` with the columns of rotations that are rounding beside the others held: no step along them counts.

    Along a number such a step would do no harm, however long; a rotation by it spoils those about the other axes.
    """
    if curved is None:
        return scale
    largest = float(scale[curved].max(initial=0.0))
    return np.where(curved & (scale < ROUNDED_ROTATION * largest), largest, scale)


def _metric(peak: Floats, x: Floats) -> Floats:
    size = np.abs(x)
    values = peak * size
    least = FLOOR * float(values.max())
    if float(values.min()) >= least > 0.0:
        return peak
    wanted = np.divide(least, size, out=np.zeros(x.size), where=size > 0.0)
    scale: Floats = np.maximum(peak, np.minimum(wanted, CAP * peak))
    return np.where(scale > 0.0, scale, 1.0)


def _undamped_step(
    x: Floats,
    residuals: Floats,
    jacobian: Floats,
    scale: Floats,
    box: Box,
    free: Mask | None,
    curvature: Floats | None,
) -> tuple[Scaled, Step]:
    """Decomposition over the free coordinates, and the undamped step: Newton's where the curvature is known."""
    if free is None:
        parts = decompose(jacobian, residuals, scale)
    else:
        parts = decompose(jacobian[:, free], residuals, scale[free])
    newton = None
    if curvature is not None and parts.rank > 0:
        weight = sqrt(float(residuals @ residuals))
        newton = _newton(parts, (weight / np.multiply.outer(scale, scale)) * curvature, free)
    if newton is not None:
        step = Step(vector=newton[0] / scale, predicted=newton[1], length=sqrt(float(newton[0] @ newton[0])))
        if free is None or box.allows(x, step.vector):
            return parts, step
    if free is not None:
        return parts, boxed_step(jacobian, residuals, scale, free, box.gaps(x), undamped, inf)
    scaled = parts.gauss_newton()
    return parts, Step(vector=scaled / scale, predicted=parts.inside, length=sqrt(float(scaled @ scaled)))


def _newton(parts: Scaled, curvature: Floats, free: Mask | None) -> tuple[Floats, float] | None:
    if free is None:
        return newton_step(parts, curvature)
    inner = newton_step(parts, curvature[np.ix_(free, free)])
    if inner is None:
        return None
    whole = np.zeros(free.size)
    whole[free] = inner[0]
    return whole, inner[1]


def undamped(parts: Scaled, radius: float) -> Floats:
    """The step rule without any damping."""
    return parts.gauss_newton()


def first_bad(values: Floats) -> int | None:
    """Row (from 0) of the first value that is not finite."""
    good = np.isfinite(values)
    if good.all():
        return None
    return int(np.argmin(good if good.ndim == 1 else good.all(axis=1)))


def answer(state: State, reason: Reason) -> Minimum:
    """The state as an answer."""
    place = state.place
    return Minimum(
        point=place.point,
        residuals=place.residuals,
        jacobian=place.jacobian,
        cost=place.cost,
        reason=reason,
        iterations=state.iterations,
        evaluations=state.evaluations,
        offset=place.offset,
        at_bound=state.box.sides(place.coordinates, place.free, place.full),
        bad_row=state.bad_row,
    )
