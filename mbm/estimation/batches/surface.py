"""Constraints in many solves: how they stand at the ends, the directions that they leave, and limits of coordinates."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.metric import scale_of, violations
from mbm.equations.spreads import Limited
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.factor import Spread
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import DegreesColumns, Ends, Limits, Rows, Tangents
from mbm.estimation.coverage.limits import Lines, box, narrow, single_limits
from mbm.estimation.uncertainty.student import coverage_factors
from mbm.problem.kinds import ConstraintKind
from mbm.problem.types import Problem
from mbm.solver.decisions import CERTAIN, EPSILON, MET, PUSHED, ROUNDING_ERRORS
from mbm.values import dataclass


def limits(
    problem: Problem, stack: Stack, portion: Portion, found: Held, along: Tangents, multipliers: Floats
) -> Limits:
    """The constraints of some solves."""
    owners = tuple(dict.fromkeys(group.kernel.owner for group in stack.equations.constraints))
    mine = {owner: _mine(portion, owner) for owner in owners}
    pushing = found.forcing & ~found.equality
    return Limits(
        owners=owners,
        values=np.stack([_value(problem, found, owner, mine[owner]) for owner in owners], axis=1),
        active=np.stack([(found.active & mine[owner]).any(axis=1) for owner in owners], axis=1),
        pushed=np.stack([(pushing & mine[owner]).any(axis=1) for owner in owners], axis=1),
        rows=_rows(portion, owners),
        at_limit=tuple(_at_limit(problem, stack, portion, found, owner) for owner in owners),
        multipliers=_in_order(problem, stack, portion, multipliers),
        dimension=stack.equations.dimension - along.taken + along.equalities,
        moving=stack.equations.dimension - along.taken,
    )


def _in_order(problem: Problem, stack: Stack, portion: Portion, multipliers: Floats) -> Floats:
    """The multipliers (K, c) in the order of each solve by itself: windows are stacked by time, and look at rows as
    they stand in their table.
    """
    found = multipliers.copy()
    for each in portion.limits:
        table, positions = problem.blocks[each.group.kernel.owner].table, each.positions
        if table is not None and positions is not None:
            order = np.lexsort((stack.tables[table].rows[positions], each.solve))
            found[each.solve[:, None], each.slots] = multipliers[each.solve[:, None], each.slots[order]]
    return found


def _mine(portion: Portion, owner: int) -> Mask:
    """Which constraints (K, c) are those of a block."""
    found = np.zeros((portion.count, portion.most_limits), dtype=bool)
    for each in portion.limits:
        if each.group.kernel.owner == owner:
            found[each.solve[:, None], each.slots] = True
    return found


def _value(problem: Problem, found: Held, owner: int, mine: Mask) -> Floats:
    """What is left to the limit (K,), of equations the difference of their sides, the worst of several; 0 of none."""
    equation = problem.blocks[owner].constraint is ConstraintKind.EQUAL
    badness = np.where(mine, np.abs(found.values) if equation else found.values, -np.inf)
    worst = np.take_along_axis(found.values, badness.argmax(axis=1)[:, None], axis=1)[:, 0]
    worst = np.where(mine.any(axis=1), worst, 0.0)
    return worst if equation else 0.0 - worst


def _rows(portion: Portion, owners: tuple[int, ...]) -> Indices:
    """How often (K, owners) each block of constraints is there."""
    found = np.zeros((portion.count, len(owners)), dtype=np.int64)
    for each in portion.limits:
        found[:, owners.index(each.group.kernel.owner)] += np.bincount(each.solve, minlength=portion.count)
    return found


def _at_limit(problem: Problem, stack: Stack, portion: Portion, found: Held, owner: int) -> Rows | None:
    """The rows that are at their limit, of inequalities over a table."""
    block = problem.blocks[owner]
    if block.table is None or block.constraint is ConstraintKind.EQUAL:
        return None
    result: Rows | None = None
    for each in portion.limits:
        positions = each.positions
        if each.group.kernel.owner != owner or positions is None:
            continue
        reached = found.active[each.solve[:, None], each.slots].any(axis=1)
        mine = Rows.of_rows(stack.tables[block.table], positions[reached], each.solve[reached], portion.count)
        result = mine if result is None else result.joined(mine)
    return result


CLEAR = 1e-7
"""Singular values of the constraints' Jacobian above this share of the largest are non-zero, far above
`decisions.SUSPECT`. Between this and `FAINT` the rank is ambiguous, and the solve is made by itself, with an SVD."""

FAINT = CERTAIN / 10.0
"""Singular values below this share are zero, whichever of the two ways computes them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """The constraints of K solves at their ends, as `ConstraintState` has them: (K, c), (K, c, n) for ``slopes``.

    What a solve has fewer of is neither ``there`` nor anything else.
    """

    values: Floats
    slopes: Floats
    there: Mask
    equality: Mask
    violated: Mask
    active: Mask
    forcing: Mask


@np.errstate(all="ignore")
def held(portion: Portion, points: Floats, jacobian: Floats, cost: Floats, multipliers: Floats) -> Held:
    """How the constraints stand at ``points`` (K, N), where the residuals have the ``jacobian`` (K, m, n)."""
    values, slopes = portion.constrained(points)
    there, equality = _kinds(portion)
    equations = portion.equations
    scale = scale_of(lengths(jacobian), slopes)
    places = equations.layout.number[equations.free]
    size = np.where(places >= 0, np.abs(points[:, places]), 1.0)
    unit = np.sqrt(np.square(slopes / scale[:, None, :]).sum(axis=2))
    unit = np.where(unit > 0.0, unit, 1.0)
    rounding = ROUNDING_ERRORS * EPSILON * (np.matmul(np.abs(slopes), size[:, :, None])[:, :, 0] + np.abs(values))
    allowed = MET * unit + rounding
    active = there & (equality | (values >= -allowed))
    gain = multipliers[:, : values.shape[1]] * unit
    pushed = gain > PUSHED * (1.0 + np.sqrt(np.maximum(cost, 0.0)))[:, None]
    return Held(
        values=values,
        slopes=slopes,
        there=there,
        equality=equality,
        violated=there & ~(violations(values, equality) <= allowed),
        active=active,
        forcing=active & (equality | pushed),
    )


@np.errstate(all="ignore")
def tangents(found: Held, jacobian: Floats) -> Tangents:
    """The directions that the constraints with a force of their own leave, for K Jacobians (K, m, n)."""
    count, _, width = found.slopes.shape
    most = int(found.forcing.sum(axis=1).max(initial=0))
    picked = np.argsort(~found.forcing, axis=1, kind="stable")[:, :most]
    forcing = np.take_along_axis(found.forcing, picked, axis=1)
    equality = forcing & np.take_along_axis(found.equality, picked, axis=1)
    slopes = np.take_along_axis(found.slopes, picked[:, :, None], axis=1) * forcing[:, :, None]
    finite: Mask = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
    slopes = np.where(finite[:, None, None], slopes, 0.0)
    scale = scale_of(lengths(jacobian), slopes)
    finite &= np.isfinite(scale).all(axis=1)
    rows = np.where(finite[:, None, None], slopes / scale[:, None, :], 0.0)
    length = np.sqrt(np.square(rows).sum(axis=2))
    rows /= np.where(length > 0.0, length, 1.0)[:, :, None]
    if most == 0:
        taken, right = np.zeros(count, dtype=np.int64), np.broadcast_to(np.eye(width), (count, width, width))
        clear = finite
    else:
        _, singular, right = np.linalg.svd(rows, full_matrices=True)
        taken, clear = _rank(singular)
    equalities, sure = taken, clear & finite
    if bool((forcing & ~equality).any()):
        equalities, certain = _rank(np.linalg.svd(rows * equality[:, :, None], compute_uv=False))
        sure = sure & certain
    gone = np.arange(width) < taken[:, None]
    basis = np.where(gone[:, None, :], 0.0, right.transpose(0, 2, 1))
    sure = sure & (taken < width) & ~found.violated.any(axis=1)
    return Tangents(basis=basis, scale=scale, gone=gone, equalities=equalities, clear=sure)


def lengths(jacobian: Floats) -> Floats:
    """The lengths (K, n) of the columns of Jacobians (K, m, n)."""
    return np.asarray(np.sqrt(np.einsum("kmn,kmn->kn", jacobian, jacobian)))


def _rank(singular: Floats) -> tuple[Indices, Mask]:
    """How many singular values (K, r), descending, are something, and whether that is beyond doubt (K,)."""
    shares = singular / np.where(singular[:, :1] > 0.0, singular[:, :1], 1.0)
    there = shares >= CLEAR
    return there.sum(axis=1), np.asarray((there | (shares <= FAINT)).all(axis=1))


def _kinds(portion: Portion) -> tuple[Mask, Mask]:
    """Which constraints (K, c) there are, and which of them are equations."""
    equations = portion.equations
    there = np.zeros((portion.count, portion.most_limits), dtype=bool)
    equality = there.copy()
    for each in portion.limits:
        first, at = each.group.first, (each.solve[:, None], each.slots)
        there[at] = True
        equality[at] = equations.equality[first : first + each.group.kernel.outputs]
    return there, equality


@np.errstate(all="ignore")
def limited_columns(portion: Portion, found: Held | None, points: Floats) -> Limited | None:
    """The limits at the ends ``points`` (K, N) of K solves; None where there are none.

    What a limit holds is no matter of columns.
    """
    equations = portion.equations
    shape = (portion.count, equations.dimension)
    lower, upper = (np.broadcast_to(each, shape).copy() for each in box(equations))
    held = np.zeros(shape, dtype=bool)
    if found is not None:
        plain = equations.is_free
        exact = np.zeros(found.there.shape, dtype=bool)
        for each in portion.limits:
            exact[each.solve[:, None], each.slots] = affine(each.group, plain)
        single, owner = single_limits(found.slopes, exact & found.there & ~found.equality)
        places = equations.layout.number[equations.free]
        place = np.where(places >= 0, points[:, places], 0.0)
        held = narrow(lower, upper, place, Lines(found.values, found.slopes, found.forcing, single, owner))
    if not (held.any() or np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    return Limited(lower=lower, upper=upper, step=np.where(held, np.inf, np.nan), sigma=np.full(shape, np.nan))


def held_back(found: Held) -> Mask:
    """Solves (K,) that an inequality holds: where it lets go of them is looked for one by one."""
    return np.asarray((found.forcing & ~found.equality).any(axis=1))


@np.errstate(all="ignore")
def near_limits(
    problem: Problem,
    portion: Portion,
    ends: Ends,
    limits: tuple[Held | None, Limited | None],
    spread: Spread,
    degrees: DegreesColumns,
) -> Mask:
    """Solves (K,) of likelihoods, and with derived quantities, with an estimate that a limit holds, or is within twice
    the linear interval of; so, too, of inequalities of several.

    Such intervals are looked for one by one.
    """
    found, limited = limits
    near = np.zeros(portion.count, dtype=bool)
    if not (portion.equations.likely or problem.derived):
        return near
    freedom, places = degrees.estimates, portion.equations.layout.number[portion.equations.free]
    factors = 2.0 * coverage_factors(problem.request.coverage, freedom.dof) * freedom.inflation
    if limited is not None:
        reach, place = factors * spread.sigma, ends.points[:, places]
        close = ~np.isnan(limited.step) | (place - reach < limited.lower) | (place + reach > limited.upper)
        near |= (close & (places >= 0)).any(axis=1)
    if found is not None:
        sigma = np.sqrt(np.square(np.matmul(found.slopes, spread.factor)).sum(axis=2))
        close = -found.values < sigma * factors.max(axis=1, keepdims=True)
        near |= (close & found.there & ~found.equality).any(axis=1)
    return near
