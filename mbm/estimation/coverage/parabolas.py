"""Profiles of the cost within limits where all is linear: pieces of parabolas, in closed form.

Whichever limits are reached, the least cost over all else is a parabola of the quantity, from where the other limits
are met to where they are not. The profile is the lowest of those that are there.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import column_norms
from mbm.equations.surface import exact_constraints
from mbm.equations.types import Floats, Minimum
from mbm.estimation.coverage.limits import box
from mbm.estimation.coverage.shares import MOST_LOOKED_AT, NOTHING_LEFT, Side
from mbm.estimation.uncertainty.student import Law
from mbm.solver.decisions import decided_rank
from mbm.values import dataclass

MOST_LIMITS = 6
"""Limits within reach up to which all combinations of them are looked at."""

ALONG = 1e-9
"""Length of what is left of a direction beside others, as a share of its own, that is rounding."""

JOINED = 1e-12
"""Share of a distance by which pieces overlap, so that rounding leaves no gap between them."""

PLACES = 400
"""Places on one side: sums over them are right to 1e-5."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parabolas:
    """The cost about a minimum in coordinates w in which it is w², where the minimum is ``here`` (k,).

    ``back`` (n, k) leads from steps there to steps of the coordinates, whose limits are ``rows`` (c, n) · step ≤
    ``room`` (c,).
    """

    here: Floats
    back: Floats
    rows: Floats
    room: Floats
    variance: float

    @property
    def free_steps(self) -> Floats:
        """The steps (n,) to where the coordinates would be without limits."""
        return np.asarray(-(self.back @ self.here))

    def spread(self, gradient: Floats) -> float:
        """The standard deviation that a quantity with a gradient (n,) would have without limits."""
        return float(np.sqrt(self.variance * np.square(gradient @ self.back).sum()))

    def beside(self, moves: Floats) -> Parabolas:
        """The same with m coordinates w more: uncertain constants whose standard deviations are ``moves`` (m, n)."""
        back = np.hstack([self.back, moves.T / np.sqrt(self.variance)])
        return replace(self, here=np.append(self.here, np.zeros(len(moves))), back=back)

    def along(self, gradient: Floats, direct: Floats, value: float, law: Law) -> Pieces | None:
        """The profile of the quantity with a gradient (n,), as far as the law has to look; None: too many limits.

        The last coordinates w change it ``direct``ly (m,), too.
        """
        slope = gradient @ self.back
        slope[len(slope) - len(direct) :] += direct / np.sqrt(self.variance)
        every = self.rows @ self.back
        least = float(self.here @ self.here)
        reach = np.sqrt(least + self.variance * law.growth(MOST_LOOKED_AT))
        length = np.sqrt(np.square(every).sum(axis=1))
        near = length * reach > self.room + every @ self.here
        if int(near.sum()) > MOST_LIMITS or not float(slope @ slope) > 0.0:
            return None
        lines, room = every[near] / length[near, None], self.room[near] / length[near]
        found = [
            piece
            for count in range(len(room) + 1)
            for which in combinations(range(len(room)), count)
            if (piece := _piece(self.here, slope, lines, room, list(which))) is not None
        ]
        pieces = np.array(found)
        costs, slopes, bends, first, last = pieces.T
        steps = np.clip(-slopes / (2.0 * bends), first, last)
        costs = costs + steps * (slopes + steps * bends)
        # beside limits, constants need not be most probable where they are stated
        best, centre = int(costs.argmin()), 0.0
        if costs[best] < (1.0 - ALONG) * least:
            least, centre = float(costs[best]), float(steps[best])
        return Pieces(value=value, pieces=pieces, centre=centre, least=least, variance=self.variance)


def _piece(
    here: Floats, slope: Floats, lines: Floats, room: Floats, which: list[int]
) -> tuple[float, float, float, float, float] | None:
    """Value, slope and half the curvature at 0 of the least cost with the quantity, and from where to where the limits
    ``which`` are reached and the others met; None: nowhere.
    """
    rows = np.vstack([lines[which], slope / np.sqrt(slope @ slope)])
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(rows) > rows.shape[1] or singular[-1] <= ALONG:
        return None
    inverse = np.linalg.pinv(rows)
    start = inverse @ (rows @ here + np.append(room[which], 0.0))
    way = inverse[:, -1] / np.sqrt(slope @ slope)
    gap, rate = room - lines @ (start - here), lines @ way
    gap[which], rate[which] = 0.0, 0.0
    still = np.abs(rate) <= ALONG * np.sqrt(way @ way)
    size = ALONG * max(1.0, float(np.sqrt(here @ here)))
    if bool((still & (gap < -size)).any()):
        return None
    ends = gap[~still] / rate[~still]
    ends = np.where(np.abs(ends) <= size / np.sqrt(way @ way), 0.0, ends)
    low = float(ends[rate[~still] < 0.0].max(initial=-np.inf))
    high = float(ends[rate[~still] > 0.0].min(initial=np.inf))
    if low > high:
        return None
    return float(start @ start), 2.0 * float(start @ way), float(way @ way), low, high


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pieces:
    """A profile about a ``value``: lowest of ``pieces`` (p, 5), as `_piece` gives them, above the ``least``, which is a
    step to the ``centre`` away.
    """

    value: float
    pieces: Floats
    centre: float
    least: float
    variance: float

    def growth(self, step: float) -> float:
        """By how many variances the cost grows with a step; infinite where limits are not met."""
        return float(self.growths(np.array([step]))[0])

    def growths(self, steps: Floats) -> Floats:
        """The same of many steps (s,)."""
        value, slope, bend, low, high = self.pieces.T[:, :, None]
        joined = (low - JOINED * np.abs(low) <= steps) & (steps <= high + JOINED * np.abs(high))
        costs = np.where(joined, value + steps * (slope + steps * bend), np.inf)
        return np.asarray(np.maximum(costs.min(axis=0) - self.least, 0.0) / self.variance)

    def sides(self, law: Law) -> tuple[Side, Side]:
        """What lies below and above."""
        return self._side(law, -1.0), self._side(law, 1.0)

    @np.errstate(invalid="ignore")
    def _side(self, law: Law, sign: float) -> Side:
        far = law.growth(NOTHING_LEFT) * self.variance
        value, slope, bend, low, high = self.pieces.T
        low, high = (low, high) if sign > 0.0 else (-high, -low)
        root = np.sqrt(np.square(slope) - 4.0 * bend * (value - self.least - far))
        ends = np.minimum((root - sign * slope) / (2.0 * bend), high)
        begin = sign * self.centre
        end = float(np.where(ends >= low, ends, begin).max(initial=begin, where=np.isfinite(ends))) - begin
        if not end > 0.0:
            return Side(places=np.zeros(1), surprise=np.zeros(1), endless=False)
        scale = np.sqrt(self.variance / float(bend.min()))
        places = scale * np.sinh(np.linspace(0.0, np.arcsinh(end / scale), PLACES))
        places[-1] = end
        inside = np.append(places[:-1], end * (1.0 - ALONG))
        surprise = np.maximum.accumulate(law.surprises(self.growths(self.centre + sign * inside)))
        return Side(places=places, surprise=surprise, endless=False)


def parabolas(equations: Assembled, minimum: Minimum, variance: float) -> Parabolas | None:
    """The cost about a minimum; None where some equation or limit bends, or something is free."""
    straight = equations.linear and bool(exact_constraints(equations).all())
    if not straight or minimum.blocks is not None or equations.likely or equations.lossy:
        return None
    count, place = equations.dimension, equations.coordinates(minimum.point)
    lower, upper = box(equations)
    rows, room, tied = [np.eye(count), -np.eye(count)], [upper - place, place - lower], np.zeros((0, count))
    if minimum.constraints is not None:
        state = minimum.constraints
        tied = np.asarray(state.slopes)[state.equality]
        rows.append(np.asarray(state.slopes)[~state.equality])
        room.append(-np.where(state.forcing | state.active, 0.0, state.values)[~state.equality])
    basis = np.eye(count)
    if len(tied):
        _, singular, right = np.linalg.svd(tied / np.sqrt(np.square(tied).sum(axis=1, keepdims=True)))
        basis = right[int((singular > ALONG).sum()) :].T
    jacobian = minimum.jacobian @ basis
    norms = column_norms(jacobian)
    if not len(norms) or not bool((norms > 0.0).all()):
        return None
    orthogonal, triangle = np.linalg.qr(jacobian / norms)
    if decided_rank(len(norms), np.linalg.svd(triangle, compute_uv=False), 0) < len(norms):
        return None
    back = basis @ np.linalg.solve(triangle * norms, np.eye(len(norms)))
    far = np.concatenate(room)
    limited = np.isfinite(far)
    return Parabolas(
        here=orthogonal.T @ minimum.residuals,
        back=back,
        rows=np.vstack(rows)[limited],
        room=np.maximum(far[limited], 0.0),
        variance=variance,
    )
