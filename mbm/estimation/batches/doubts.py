"""Which of many solves have constraints whose surface bends within their intervals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.losses import loss_weights, rooted_slopes
from mbm.equations.metric import rounded_turns, turning
from mbm.equations.surface import exact_constraints, plainly_affine
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.factor import Factors, Spread, factors
from mbm.estimation.batches.portion import DerivedColumns, Portion, stated
from mbm.estimation.batches.surface import Held
from mbm.estimation.batches.types import Ends
from mbm.estimation.trust.curvature import MOST_DERIVED, UNMOVED, directions
from mbm.estimation.trust.leverage import ALONE, drawn
from mbm.estimation.trust.nonlinearity import (
    DETERMINED,
    LOOKED_AT,
    NORMAL_95,
    OF_LIKELIHOODS,
    derived_ratios,
    end_ratios,
    too_much,
)
from mbm.problem.types import Problem
from mbm.solver.decisions import ABSURD, BEND_STEP, LEAST_SIZE, vanishing

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Tangents


MARGIN = 1e-6
"""Share by which limits are narrowed here: far above what roundings in another order make of the same numbers."""

SIDES = (-1.0, 1.0)
"""The lower and the upper end of an interval."""


@np.errstate(all="ignore")
def doubtful(
    problem: Problem,
    portion: Portion,
    ends: Ends,
    found: Factors,
    spread: Spread,
    derived: tuple[DerivedColumns, ...],
    residuals: Floats,
    along: Tangents | None,
) -> Mask:
    """Solves (K,) whose intervals may miss their ends, or with rows that may draw the fit to themselves.

    ``residuals`` (K, m) are plain; ``along`` are the directions that constraints leave (None: there are none).
    """
    if not portion.equations.lossy:
        around = _Intervals(portion, ends, found, spread.deviation, None)
        return (spread.looked_at & _bent(problem, around, derived)) | _held_alone(portion, ends, found)
    weights, slopes = loss_weights(portion.acting(), residuals), portion.linearised(ends.points)[1]
    weighed = np.sqrt(weights)[:, :, None] * slopes
    fixed = factors(weighed, along)
    wrong = _drawn(portion, residuals, weights, np.matmul(slopes, fixed.root)) | ~fixed.good
    width = fixed.root.shape[2] - (0 if fixed.gone is None else fixed.gone.sum(axis=1))
    noise = np.sqrt(np.square(np.matmul(weighed, spread.factor)).sum(axis=(1, 2)) / width)
    return wrong | _bent(problem, _Intervals(portion, ends, fixed, noise, np.sqrt(weights)), derived)


def _held_alone(portion: Portion, ends: Ends, found: Factors) -> Mask:
    """Solves (K,) with rows left out by consensus, and others that hold something alone: `swapped` looks at those."""
    if ends.kept is None:
        return np.zeros(portion.count, dtype=bool)
    every = sum(each.counts * each.group.kernel.outputs for each in portion.lines)
    alone = (np.square(found.basis).sum(axis=2) > 1.0 - 2.0 * ALONE).any(axis=1)
    return np.asarray((every > ends.kept.count) & alone)


def _bent(problem: Problem, around: _Intervals, derived: tuple[DerivedColumns, ...]) -> Mask:
    """Solves (K,) an interval of which may miss its ends."""
    portion, found, noise = around.portion, around.found, around.noise
    linear, share = plainly_affine(portion.equations), _share(portion)
    # `nonlinearity.surroundings` looks whether the cost is that of these residuals; here they are, but for roundings
    if around.too_much:
        return np.full(portion.count, not linear or bool(derived))  # each says by itself that nobody looked
    wrong = np.zeros(portion.count, dtype=bool)
    if not linear:
        deviation = noise[:, None] * np.sqrt(np.square(found.root).sum(axis=2))
        for place in range(deviation.shape[1]):
            along = found.root[:, place] * (noise / deviation[:, place])[:, None]
            # what constraints determine has no interval
            wrong |= (deviation[:, place] > 0.0) & _off(around.ratios(along), share)
    for one, place in _looked_at(problem, derived):
        wrong |= _off(_derived_ends(around, one, place, problem.derived[one.owner].angle, linear), share)
    return wrong


def _share(portion: Portion) -> float:
    """By how much an end may be off, as a share of it, before it is looked at by itself."""
    return OF_LIKELIHOODS if portion.equations.likely and not portion.equations.lossy else LOOKED_AT


class _Intervals:
    """The linear 95 % intervals of K solves; under losses with fixed weights, whose ``roots`` (K, m) multiply residuals
    (None: there are no losses).
    """

    def __init__(self, portion: Portion, ends: Ends, found: Factors, noise: Floats, roots: Floats | None) -> None:
        self.portion = portion
        self._roots = roots
        self._cost = ends.cost
        if roots is not None:
            self._cost = np.square(roots * portion.residuals(ends.points)).sum(axis=1)
        self.ends = ends
        self.found = found
        self.noise = noise
        k = found.root.shape[2] - (0 if found.gone is None else int(found.gone.sum(axis=1).max(initial=0)))
        self.too_much = too_much(k, portion.most)
        self.turned = portion.equations.layout.reported(ends.points) - ends.points

    def point(self, along: Floats, side: float) -> Floats:
        """The points (K, N) at one end of the intervals in the directions ``along`` (K, k)."""
        steps = side * NORMAL_95 * self.noise[:, None] * np.matmul(self.found.root, along[:, :, None])[:, :, 0]
        return self.portion.equations.retract(self.ends.points, steps)

    def ratios(self, along: Floats) -> Floats:
        """The true ends (2, K) as multiples of the linear ones."""
        both = (self.portion.residuals(self.point(along, side)) for side in SIDES)
        seen = both if self._roots is None else (self._roots * residuals for residuals in both)
        basis, variance = self.found.basis, np.square(self.noise)
        return np.stack([end_ratios(residuals, basis, along, self._cost, variance) for residuals in seen])


def _looked_at(problem: Problem, derived: tuple[DerivedColumns, ...]) -> Iterator[tuple[DerivedColumns, int]]:
    """The numbers of derived quantities whose intervals are looked at, as `plausibility.doubts` picks them."""
    left = MOST_DERIVED
    for one in derived:
        if problem.derived[one.owner].kind is None and one.sigma.shape[1] <= left:
            left -= one.sigma.shape[1]
            yield from ((one, place) for place in range(one.sigma.shape[1]))


def _derived_ends(around: _Intervals, one: DerivedColumns, place: int, angle: bool, linear: bool) -> Floats:
    """The true ends (2, K) of the interval of one derived number; 1 where it has no standard deviation to speak of."""
    image = np.matmul(one.gradient[:, place, None, :], around.found.root)[:, 0]
    length = np.sqrt(np.square(image).sum(axis=1))
    parts = np.sqrt(np.square(around.found.root).sum(axis=2))
    parts = np.einsum("kn,kn->k", np.abs(one.gradient[:, place]), parts)
    told = length > DETERMINED * parts
    along = image / np.where(length > 0.0, length, 1.0)[:, None]
    grown = np.ones((2, len(length))) if linear else around.ratios(along)
    there = (stated(one.group, around.point(along, side) + around.turned)[:, place] for side in SIDES)
    moves = [values - one.values[:, place] for values in there]
    ends = derived_ratios(np.stack(moves), around.noise * length, grown, angle=angle)
    moving = around.portion.equations.is_free
    bends = not affine(one.group, moving)
    if bends or not bool(told.all()):
        # Without a derivative it may move all the same, and elsewhere farther than its derivative says.
        least = UNMOVED * np.maximum(np.abs(one.values[:, place]), parts)
        most = (1.0 + _share(around.portion) - MARGIN) * NORMAL_95 * around.noise * length
        least = np.where(told, most if bends else np.inf, least)
        far = _moves(around, one, place, angle=angle) > least
        ends = np.where(far, np.inf, np.where(told, ends, 1.0))
    return ends


def _moves(around: _Intervals, one: DerivedColumns, place: int, *, angle: bool) -> Floats:
    """How far (K,) a derived number moves around the estimates, at most, in some directions."""
    begin, found = one.values[:, place], np.zeros(len(one.values))
    for along in directions(around.found.root.shape[2]):
        each = np.broadcast_to(along, (len(found), len(along)))
        for side in SIDES:
            moved = stated(one.group, around.point(each, side) + around.turned)[:, place] - begin
            moved = moved - 2 * np.pi * np.round(moved / (2 * np.pi)) if angle else moved
            found = np.fmax(found, np.abs(moved))
    return found


def _off(ends: Floats, limit: float) -> Mask:
    """Solves (K,) one of whose ends (2, K) may be farther from 1 than the limit."""
    return np.asarray(~(np.abs(ends - 1.0) <= limit - MARGIN).all(axis=0))


def _drawn(portion: Portion, residuals: Floats, weights: Floats, basis: Floats) -> Mask:
    """Solves (K,) with a row under a loss that may draw the fit to itself."""
    lossy = np.zeros(residuals.shape, dtype=bool)
    for _, solve, slots in portion.losses():
        lossy[solve[:, None], slots] = True
    return np.asarray((drawn(residuals, basis, weights, portion.kept().sum(axis=1), MARGIN) & lossy).any(axis=1))


@np.errstate(all="ignore")
def stationary(portion: Portion, ends: Ends, found: Factors, jacobian: Floats) -> Mask:
    """Solves (K,) of whose Jacobians (K, m, n) `stationary` may find a column to be zero to first order."""
    equations = portion.equations
    wrong = np.zeros(portion.count, dtype=bool)
    if equations.linear:
        return wrong
    places = equations.layout.number[equations.free]
    size = np.abs(np.where(places >= 0, ends.points[:, places], 0.0))
    size = np.where(size > 0.0, size, 1.0)
    spread = np.maximum(1.0, np.sqrt(ends.cost / max(portion.most, 1))) * (1 + MARGIN)
    wrong |= (rounded_turns(turning(equations), found.scale) & (found.scale > 0.0)).any(axis=1)
    near = found.scale * ABSURD * size < spread[:, None]
    for place in np.flatnonzero(near.any(axis=0)).tolist():
        step = np.zeros(size.shape)
        step[:, place] = BEND_STEP * np.maximum(size[:, place], LEAST_SIZE)
        there = portion.linearised(equations.retract(ends.points, step))
        moved = rooted_slopes(portion.acting(), *there)[:, :, place] - jacobian[:, :, place]
        bend = np.sqrt(np.square(moved).sum(axis=1)) / step[:, place] * (1 + MARGIN)
        each = zip(found.scale[:, place], size[:, place], bend, spread, strict=True)
        zero = np.array([vanishing(*one) for one in each], dtype=bool)
        wrong |= near[:, place] & (zero | ~np.isfinite(bend))
    return wrong


BACK, NEARLY = 3, 0.03
"""Steps back to a surface, and how far what they find may be from what more of them would."""


@np.errstate(all="ignore")
def curved(portion: Portion, ends: Ends, state: Held, found: Factors, noise: Floats) -> Mask:
    """Solves (K,) whose surface may bend within their intervals, which then are looked at one by one.

    The quick look of `nonlinearity` at coordinates, the ends brought back to the surface as `trust.surface` does it;
    ``noise`` (K,) times the root that was ``found`` leads there. Not under losses.
    """
    wrong = np.zeros(portion.count, dtype=bool)
    if portion.equations.lossy or bool(exact_constraints(portion.equations).all()):
        return wrong
    slopes = np.where(state.forcing[:, :, None], state.slopes, 0.0)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    scale = np.where(found.scale > 0.0, found.scale, 1.0)
    back = np.linalg.pinv(slopes / scale[:, None, :]) / scale[:, :, None]
    for place in range(found.root.shape[1]):
        length = np.sqrt(np.square(found.root[:, place]).sum(axis=1))
        along = found.root[:, place] / np.where(length > 0.0, length, 1.0)[:, None]
        far = NORMAL_95 * noise * length
        for side in (-1.0, 1.0):
            step = side * NORMAL_95 * noise[:, None] * np.matmul(found.root, along[:, :, None])[:, :, 0]
            for _ in range(BACK):
                points = portion.equations.retract(ends.points, step)
                values = np.where(state.forcing, portion.constrained(points)[0], 0.0)
                step = step - np.matmul(back, values[:, :, None])[:, :, 0]
            residuals = portion.residuals(portion.equations.retract(ends.points, step))
            grown = end_ratios(residuals, found.basis, along, ends.cost, np.square(noise))
            ratio = step[:, place] / (side * far) * grown
            wrong |= (length > 0.0) & ~(np.abs(ratio - 1.0) <= LOOKED_AT - NEARLY)
    return wrong
