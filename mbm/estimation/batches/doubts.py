"""Which of many solves have constraints whose surface bends within their intervals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.metric import rounded_turns, turning
from mbm.equations.surface import exact_constraints, plainly_affine
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.factor import Factors, Spread, factors, rooted_slopes
from mbm.estimation.batches.portion import DerivedColumns, Portion, stated
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.surface import Held
from mbm.estimation.batches.types import Ends, Which
from mbm.estimation.trust.coarse import LEAST_ROWS, SIGNS, at_edge, clauses_read, coarse, rounded_column
from mbm.estimation.trust.curvature import MOST_DERIVED, UNMOVED, directions
from mbm.estimation.trust.hidden import LEAST_REDUNDANCY, narrow, stated_noise, tail
from mbm.estimation.trust.leverage import drawn
from mbm.estimation.trust.nonlinearity import (
    DETERMINED,
    LOOKED_AT,
    NORMAL_95,
    OF_LIKELIHOODS,
    derived_ratios,
    end_ratios,
    too_much,
)
from mbm.estimation.trust.plausibility import CHECKED, STRAINED, innovations
from mbm.problem.types import BlockRole, Problem
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
    """Solves (K,) whose intervals may miss their ends, whose priors may be strained, or that may hide outliers.

    ``residuals`` (K, m) are plain; ``along`` are the directions that constraints leave (None: there are none).
    """
    wrong = _strained(problem, portion, spread.basis, residuals)
    if not portion.equations.lossy:
        wrong |= _hiding(problem, portion, residuals, spread.basis)
        around = _Intervals(portion, ends, found, spread.deviation, None)
        return wrong | spread.looked_at & _bent(problem, around, derived)
    weights, slopes = _weights(portion, residuals), portion.linearised(ends.points)[1]
    weighed = np.sqrt(weights)[:, :, None] * slopes
    fixed = factors(weighed, along)
    wrong |= _drawn(portion, residuals, weights, np.matmul(slopes, fixed.root)) | ~fixed.good
    width = fixed.root.shape[2] - (0 if fixed.gone is None else fixed.gone.sum(axis=1))
    noise = np.sqrt(np.square(np.matmul(weighed, spread.factor)).sum(axis=(1, 2)) / width)
    return wrong | _bent(problem, _Intervals(portion, ends, fixed, noise, np.sqrt(weights)), derived)


def _weights(portion: Portion, residuals: Floats) -> Floats:
    """ρ' of plain residuals (K, m); 1 without a loss."""
    weights = np.ones(residuals.shape)
    for loss, solve, slots in portion.losses():
        place = solve[:, None]
        weights[place, slots] = loss.weight(np.square(residuals[place, slots]).sum(axis=1))[:, None]
    return weights


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
    moving = np.zeros(len(around.portion.equations.layout.number), dtype=bool)
    moving[around.portion.equations.free] = True
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


def _strained(problem: Problem, portion: Portion, basis: Floats, residuals: Floats) -> Mask:
    """Solves (K,) with a prior that may be farther from the data than `plausibility` leaves unsaid."""
    wrong = np.zeros(portion.count, dtype=bool)
    for owner, block in enumerate(problem.blocks):
        if block.role is BlockRole.PRIOR:
            solve, slot = portion.block_slots(owner)
            leverage = np.square(basis[solve, slot]).sum(axis=1)
            innovation = innovations(residuals[solve, slot], leverage, CHECKED / 10)
            np.logical_or.at(wrong, solve, ~(np.abs(innovation) <= STRAINED * (1 - MARGIN)))
    return wrong


def _hiding(problem: Problem, portion: Portion, residuals: Floats, basis: Floats) -> Mask:
    """Solves (K,) in whose stated noise outliers may hide."""
    wrong = np.zeros(portion.count, dtype=bool)
    if portion.most < LEAST_REDUNDANCY or portion.equations.likely:
        return wrong
    kept, components = portion.kept(), []
    for owner in (owner for owner, block in enumerate(problem.blocks) if stated_noise(block)):
        groups = [(solve, slots) for each, solve, slots in portion.groups() if each == owner]
        for component in range(max((slots.shape[1] for _, slots in groups), default=0)):
            there = np.zeros(kept.shape, dtype=bool)
            for solve, slots in groups:
                if component < slots.shape[1]:
                    there[solve, slots[:, component]] = True
            components.append(there & kept)
    enough = [each.sum(axis=1) >= LEAST_REDUNDANCY for each in components]
    for there, many in zip(components, enough, strict=True):
        for place in np.flatnonzero(many & narrow(residuals, there)).tolist():
            own, tested = there[place], sum(bool(each[place]) for each in enough)
            redundancy = 1.0 - np.square(basis[place, own]).sum(axis=1)
            wrong[place] |= tail(residuals[place, own], redundancy, tested, MARGIN) is not None
    return wrong


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
        moved = rooted_slopes(portion, *there)[:, :, place] - jacobian[:, :, place]
        bend = np.sqrt(np.square(moved).sum(axis=1)) / step[:, place] * (1 + MARGIN)
        each = zip(found.scale[:, place], size[:, place], bend, spread, strict=True)
        zero = np.array([vanishing(*one) for one in each], dtype=bool)
        wrong |= near[:, place] & (zero | ~np.isfinite(bend))
    return wrong


def misread(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.coarse` or `trust.edges` may warn of; ``noise`` (K,) multiplies standard deviations."""
    given = problem, stack, which, portion, residuals, basis, noise
    return coarsely_read(*given) | read_at_edges(*given)


@np.errstate(all="ignore")
def coarsely_read(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.coarse` may warn of; ``noise`` (K,) is what all standard deviations are multiplied by."""
    found = np.zeros(portion.count, dtype=bool)
    if portion.consensus or portion.equations.lossy or portion.equations.likely or portion.most < LEAST_ROWS:
        return found
    deviations: Floats | None = None
    for number, (owner, solve, slots) in enumerate(portion.groups()):
        name, table = rounded_column(problem, owner), problem.blocks[owner].table
        positions = stack.equations.groups[number].positions
        if name is None or table is None or positions is None or not len(solve):
            continue
        deviations = portion.deviations() if deviations is None else deviations
        readings = np.full(residuals.shape, np.nan)
        readings[solve, slots[:, 0]] = stack.tables[table].numbers(name)[positions[stack.lines(number, which)[1]]]
        found |= coarse(readings, residuals * deviations, deviations * noise[:, None], basis, MARGIN)
    return found


@np.errstate(all="ignore")
def read_at_edges(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.edges` may warn of; arguments as `coarsely_read` has them."""
    found = np.zeros(portion.count, dtype=bool)
    clauses = {} if portion.consensus else clauses_read(problem, stack.equations)
    if not clauses:
        return found
    deviations = portion.deviations()
    for clause, (table, column) in clauses.items():
        readings = np.full(residuals.shape, np.nan)
        for number, (owner, solve, slots) in enumerate(portion.groups()):
            positions = stack.equations.groups[number].positions
            if owner == clause and positions is not None and len(solve):
                readings[solve, slots[:, 0]] = stack.tables[table].numbers(column)[
                    positions[stack.lines(number, which)[1]]
                ]
        raw, scaled = residuals * deviations, deviations * noise[:, None]
        for sign in SIGNS:
            found |= at_edge(readings, raw, scaled, basis, sign, MARGIN)[1]
    return found


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
