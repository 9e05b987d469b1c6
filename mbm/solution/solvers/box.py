"""Steps that stay inside hard bounds: a small active set around the unbounded step rules.

A coordinate at a bound whose gradient points outward is held. Of the others, the one whose bound the step meets first
is put on it and the step recomputed for the rest, until nothing leaves the box: for linear residuals the sequence of
such steps ends in the exact minimum (Kuhn-Tucker point), as in bounded-variable least squares (Stark and Parker 1995).
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.solution.solvers.scaled import Scaled, decompose
from mbm.solution.types import Equations, Floats, Mask
from mbm.target.decisions import POSITIVE_KEPT, ROUNDING_OF_BOUNDS
from mbm.values import dataclass

StepRule: TypeAlias = Callable[[Scaled, float], Floats]
"""From the decomposition and the trust radius to a step in scaled coordinates."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """A step (n,), the decrease of ``Σ r²`` it promises, its scaled length, the coordinates that a bound stopped."""

    vector: Floats
    predicted: float
    length: float
    stopped: Mask | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """Bounds of the coordinates; ``present`` is False where there are none at all and nothing need be looked at."""

    lower: Floats
    upper: Floats
    positive: Mask
    present: bool

    def project(self, x: Floats) -> Floats:
        """The nearest point of the box; a `positive` coordinate that is not becomes 1 (or half its upper bound)."""
        if not self.present:
            return x
        inside = np.clip(x, self.lower, self.upper)
        bad = self.positive & (inside <= 0.0)
        return np.where(bad, np.where(np.isfinite(self.upper), 0.5 * self.upper, 1.0), inside)

    def landed(self, x: Floats, step: Step) -> Floats:
        """Where a step led, inside the box; a coordinate that it put on a bound stands on it to the last bit.

        ``x + (bound - x)`` may fall short of the bound by a rounding: it would count as free, and be given a sigma.
        """
        inside = self.project(x)
        if step.stopped is None or not step.stopped.any():
            return inside
        bound = np.where(step.vector < 0.0, self.lower, self.upper)
        there = np.abs(inside - bound) <= ROUNDING_OF_BOUNDS * (np.abs(bound) + np.abs(step.vector))
        near = step.stopped & np.isfinite(bound) & there
        return np.where(near, bound, inside)

    def free(self, x: Floats, gradient: Floats) -> Mask:
        """Coordinates that are not at a bound which the descent direction would leave, shape (n,)."""
        held = ((x <= self.lower) & (gradient >= 0.0)) | ((x >= self.upper) & (gradient <= 0.0))
        return ~held

    def gaps(self, x: Floats) -> tuple[Floats, Floats]:
        """Largest movement down (≤ 0) and up (≥ 0) of each coordinate in one step."""
        down = np.where(self.positive, np.maximum(self.lower - x, (POSITIVE_KEPT - 1.0) * x), self.lower - x)
        return down, self.upper - x

    def allows(self, x: Floats, vector: Floats) -> bool:
        """The step stays inside."""
        down, up = self.gaps(x)
        return bool((vector >= down).all() and (vector <= up).all())

    def sides(self, x: Floats, free: Mask | None, full: Step) -> NDArray[np.int8]:
        """-1 and +1 for coordinates held at their lower and upper bound, else 0, shape (n,).

        A `positive` coordinate whose undamped step still goes all the way to zero is at its lower bound.
        """
        where = np.zeros(x.size, dtype=np.int8)
        if free is None:
            return where
        where[~free & (x >= self.upper)] = 1
        where[~free & (x <= self.lower)] = -1
        if full.stopped is not None:
            where[full.stopped & self.positive & (full.vector < 0.0)] = -1
        return where


def box_of(equations: Equations) -> Box:
    """The bounds of a system of equations."""
    lower, upper, positive = equations.lower, equations.upper, equations.positive
    present = bool(np.isfinite(lower).any() or np.isfinite(upper).any() or positive.any())
    return Box(lower=lower, upper=upper, positive=positive, present=present)


def one_step_suits(equations: Equations) -> bool:
    """Whether one linear step is the answer: affine residuals, no bound and no `positive` unknown."""
    return equations.linear and equations.count > 0 and equations.dimension > 0 and not box_of(equations).present


def boxed_step(
    jacobian: Floats,
    residuals: Floats,
    scale: Floats,
    free: Mask,
    gaps: tuple[Floats, Floats],
    rule: StepRule,
    radius: float,
) -> Step:
    """The step of ``rule`` restricted to the box; coordinates not ``free`` stay where they are."""
    n = scale.shape[0]
    vector = np.zeros(n)
    stopped = np.zeros(n, dtype=bool)
    moving = free.copy()
    down, up = gaps
    rest, remaining = residuals, radius
    for _ in range(n + 1):
        where = np.flatnonzero(moving)
        if where.size == 0 or not remaining > 0.0:
            break
        part = decompose(jacobian[:, where], rest, scale[where])
        trial = rule(part, remaining) / scale[where]
        low, high = down[where], up[where]
        beyond = (trial < low) | (trial > high)
        if not beyond.any():
            vector[where] = trial
            break
        fractions = np.where(beyond, np.where(trial < 0.0, low, high) / np.where(beyond, trial, 1.0), np.inf)
        first = int(np.argmin(fractions))
        index = int(where[first])
        vector[index] = low[first] if trial[first] < 0.0 else high[first]
        stopped[index] = True
        moving[index] = False
        rest = residuals + jacobian[:, stopped] @ vector[stopped]
        taken = scale[stopped] * vector[stopped]
        remaining = sqrt(max(radius * radius - float(taken @ taken), 0.0)) if np.isfinite(radius) else radius
    image = jacobian @ vector
    scaled = scale * vector
    return Step(
        vector=vector,
        predicted=-float(image @ (image + 2.0 * residuals)),
        length=sqrt(float(scaled @ scaled)),
        stopped=stopped,
    )
