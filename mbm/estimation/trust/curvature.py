"""The ends of all 95 % intervals against the stated ones, found once: for the doubts, and for intervals by profile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group, affine
from mbm.equations.surface import OnSurface, on_surface
from mbm.equations.types import Covariance, Floats, Indices, Minimum
from mbm.estimation.search.search import Alternative
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.farthest import farthest
from mbm.estimation.trust.nonlinearity import (
    DETERMINED,
    LOOKED_AT,
    MOST_FOLLOWED,
    NORMAL_95,
    SAME_EQUATIONS,
    IntervalEnds,
    Surroundings,
    derived_ends,
    interval_ends,
    points_after,
    residuals_at,
    surroundings,
)
from mbm.estimation.trust.profile import END_ACCURACY, DerivedProfile, Surface
from mbm.estimation.uncertainty.derived import Propagation
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.trust.beyond import Beyond

MOST_DERIVED = 200
"""Derived numbers whose intervals are looked at."""

MOST_BROUGHT_BACK = 600
"""Squared directions times profiles that are followed on curved constraints, to which each point goes back alone."""


UNMOVED = 1e-6
"""Share of its size by which a number without a derivative has to move to be taken for more than a rounding."""

FLATTER = 1e-6
"""Share of how far a number varies that its standard deviation reaches where its derivative is zero but for roundings
and for how far the solve is from the minimum, as that of the root mean square of the residuals is."""

MOST_BETWEEN = 12
"""Directions between which pairs are tried as well."""

ALONG_LINES = np.linspace(-1.0, 1.0, 9)
"""Places on lines through the estimates, as shares of how far these go, where derived numbers are looked at."""

MOST_LINES = 8
"""Lines along which the farthest place is looked for: those where the number goes farthest at these."""

FARTHER = 0.05
"""Share by which a quantity goes beyond an end at some point that is as likely, from which on that is followed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedEnds:
    """The ``ends`` of the numbers ``known`` (k,) of a derived quantity, by their places in it.

    ``values`` (P, k) gives these numbers at P points, ``gradient`` (k, n) is that at the minimum. ``flat`` are places
    of numbers whose derivative is zero there although they vary around it, as a square at 0; ``about`` gives those.
    """

    owner: int
    known: Indices
    ends: IntervalEnds
    gradient: Floats
    values: Callable[[Floats], Floats]
    angle: bool
    flat: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    about: Callable[[Floats], Floats] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curvature:
    """What was found ``around`` a minimum: the ``ends`` of its coordinates, and of quantities that are ``derived``.

    On the curved surface of constraints coordinates bend as well, as quantities do: ``bent`` has those (None: none do).
    ``beyond`` are minima behind kinks, which ``ends`` take in (None: there are none).
    """

    around: Surroundings
    ends: IntervalEnds
    derived: tuple[DerivedEnds, ...]
    bent: DerivedEnds | None = None
    beyond: Beyond | None = None


@np.errstate(all="ignore")
def curvature(
    propagation: Propagation,
    minimum: Minimum,
    derived: tuple[DerivedSolution, ...],
    others: Callable[[], Sequence[Alternative]],
) -> Curvature | None:
    """How curvature moves the ends of intervals; None where it does not, or is not looked at (`surroundings`).

    ``others`` gives the other minima, which silhouettes may have behind a kink.
    """
    equations, estimated = propagation.equations, propagation.outcome.covariance
    if not minimum.reason.converged or minimum.blocks is not None:
        return None
    surface: Surface | None = on_surface(equations, minimum)
    if equations.linear and surface is None and not derived:
        return None
    along = equations if surface is None else surface
    if equations.lossy:  # loaded by problems with losses only, so that the others start at once
        from mbm.estimation.trust.leverage import fixed_weights

        fixed = fixed_weights(equations, minimum, estimated) if surface is None else None
        if fixed is None:
            return None
        along, minimum, estimated = fixed
    around = surroundings(along, minimum, estimated)
    if around is None:
        return None
    found = tuple(_derived(propagation, around, derived))
    if surface is None:
        ends, behind = interval_ends(around, estimated), None
        if any(group.kernel.calls for group in equations.groups):
            # Loaded by silhouettes and functions in Python only, so that the others start at once.
            from mbm.estimation.trust.beyond import beyond

            behind = beyond(equations, minimum, others(), around.variance)
        if behind is not None:
            lower, upper = (each / (NORMAL_95 * estimated.sigma) for each in behind.ends(NORMAL_95))
            ends = IntervalEnds(lower=np.maximum(ends.lower, lower), upper=np.maximum(ends.upper, upper))
        return Curvature(around=around, ends=ends, derived=found, beyond=behind)
    bent = _coordinates(equations, around, estimated)
    every = np.ones((2, len(estimated.sigma)))
    if bent is not None:
        every[:, bent.known] = bent.ends.lower, bent.ends.upper
    return Curvature(around=around, ends=IntervalEnds(lower=every[0], upper=every[1]), derived=found, bent=bent)


def _coordinates(equations: Assembled, around: Surroundings, estimated: Covariance) -> DerivedEnds | None:
    """Those of the free coordinates that are plain numbers; None: there are none."""
    numbers = equations.layout.number[equations.free]
    spread = np.sqrt(np.square(around.factor).sum(axis=1))
    told = np.isfinite(estimated.sigma) & (spread > DETERMINED * spread.max(initial=0.0))
    known = np.flatnonzero(told & (numbers >= 0))
    if not known.size:
        return None
    gradient = np.eye(len(numbers))[known]

    def values(points: Floats) -> Floats:
        return points[:, numbers[known]]

    ends = derived_ends(around, gradient, values, angle=False)
    found = DerivedEnds(owner=-1, known=known, ends=ends, gradient=gradient, values=values, angle=False)
    return _followed(around, found, most_followed(around))[0]


def _followed(around: Surroundings, found: DerivedEnds, most: int) -> tuple[DerivedEnds, int]:
    """The ends that the quick look finds misplaced, followed to the true ones: the first ``most``; how many these are.

    Those where a number turns back on the way stay.
    """
    both = np.stack([found.ends.lower, found.ends.upper])
    misplaced = (np.abs(both - 1.0) > LOOKED_AT).any(axis=0) & ~np.isneginf(both).any(axis=0)
    places = np.flatnonzero(misplaced)[:most].tolist()
    for place in places:
        far = NORMAL_95 * float(np.linalg.norm(found.gradient[place] @ around.factor))
        both[:, place] = np.array(followed_ends(around, found, place, NORMAL_95, END_ACCURACY)) / far
    return replace(found, ends=IntervalEnds(lower=both[0], upper=both[1])), len(places)


def _derived(
    propagation: Propagation, around: Surroundings, derived: tuple[DerivedSolution, ...]
) -> Iterator[DerivedEnds]:
    """Those of quantities that are numbers, in all rows if they are derived over a table."""
    left, followed = MOST_DERIVED, most_followed(around)
    equations, point = propagation.equations, around.minimum.point
    turned = equations.layout.reported(point) - point  # quantities are derived from reported angles
    free = equations.is_free
    for one in derived:
        stated = propagation.problem.derived[one.owner]
        count = one.sigma.size
        if stated.kind is not None or one.gradient is None or not 0 < count <= left:
            continue
        groups = propagation.binder.derived(propagation.kernels, one.owner)
        if around.equations.linear and all(affine(group, free) for group in groups):
            continue
        left -= count
        sigma = one.sigma.ravel()
        parts = np.abs(one.gradient) @ np.nan_to_num(propagation.outcome.covariance.sigma)
        every = _values_of(groups, one.values.shape, turned)
        told = np.flatnonzero(np.isfinite(one.values.ravel()) & np.isfinite(sigma))
        varied = _varied(around, _picked(every, told))
        still = sigma[told] <= np.maximum(DETERMINED * parts[told], FLATTER * varied)
        known = told[~still]
        flat = told[still & (varied > UNMOVED * np.maximum(np.abs(one.values.ravel()), parts)[told])]
        if not known.size and not flat.size:
            continue
        values, gradient = _picked(every, known), one.gradient[known]
        ends = IntervalEnds(lower=np.ones(0), upper=np.ones(0))
        if known.size:
            ends = derived_ends(around, gradient, values, stated.angle)
            ends = _reached(around, gradient, values, ends, angle=stated.angle)
        found = DerivedEnds(
            owner=one.owner,
            known=known,
            ends=ends,
            gradient=gradient,
            values=values,
            angle=stated.angle,
            flat=flat,
            about=_picked(every, flat),
        )
        found, done = _followed(around, found, followed)
        followed -= done
        yield found


def _varied(around: Surroundings, values: Callable[[Floats], Floats]) -> Floats:
    """How far numbers (k,) vary within the 95 % intervals of the estimates."""
    begin = values(around.minimum.point[None])[0]
    moved = np.abs(values(around.points(directions(around.factor.shape[1]))) - begin)
    return np.asarray(np.nan_to_num(moved).max(axis=0, initial=0.0))


def directions(size: int) -> Floats:
    """Unit vectors (p, k): the k axes, and between two of them, a pair for each, where these are not too many."""
    one = np.eye(size)
    pairs = [(i, j) for i in range(size) for j in range(i)] if size <= MOST_BETWEEN else []
    between = [(one[i] + sign * one[j]) / np.sqrt(2.0) for i, j in pairs for sign in (1.0, -1.0)]
    return np.vstack([one, *between])


@np.errstate(all="ignore")
def flat_reach(around: Surroundings, values: Callable[[Floats], Floats], reach: Floats) -> tuple[Floats, Floats]:
    """How far numbers (k,) go below and above their values within so many deviations (k,) of the estimates.

    What is flat at the estimates is there at an end of its interval, and the other one lies where the estimates are
    ``reach`` deviations away: along axes, between two of them, and where the second differences are largest.
    """
    size = around.factor.shape[1]
    along = directions(size)
    begin = values(around.minimum.point[None])[0]
    below, above = np.zeros(len(reach)), np.zeros(len(reach))
    for place, far in enumerate(reach.tolist()):
        bends = _moved(around, values, along * far, place).sum(axis=0) - 2.0 * begin[place]
        hessian = np.diag(bends[:size])
        if len(along) > size:
            rows, columns = np.tril_indices(size, -1)
            mixed = bends[size:].reshape(-1, 2)
            hessian[rows, columns] = hessian[columns, rows] = 0.5 * (mixed[:, 0] - mixed[:, 1])
        tried = np.vstack([along, np.linalg.eigh(np.nan_to_num(hessian))[1].T])
        moved = _moved(around, values, tried * far, place) - begin[place]
        below[place], above[place] = max(-float(np.nanmin(moved)), 0.0), max(float(np.nanmax(moved)), 0.0)
    return below, above


def _moved(around: Surroundings, values: Callable[[Floats], Floats], steps: Floats, place: int) -> Floats:
    """A number after each of some steps (p, k) in deviations, back and forth: (2, p)."""
    return values(around.points(steps / NORMAL_95))[:, place].reshape(2, -1)


def _reached(
    around: Surroundings,
    gradient: Floats,
    values: Callable[[Floats], Floats],
    ends: IntervalEnds,
    *,
    angle: bool,
) -> IntervalEnds:
    """The ``ends`` where they are not beyond what quantities reach in other directions than their slopes, by curvature
    or kinks. What turns back on the way stays.
    """
    far = NORMAL_95 * np.sqrt(np.square(gradient @ around.factor).sum(axis=1))
    points = around.points(directions(around.factor.shape[1]))
    moved = values(points) - values(around.minimum.point[None])
    if angle:
        moved = moved - 2 * np.pi * np.round(moved / (2 * np.pi))
    beyond = ((moved < -(1.0 + FARTHER) * far * ends.lower) | (moved > (1.0 + FARTHER) * far * ends.upper)).any(axis=1)
    if not beyond.any():
        return ends
    # where the cost has grown by more than at an end, they reach that much less
    squares = np.square(residuals_at(around.equations, points[beyond])).sum(axis=1)
    grown = (squares - around.minimum.cost) / (NORMAL_95**2 * around.variance)
    share = np.where(grown < np.inf, 1.0 / np.sqrt(np.maximum(grown, 1.0)), 0.0)
    moved = np.where(share[:, None] > 0.0, moved[beyond] * share[:, None], 0.0)
    reached = -np.nanmin(moved, axis=0, initial=0.0) / far, np.nanmax(moved, axis=0, initial=0.0) / far
    lower, upper = (
        np.where(np.isneginf(each), each, np.fmax(each, more))
        for each, more in zip((ends.lower, ends.upper), reached, strict=True)
    )
    return IntervalEnds(lower=lower, upper=upper)


def _values_of(groups: Sequence[Group], shape: tuple[int, ...], turned: Floats) -> Callable[[Floats], Floats]:
    """From points (P, N) to all numbers of a quantity (P, rows · size), whose rows may follow several formulas."""

    def values(points: Floats) -> Floats:
        whole = np.full((len(points), *shape), np.nan)
        for group in groups:
            rows = group.positions if group.positions is not None else np.arange(1)
            whole[:, rows] = group.values_at(points + turned).reshape(len(points), len(rows), -1)
        return whole.reshape(len(points), -1)

    return values


def _picked(values: Callable[[Floats], Floats], which: Indices) -> Callable[[Floats], Floats]:
    return lambda points: values(points)[:, which]


def most_followed(around: Surroundings) -> int:
    """How many profiles of doubtful numbers are followed to their true ends; of more, the quick look has to do."""
    if not isinstance(around.equations, OnSurface):
        return MOST_FOLLOWED
    return min(MOST_FOLLOWED, MOST_BROUGHT_BACK // int(around.factor.shape[1]) ** 2)


def followed_ends(
    around: Surroundings, one: DerivedEnds, which: int, reach: float, accuracy: float
) -> tuple[float, float]:
    """How far the interval of a derived number, ``reach`` deviations, goes below and above; infinite without an end."""
    minimum, image = around.minimum, one.gradient[which] @ around.factor
    sigma = float(np.linalg.norm(image))
    begin = float(one.values(minimum.point[None])[0, which])

    def change(points: Floats) -> Floats:
        moved = one.values(points)[:, which] - begin
        return moved - 2 * np.pi * np.round(moved / (2 * np.pi)) if one.angle else moved

    def end(direction: Floats, target: float) -> float:
        return DerivedProfile(
            equations=around.equations,
            point=minimum.point,
            least=minimum.cost,
            direction=direction,
            others=around.factor,
            level=reach**2 * around.variance,
            change=change,
            target=target,
        ).end(accuracy)

    lower, upper = (end(sign * reach * (around.factor @ image) / sigma, sign * reach * sigma) for sign in (-1.0, 1.0))
    lines = reach * (np.vstack([image / sigma, directions(around.factor.shape[1])]) @ around.factor.T)

    def moves(line: Floats, sign: float, places: Floats) -> Floats:
        return sign * change(points_after(around.equations, minimum.point, places[:, None] * line)) / (reach * sigma)

    table = np.stack([moves(line, 1.0, ALONG_LINES) for line in lines])
    steps, moved = np.vstack([-lines, lines]), np.nan_to_num(table[:, [0, -1]].T.ravel(), posinf=0.0, neginf=0.0)
    # Beyond a kink another piece of the quantity may reach farther than that which holds at the minimum.
    least, most = int(moved.argmin()), int(moved.argmax())
    if -moved[least] > (1.0 + FARTHER) * lower:
        lower = max(lower, end(steps[least] / -moved[least], -reach * sigma))
    if moved[most] > (1.0 + FARTHER) * upper:
        upper = max(upper, end(steps[most] / moved[most], reach * sigma))

    def along_lines(sign: float, reached: float) -> float:
        """No profile leads over a jump or a pole, but what is as likely as an end is not outside."""
        far = np.nanmax(sign * table, axis=1, initial=0.0)
        for which in np.argsort(-far)[:MOST_LINES].tolist():
            line = lines[which]
            most, where = farthest(partial(moves, line, sign), ALONG_LINES, sign * table[which])
            if most > reached:
                there = points_after(around.equations, minimum.point, where * line[None])
                grown = np.square(residuals_at(around.equations, there)).sum() - minimum.cost
                if grown <= reach**2 * around.variance * (1.0 + SAME_EQUATIONS):
                    reached = most
        return reached

    lower, upper = along_lines(-1.0, lower), along_lines(1.0, upper)
    return lower * reach * sigma, upper * reach * sigma
