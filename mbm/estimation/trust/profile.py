"""Ends of intervals found by following the profile of the cost: of coordinates, and of derived quantities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from mbm.equations.types import Floats
from mbm.solver.decisions import FARTHEST
from mbm.values import dataclass


class Surface(Protocol):
    """What a profile is followed on: equations, or these along the surface of constraints, or with fixed weights."""

    @property
    def count(self) -> int:
        """m, the residuals."""
        ...

    @property
    def linear(self) -> bool:
        """The residuals are affine in steps."""
        ...

    def residuals(self, x: Floats) -> Floats:
        """Residuals (m,) at a point."""
        ...

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives (m, n) by a step."""
        ...

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The point after a step."""
        ...


END_ACCURACY = 0.01
"""Relative accuracy of an end."""

ENDS_TRIED = 12
INNER = 10
HALVINGS = 4
APPROACHED = 0.5
"""Share of the distance before, up to which a step across the end has come nearer. Else steps in proportion to the
growth go to and fro, and the line between what lies inside and outside tells more."""

APART = 1e-8
"""Share of the square of a slope, beside those before it, from which the normal equations have half of all digits."""

SETTLED = 1e-3
"""Gain of cost, in variances, below which the other coordinates are where they should be."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """The profile of one coordinate about a minimum with cost ``least``.

    ``direction`` (n,) is the step to the linear end, to which the profile is tangent; ``others`` (n, k) spans the steps
    that leave the coordinate alone; ``level`` is the growth of the cost at an end.
    """

    equations: Surface
    point: Floats
    least: float
    direction: Floats
    others: Floats
    level: float

    @np.errstate(all="ignore")
    def end(self, accuracy: float = END_ACCURACY) -> float:
        """Where the cost has grown by ``level``, as a multiple of ``direction``; infinite beyond FARTHEST.

        0 where the equations have no value however near. ``accuracy`` is relative.
        """
        inside, outside = 0.0, np.inf
        grown_inside, grown_outside, last = 0.0, np.inf, np.inf
        beside = np.zeros(len(self.direction))
        multiple = 1.0
        for _ in range(ENDS_TRIED):
            grown, moved = self._grown(multiple, beside)
            if grown <= 1.0:
                inside, grown_inside, beside = multiple, grown, moved
            else:
                outside, grown_outside = multiple, grown
            if abs(grown - 1.0) < accuracy or outside - inside < accuracy * inside:
                return multiple if np.isfinite(grown) else inside
            if inside >= FARTHEST:
                return float("inf")
            crossed = (grown <= 1.0) != (last <= 1.0)
            if crossed and abs(grown - 1.0) > APPROACHED * abs(last - 1.0) and np.isfinite(grown_outside):
                multiple = inside + (outside - inside) * (1.0 - grown_inside) / (grown_outside - grown_inside)
            else:
                multiple = self._next(inside, outside, multiple, grown)
            last = grown
            beside = beside * (multiple / inside) ** 2 if inside > 0.0 else np.zeros(len(self.direction))
            beside = beside if np.isfinite(beside).all() else np.zeros(len(self.direction))
        return inside if grown_inside > 0.0 else 0.0

    def _next(self, inside: float, outside: float, multiple: float, grown: float) -> float:
        """Proportional to the root of the growth, kept between what is known to be inside and outside."""
        guess = multiple / grown if np.isfinite(grown) and grown > 0.0 else (inside + min(outside, 2 * multiple)) / 2
        if not inside < guess < outside:
            guess = (inside + outside) / 2 if np.isfinite(outside) else 2 * inside
        return float(min(max(guess, multiple / 4), 2 * multiple, FARTHEST))

    def _grown(self, multiple: float, beside: Floats) -> tuple[float, Floats]:
        """The root of the growth of the cost over that of ``level``, and the step of the others that made it least."""
        ahead = multiple * self.direction
        cost, point, residuals = self._at(ahead + beside)
        for _ in range(INNER):
            if not np.isfinite(cost) or not self.others.size:
                break
            slopes = self.equations.jacobian(point) @ self.others
            if not bool(np.isfinite(slopes).all()):
                break
            step = self.others @ _least(slopes, -residuals)
            for halving in range(HALVINGS):
                trial = beside + step / 2**halving
                trial_cost, trial_point, there = self._at(ahead + trial)
                if trial_cost < cost:
                    break
            else:
                break
            gain, cost, point, residuals, beside = cost - trial_cost, trial_cost, trial_point, there, trial
            if gain < SETTLED * self.level:
                break
        growth = (cost - self.least) / self.level
        return (float(np.sqrt(max(growth, 0.0))) if np.isfinite(growth) else float("inf")), beside

    def _at(self, step: Floats) -> tuple[float, Floats, Floats]:
        """The cost after a step, the point there and its residuals."""
        point = self.equations.retract(self.point, step)
        residuals = self.equations.residuals(point)
        cost = float(residuals @ residuals)
        return (cost if np.isfinite(cost) else float("inf")), point, residuals


def _least(slopes: Floats, values: Floats) -> Floats:
    """The least squares (k,) of ``slopes`` (m, k), which are orthogonal at the minimum and nearly so around it.

    There the normal equations are as good as the singular values, and take a fifth of the time with 300 slopes.
    """
    gram = slopes.T @ slopes
    try:
        apart = bool((np.square(np.linalg.cholesky(gram).diagonal()) > APART * gram.diagonal()).all())
    except np.linalg.LinAlgError:
        apart = False
    if apart:
        return np.asarray(np.linalg.solve(gram, slopes.T @ values))
    return np.asarray(np.linalg.lstsq(slopes, values, rcond=1e-12)[0])


STEPS = 25
SHORTER = 8
"""Times that a step is halved that makes neither the cost nor the distance from the target smaller."""

FLAT = 1e-14
"""Relative curvature below which a direction along the surface tells nothing."""

DIFFERENCE = 1e-3
"""Step in standard deviations of the differences that give slopes and curvature of the quantity."""

REACHED = 1e-6
"""Distance from its target, as a share of it, at which a quantity has reached it."""

STUCK = 1e-5
"""Gain, in variances, below which a quantity that has not reached its target does not come nearer."""

FIRMLY = 10.0
"""Weight of the distance from the target, as a share of it, beside the growth of the cost at an end. Where the profile
is a parabola a share of one costs twice that growth, so that the distance always counts for more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedProfile(Profile):
    """The profile of a quantity with the ``change`` (P,) at P points from its value at the minimum.

    ``target`` is its change at a linear end. ``others`` (n, k) spans all steps here. Each step is that of sequential
    quadratic programming, with the curvature of the quantity, but not that of the residuals, in its Hessian.
    """

    change: Callable[[Floats], Floats]
    target: float

    def _grown(self, multiple: float, beside: Floats) -> tuple[float, Floats]:
        """As for a coordinate; infinite where the quantity cannot be brought to so many times its target."""
        wanted = multiple * self.target
        ahead = multiple * self.direction + beside
        places = (self._judged(ahead / 2**halving, wanted) for halving in range(SHORTER))
        here = next((place for place in places if np.isfinite(place.merit)), self._judged(0.0 * ahead, wanted))
        for _ in range(STEPS):
            there = self._nearer(here, wanted)
            if there is None:
                break
            gain, here = here.merit - there.merit, there
            reached = abs(here.gap) <= REACHED * abs(wanted)
            if gain < (SETTLED if reached else STUCK) * self.level:
                break
        growth = (here.cost - self.least) / self.level
        found = abs(here.gap) <= SETTLED * abs(wanted) and np.isfinite(growth)
        return (float(np.sqrt(max(growth, 0.0))) if found else float("inf")), here.step - multiple * self.direction

    def _judged(self, step: Floats, wanted: float) -> _Place:
        """Where a step leads to."""
        cost, point, residuals = self._at(step)
        gap = wanted - float(self.change(point[None])[0])
        merit = cost + FIRMLY * self.level * abs(gap / self.target)
        merit = merit if np.isfinite(merit) else float("inf")
        return _Place(step=step, merit=merit, cost=cost, point=point, residuals=residuals, gap=gap)

    def _nearer(self, here: _Place, wanted: float) -> _Place | None:
        """The place after a step that makes the merit smaller; None where there is none.

        Where the step overshoots a kink, to the other side of a larger of two or of a size, the quantity as it is on
        one side leads back to the other. There both sides have to reach the target.
        """
        if not np.isfinite(here.merit):
            return None
        slopes = self.equations.jacobian(here.point) @ self.others
        gradient, curvature = self._derivatives(here.point)
        finite = bool(np.isfinite(slopes).all() and np.isfinite(curvature).all() and np.isfinite(gradient).all())
        if not finite or not gradient.any():
            return None
        move = _constrained(here.residuals, slopes, gradient[None], curvature, np.array([here.gap]))
        there = self._shortened(here, move, wanted)
        if there is not None or abs(here.gap) <= REACHED * abs(wanted):
            return there
        beyond = self._judged(here.step + self.others @ move, wanted)
        other, _ = self._derivatives(beyond.point)
        if not np.isfinite([beyond.gap, *other]).all():
            return None
        gaps = np.array([here.gap, beyond.gap + float(other @ move)])
        both = _constrained(here.residuals, slopes, np.stack([gradient, other]), 0.0 * curvature, gaps)
        return self._shortened(here, both, wanted)

    def _shortened(self, here: _Place, move: Floats, wanted: float) -> _Place | None:
        """The place after a move, halved until it makes the merit smaller; None where it never does."""
        for halving in range(SHORTER):
            there = self._judged(here.step + self.others @ move / 2**halving, wanted)
            if there.merit < here.merit:
                return there
        return None

    def _derivatives(self, point: Floats) -> tuple[Floats, Floats]:
        """First (k,) and second (k, k) derivatives of the quantity along the columns of ``others``, by differences."""
        steps = DIFFERENCE * self.others.T
        k = len(steps)
        pairs = [(i, j) for i in range(k) for j in range(i)]
        tried = np.array([*steps, *-steps, *(sign * (steps[i] + steps[j]) for i, j in pairs for sign in (1.0, -1.0))])
        there = self.equations.retract(np.tile(point, (len(tried), 1)), tried)
        values = self.change(np.vstack([point, there]))
        here, ahead, behind = values[0], values[1 : k + 1], values[k + 1 : 2 * k + 1]
        bends = (ahead + behind - 2 * here) / DIFFERENCE**2
        curvature = np.diag(bends)
        for number, (i, j) in enumerate(pairs):
            both = values[2 * k + 1 + 2 * number : 2 * k + 3 + 2 * number].sum() - 2 * here
            curvature[i, j] = curvature[j, i] = (both / DIFFERENCE**2 - bends[i] - bends[j]) / 2
        return (ahead - behind) / (2 * DIFFERENCE), curvature


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Place:
    """The ``point`` after a ``step`` (n,): ``merit`` is to be made small, ``gap`` is what the quantity lacks there."""

    step: Floats
    merit: float
    cost: float
    point: Floats
    residuals: Floats
    gap: float


def _constrained(residuals: Floats, slopes: Floats, gradients: Floats, curvature: Floats, gaps: Floats) -> Floats:
    """The c (k,) that makes ‖residuals + slopes c‖² − 2λ·curvature(c)/2 least where gradients (r, k) c = gaps (r,).

    λ is the multiplier at hand of the first. Without the curvature where it would make the Hessian indefinite.
    """
    first = np.asarray(np.linalg.lstsq(gradients, gaps, rcond=None)[0], dtype=np.float64)
    count = len(gradients)
    basis = np.linalg.qr(gradients.T, mode="complete")[0][:, count:]
    if not basis.shape[1]:
        return first
    multiplier = float(np.linalg.lstsq(gradients.T, slopes.T @ residuals, rcond=None)[0][0])
    hessian = slopes.T @ slopes
    for bent in (hessian - multiplier * curvature, hessian):
        reduced = basis.T @ bent @ basis
        values = np.linalg.eigvalsh(reduced)
        if float(values[0]) > FLAT * float(values[-1]):
            pull = basis.T @ (slopes.T @ residuals + bent @ first)
            return np.asarray(first - basis @ np.linalg.solve(reduced, pull))
    return first
