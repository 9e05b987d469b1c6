"""Constraints of large sparse problems: rounds of multiplied penalties (`mbm.solver.constraints`), solved sparsely.

The penalties are rows behind the residuals, so that each round is least squares with the blocks of all. What follows on
a round is decided as in dense problems. Newton steps on the KKT conditions end the search: the sum of squares with
penalties cannot tell points apart that are nearer than its rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Conflict, ConstraintState, Floats, Mask, Minimum, Reason
from mbm.estimation.minimise.constrained.feasible import feasible_point
from mbm.estimation.minimise.constrained.linearise import constraint_state, first_order
from mbm.estimation.minimise.constrained.types import Linearised
from mbm.estimation.minimise.sparse import least_damping, sparse_minimum
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.solver import constraints as rules
from mbm.solver.decisions import EXACT, FIRST_WEIGHT, HEAVIER, LOOSE, MET
from mbm.solver.step_control import relative_offset
from mbm.sparse.arithmetic import Arithmetic
from mbm.sparse.equations import Blocked, ForwardingBlocks, blocked
from mbm.sparse.place import conjugate, inside, products
from mbm.sparse.structure import Structure, Values
from mbm.sparse.system import BlockJacobian, DeferredMatrix, Factorised, Plan, blocks_of, factorised, plan
from mbm.values import dataclass

TOUCHED = 2000
"""Coordinates in constraints up to which a point that meets them is looked for, or what contradicts."""

REFINEMENTS = 20
"""Newton steps at the end at most."""

REDUNDANT = 1e-12
"""Relative eigenvalue of ``C A⁻¹ Cᵀ`` below which a constraint follows from others."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Penalised(ForwardingBlocks):
    """Residuals ``weight · c + shift`` of the constraints c (k,), ``weight`` (k,) > 0, behind those of ``equations``.

    Those of inequalities are penalties where they are positive only (protocol ``BlockEquations``).
    """

    equations: Blocked
    weight: Floats
    shift: Floats

    @property
    def count(self) -> int:
        """Residuals, and penalties."""
        return self.equations.count + len(self.weight)

    @property
    def linear(self) -> bool:
        """Never promised: inequalities have a kink."""
        return False

    def structure(self) -> Structure:
        """Which blocks there are."""
        return self.equations.structure()

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals, then penalties."""
        found = self.equations.residuals(x)
        found[len(found) - len(self.weight) :] = self._penalties(x)
        return found

    def block_jacobian(self, x: Floats, arithmetic: Arithmetic) -> Values:
        """Their Jacobian, for each piece of the structure."""
        values = self.equations.block_jacobian(x, arithmetic)
        weight = np.where(self._penalties(x) == 0.0, 0.0, self.weight)
        penalties = self.equations.penalties(x, np.where(self._equality, self.weight, weight), arithmetic)
        return [*values[: len(values) - len(penalties)], *penalties]

    def _penalties(self, x: Floats) -> Floats:
        found = self.weight * self.equations.equations.constraint_values(x) + self.shift
        return np.where(self._equality | np.isnan(found), found, np.maximum(found, 0.0))

    @property
    def _equality(self) -> Mask:
        return self.equations.equations.equality


@np.errstate(all="ignore")
def sparse_constrained_minimum(equations: Assembled, start: Floats, settings: Settings) -> Minimum:
    """The constrained minimum that the start leads to.

    Where the search ends with violations, a point that meets the constraints is looked for among the coordinates that
    they have, and the search goes on from there; without one, what contradicts is named.
    """
    if settings.method is Method.IPOPT:
        # Loads CasADi.
        from mbm.estimation.minimise.constrained.ipopt import interior_point

        start = interior_point(equations, start, settings.max_iterations)
        settings = replace(settings, method=Method.AUTO)
    own = blocked(equations)
    made = plan(own.structure(), own.backend, settings.workers)
    found = _searched(own, made, start, settings)
    if found.feasible or found.bad_row is not None or found.reason is Reason.INTERRUPTED:
        return found
    touched = np.unique(np.concatenate([group.columns.ravel() for group in equations.constraints if group.rows]))
    touched = np.intersect1d(touched, equations.free)
    if not 0 < len(touched) <= TOUCHED:
        return found
    point, conflict = feasible_point(equations.freed(touched, found.point), found.point, start, settings)
    if conflict is not None:
        place = np.searchsorted(equations.free, touched)
        told = replace(
            conflict,
            lower=tuple(int(place[j]) for j in conflict.lower),
            upper=tuple(int(place[j]) for j in conflict.upper),
        )
        return _contradicting(own, made, replace(found, point=point), told)
    again = _searched(own, made, point, settings)
    return replace(
        again if again.feasible and again.bad_row is None else found,
        iterations=found.iterations + again.iterations,
        evaluations=found.evaluations + again.evaluations,
    )


def _searched(own: Blocked, made: Plan, start: Floats, settings: Settings) -> Minimum:
    """Where rounds of penalties lead from a start."""
    equality = own.equations.equality
    point = inside(own, start)
    place = _first_order(own, made, point)
    unit = np.where(np.isfinite(place.unit), place.unit, 1.0)
    multipliers = np.zeros(len(unit))
    weight, worst, tolerance = FIRST_WEIGHT, inf, max(LOOSE, settings.tolerance)
    iterations, evaluations, rounds = 0, 0, 0
    while True:
        left = replace(settings, tolerance=tolerance, max_iterations=settings.max_iterations - iterations)
        penalised = Penalised(equations=own, weight=weight / unit, shift=multipliers * unit / weight)
        found = sparse_minimum(penalised, point, left, made)
        iterations, evaluations, rounds = iterations + found.iterations, evaluations + found.evaluations, rounds + 1
        found, point = replace(found, iterations=iterations, evaluations=evaluations), found.point
        if found.bad_row is not None:
            return replace(found, constraints=constraint_state(equality, place, np.zeros(len(unit))))
        place = _first_order(own, made, point)
        multipliers = _each(
            rules.multiplier_after, equality, multipliers, place.values, unit, np.full(len(unit), weight)
        )
        missed = _each(rules.missed_by, equality, multipliers, place.values, unit, place.rounding)
        now = float(missed.max(initial=0.0))
        if not found.reason.converged and found.reason is not Reason.FLAT:
            return _ended(own, made, found, place, multipliers)
        settled = int(tolerance <= settings.tolerance and found.reason is not Reason.FLAT)
        follows = rules.verdict(now, worst, weight, settled, rounds)
        if follows == rules.HOPELESS:
            found = replace(found, reason=Reason.FLAT if now <= MET else Reason.INFEASIBLE)
        if follows == rules.OVER:
            return _refined(own, made, _ended(own, made, found, place, multipliers), settings)
        if follows == rules.HOPELESS:
            return _ended(own, made, found, place, multipliers)
        weight = weight * HEAVIER if follows == rules.HEAVIER_STILL else weight
        worst, tolerance = min(worst, now), max(tolerance * rules.TIGHTER, settings.tolerance)


def _each(formula: Callable[..., float], equality: Mask, *given: Floats) -> Floats:
    """A formula of equations and inequalities (its last argument is 1 or 0) for all constraints (k,)."""
    of = of_arrays(formula)
    return np.where(equality, of(*given, 1), of(*given, 0))


def _first_order(own: Blocked, made: Plan, point: Floats) -> Linearised:
    """The constraints at a point, and the residuals and their Jacobian."""
    layout = made.structure
    values = own.block_jacobian(point, made.arithmetic)
    jacobian: Any = DeferredMatrix((own.count, len(layout.free)), lambda: layout.estimated(values))
    residuals, norms = own.equations.residuals(point), np.sqrt(made.squares(values)[layout.free])
    return first_order(own.equations, point, residuals, jacobian, norms)


def _ended(own: Blocked, made: Plan, found: Minimum, place: Linearised, multipliers: Floats) -> Minimum:
    """The end of a search, with its constraints."""
    state = constraint_state(own.equations.equality, place, multipliers)
    lost = found.reason.converged and bool(state.violated.any())
    return _with(own, made, replace(found, reason=Reason.FLAT if lost else found.reason), place, state)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Step:
    """The ``step`` (n,) on constraints that hold, their ``multipliers`` (k,), and how far the KKT conditions are from
    being met: the ``promise`` of a Gauss-Newton step along the manifold, and the violation in units.
    """

    step: Floats
    multipliers: Floats
    promise: float
    missed: float

    @property
    def error(self) -> float:
        """Both in squared standard deviations."""
        return self.promise + self.missed**2


def _refined(own: Blocked, made: Plan, found: Minimum, settings: Settings) -> Minimum:
    """The minimum after Newton steps that keep its active constraints and bounds; ``found`` if they lead off."""
    equations = own.equations
    best, step = found, _step(own, made, found)
    for _ in range(REFINEMENTS):
        if step is None or settings.stopped():
            return found
        moving = equations.dimension - int((best.at_bound != 0).sum())
        freedom = equations.count + int(_state(best).equality.sum()) - moving
        offset = relative_offset(step.promise, max(best.cost - step.promise, 0.0), moving, freedom)
        if offset <= settings.tolerance and step.missed <= EXACT:
            return replace(best, reason=Reason.SMALL_OFFSET)
        point = equations.retract(best.point, step.step)
        inside_box = np.clip(equations.coordinates(point), equations.lower, equations.upper)
        if not np.array_equal(inside_box, equations.coordinates(point)):
            return best
        place = _first_order(own, made, point)
        state = constraint_state(equations.equality, place, step.multipliers)
        if not np.array_equal(state.forcing, _state(best).forcing) or not np.isfinite(place.cost):
            return best
        worked = replace(best, point=point, iterations=best.iterations + 1, evaluations=best.evaluations + 1)
        there = _with(own, made, worked, place, state)
        onward = _step(own, made, there)
        if onward is None or not onward.error < step.error:
            return best
        best, step = there, onward
    return best


def _state(found: Minimum) -> ConstraintState:
    if found.constraints is None:
        message = "the minimum has no constraints"
        raise TypeError(message)
    return found.constraints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Manifold:
    """The constraints that hold at a point, to first order: ``slopes`` C (k, columns), zero in columns that are still.

    ``factors`` are those of A = JᵀJ and rows for the constraints, which change nothing along the manifold; ``across``
    is A⁻¹Cᵀ (columns, k), ``inverse`` the pseudo-inverse of C A⁻¹ Cᵀ.
    """

    factors: Factorised
    still: Mask
    slopes: Floats
    across: Floats
    inverse: Floats

    def along(self, force: Floats) -> Floats:
        """The tangent vector Z (ZᵀJᵀJZ)⁻¹ Zᵀ times a gradient (columns,)."""
        found = self.factors.solve(np.where(self.still, 0.0, force)[:, None])[:, 0]
        return found - self.across @ (self.inverse @ (self.slopes @ found))


def _manifold(made: Plan, values: Values, still: Mask, slopes: Floats, least: float) -> _Manifold | None:
    """None where the equations cannot be factorised."""
    normal = made.accumulate(values, np.where(still, 0.0, 1.0))
    factors = factorised(made, normal, np.where(still, 1.0, least * made.squares(values)))
    if factors is None:
        return None
    C = np.where(still, 0.0, slopes)
    across = factors.solve(C.T)
    inverse = np.asarray(np.linalg.pinv(C @ across, rcond=REDUNDANT, hermitian=True), dtype=np.float64)
    return _Manifold(factors=factors, still=still, slopes=C, across=across, inverse=inverse)


def _step(own: Blocked, made: Plan, found: Minimum) -> _Step | None:
    """The step from a point; None where there is none.

    Newton's method on the KKT conditions (Nocedal and Wright 2006, eq. 18.9): across the manifold to it, along it by
    conjugate gradients with what Gauss-Newton would do as the preconditioner, and the products of the Hessian of the
    Lagrangian from differences of its gradient.
    """
    layout, state = made.structure, _state(found)
    values = blocks_of(found).values
    still = layout.dead
    still[layout.free[found.at_bound != 0]] = True
    held = np.flatnonzero(state.forcing)
    manifold = _manifold(made, values, still, layout.padded(state.slopes[held].T).T, least_damping(own))
    if manifold is None:
        return None
    gradient = made.gradient(values, own.residuals(found.point))
    multipliers = np.zeros(len(state.values))
    multipliers[held] = -manifold.inverse @ (manifold.slopes @ manifold.factors.solve(gradient[:, None])[:, 0])
    lengths = np.sqrt(np.where(still, 0.0, made.squares(values)))

    def pull(point: Floats) -> Floats:
        """The gradient of the Lagrangian (columns,)."""
        slopes = own.block_jacobian(point, made.arithmetic)
        penalties = own.penalties(point, multipliers, made.arithmetic)
        residuals = own.residuals(point)
        residuals[len(residuals) - len(multipliers) :] = 1.0
        return made.gradient([*slopes[: len(slopes) - len(penalties)], *penalties], residuals)

    here = pull(found.point)
    along, promise = conjugate(manifold.along, here, products(own, found.point, pull, (here, lengths), layout.free))
    step = along - manifold.across @ (manifold.inverse @ state.values[held])
    scaled = manifold.slopes / np.where(lengths > 0.0, lengths, 1.0)
    unit = np.sqrt(np.square(scaled).sum(axis=1))
    missed = np.abs(state.values[held]) / np.where(unit > 0.0, unit, 1.0)
    if not bool(np.isfinite(step).all()):
        return None
    return _Step(
        step=step[layout.free], multipliers=multipliers, promise=promise, missed=float(missed.max(initial=0.0))
    )


def _contradicting(own: Blocked, made: Plan, found: Minimum, conflict: Conflict) -> Minimum:
    """The end at a point of least violation."""
    place = _first_order(own, made, found.point)
    state = constraint_state(own.equations.equality, place, np.zeros(len(place.values)))
    still = np.zeros(own.dimension, dtype=np.int8)
    ended = replace(found, reason=Reason.INFEASIBLE, at_bound=still)
    return _with(own, made, ended, place, replace(state, conflict=conflict))


def _with(own: Blocked, made: Plan, found: Minimum, place: Linearised, state: ConstraintState) -> Minimum:
    """A minimum with its constraints; those that hold the estimates are rows of its blocks, in their own units."""
    values = own.block_jacobian(place.point, made.arithmetic)
    held = own.penalties(place.point, np.where(state.forcing, 1.0 / place.unit, 0.0), made.arithmetic)
    return replace(
        found,
        residuals=place.residuals,
        jacobian=place.jacobian,
        cost=place.cost,
        constraints=state,
        blocks=BlockJacobian(plan=made, values=[*values[: len(values) - len(held)], *held]),
    )
