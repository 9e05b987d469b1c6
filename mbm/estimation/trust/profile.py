"""Ends of an interval found by following the profile of the cost: the least cost over all coordinates but one.

Used where the quick look of `nonlinearity` says that the linear interval misleads, to say by how much.
"""

from __future__ import annotations

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
