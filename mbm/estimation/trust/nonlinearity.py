"""How far the stated standard deviations can be trusted: the linear covariance against the curvature of the residuals.

The standard deviation σ of a coordinate says that its 95 % interval ends at ±1.96 σ, where the cost, minimised over
the other coordinates (its profile), has grown by 1.96². Whether it has is found out with one residual vector at each
end: from the minimum along d = Σ eᵢ/σ, to which the profile is tangent. What the others would still gain there is what
the residuals leave in the tangent space apart from the direction J d; that is exact to the fourth order in the step,
and the asymmetry, of third order, does not depend on the others at all. Only where that look finds an end misplaced is
the profile itself followed to its end. (Bates and Watts 1988, Nonlinear Regression Analysis, chapters 6 and 7: profile
t and relative curvature.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Indices, Minimum
from mbm.estimation.trust.profile import END_ACCURACY, Profile, Surface
from mbm.values import dataclass

NORMAL_95 = 1.959963984540054
"""The 97.5 % quantile of the normal distribution."""

TOLERATED = 0.25
"""Share by which an end of a 95 % interval may miss the one stated. At it, a tail of 2.5 % is in truth one of 0.7 % or
7 %, and both together hold 91 to 97 %: about what people still call the same. Of the sets of StRD those that textbooks
call badly behaved are beyond it (BoxBOD, MGH09, MGH17, Nelson, Rat43, Thurber, one frequency of ENSO), the others
within, as are ranges, corners of a desk and poses from points, whose ends are off by 1 to 10 %."""

LOOKED_AT = 0.2
"""Share from which on the quick look has the profile followed: it is itself in error by a tenth of what it finds."""

OF_LIKELIHOODS = 0.1
"""The same of likelihoods: intervals of a rate are followed from 40 counts down. 95 % intervals of 15 counts hold the
rate in 91 % if they are linear, and miss it above in 8 %."""

ORTHONORMAL = 1e-6
"""How far Jᵀ J may be from the inverse covariance for the check to make sense; ill-conditioned sets stay below 1e-8."""

DETERMINED = 1e-10
"""Share of what the standard deviations of its parts add up to below which that of a derived number is a rounding:
constraints determine the number, and it has no interval whose ends could be missed."""

SAME_EQUATIONS = 1e-6
"""Relative difference of the cost at the minimum beyond which it is that of other equations (uncertain columns)."""

MOST_FOLLOWED = 12
"""Doubtful coordinates whose profile is followed to its true ends; of more, the quick look has to do."""

MOST_COORDINATES = 300
MOST_RESIDUALS = 1_000_000
"""Beyond so many residuals at all ends together the check would cost more than the solve; it is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IntervalEnds:
    """Ends of the 95 % intervals as multiples of those stated: ``lower``, ``upper`` (n,), 1 where the model is linear.

    NaN for coordinates without a standard deviation; infinite where the cost never grows enough, 0 where the model has
    no value at the end.
    """

    lower: Floats
    upper: Floats

    @property
    def doubtful(self) -> Indices:
        """Positions (from 0) of the coordinates whose stated interval misses an end by more than TOLERATED."""
        return self.off(TOLERATED)

    def off(self, share: float) -> Indices:
        """Those whose stated interval misses an end by more than a share of it."""
        return _off((self.lower, self.upper), share)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """A minimum with its covariance: steps are ``factor @ c`` for c (k,), along which residuals change by ``tangent``.

    ``tangent`` (m, k) is orthonormal, ``variance`` the s² in the covariance ``factor @ factor.T``.
    """

    equations: Surface
    minimum: Minimum
    factor: Floats
    tangent: Floats
    variance: float

    def points(self, along: Floats) -> Floats:
        """The linear ends of intervals in the directions ``along`` (p, k), unit vectors: all lower, then all upper."""
        steps = NORMAL_95 * (along @ self.factor.T)
        return points_after(self.equations, self.minimum.point, np.vstack([-steps, steps]))

    def ratios(self, along: Floats, points: Floats) -> Floats:
        """The true ends (2, p) as multiples of the linear ones, where the cost grows on as it does up to those."""
        residuals = residuals_at(self.equations, points)
        both = np.vstack([along, along])
        return end_ratios(residuals, self.tangent, both, self.minimum.cost, self.variance).reshape(2, len(along))

    def followed(self, along: Floats, reach: float = NORMAL_95, accuracy: float = END_ACCURACY) -> tuple[float, float]:
        """The true ends in the direction ``along`` (k,), a unit vector, found by following the profile.

        They are multiples of the linear ones, which lie ``reach`` standard deviations away, where the cost grows by the
        square of that.
        """
        step = reach * (self.factor @ along)
        others = self.factor @ _complement(along)
        lower, upper = (
            Profile(
                equations=self.equations,
                point=self.minimum.point,
                least=self.minimum.cost,
                direction=sign * step,
                others=others,
                level=reach**2 * self.variance,
            ).end(accuracy)
            for sign in (-1.0, 1.0)
        )
        return lower, upper


def end_ratios(
    residuals: Floats, tangent: Floats, along: Floats, cost: float | Floats, variance: float | Floats
) -> Floats:
    """True ends (K,) of intervals as multiples of the linear ones, where the ``residuals`` (K, m) are found.

    ``tangent`` (m, k), or (K, m, k) with one of each, is orthonormal; the ends lie in the directions ``along`` (K, k),
    unit vectors. ``cost`` and ``variance`` (K,) are those of the minimum. Infinite where the cost does not grow, 0
    where there is no value.
    """
    seen = np.matmul(residuals[:, None, :], tangent)[:, 0]
    own = np.einsum("ij,ij->i", seen, along)
    squares = np.einsum("ij,ij->i", residuals, residuals)
    least = squares - np.einsum("ij,ij->i", seen, seen) + np.square(own)
    grown = (least - cost) / variance
    found = np.where(grown > 0.0, NORMAL_95 / np.sqrt(np.maximum(grown, 0.0)), np.inf)
    return np.where(np.isfinite(least), found, 0.0)


def derived_ratios(moves: Floats, deviations: Floats, grown: Floats, *, angle: bool) -> Floats:
    """The same (2, K) for quantities that move by ``moves`` (2, K) to the lower and upper linear ends.

    ``deviations`` (K,) are their standard deviations, ``grown`` (2, K) the ratios in their directions. Minus infinity
    where a quantity has turned back on the way.
    """
    if angle:
        moves = moves - 2 * np.pi * np.round(moves / (2 * np.pi))
    gone = moves / (np.array([[-1.0], [1.0]]) * NORMAL_95 * deviations)
    gone = np.where(gone < 0.0, -np.inf, gone)
    return np.where(np.isfinite(gone), gone * grown, np.where(np.isnan(gone), 0.0, gone))


def too_much(coordinates: int, residuals: int) -> bool:
    """Whether the intervals of so many coordinates are not looked at."""
    return coordinates > MOST_COORDINATES or 2 * coordinates * residuals > MOST_RESIDUALS


@np.errstate(all="ignore")
def surroundings(equations: Surface, minimum: Minimum, estimated: Covariance) -> Surroundings | None:
    """What the ends of intervals are looked for in.

    None where it would be too much to do, and where the covariance is not the inverse of the normal equations at hand
    (robust losses) or the cost not theirs (sparse problems, a subset of the rows): then they say nothing about it.
    """
    m, k = minimum.residuals.shape[0], estimated.factor.shape[1] if estimated.factor.ndim == 2 else 0
    if not k or equations.count != m or minimum.blocks is not None or not minimum.reason.converged:
        return None
    if too_much(k, m):
        return None
    image = minimum.jacobian @ estimated.factor
    gram = image.T @ image
    variance = float(np.trace(gram)) / k
    if not np.isfinite(variance) or np.abs(gram / variance - np.eye(k)).max() > ORTHONORMAL:
        return None
    centre = equations.residuals(minimum.point)
    if not abs(float(centre @ centre) - minimum.cost) <= SAME_EQUATIONS * max(minimum.cost, 1.0):
        return None
    return Surroundings(
        equations=equations,
        minimum=minimum,
        factor=estimated.factor,
        tangent=image / np.sqrt(variance),
        variance=variance,
    )


@np.errstate(all="ignore")
def interval_ends(found: Surroundings, estimated: Covariance) -> IntervalEnds:
    """The ends of the 95 % intervals of all coordinates against the stated ones."""
    every = np.full((2, len(estimated.sigma)), np.nan)
    known = np.flatnonzero(np.isfinite(estimated.sigma) & (estimated.sigma > 0.0))
    if found.equations.linear:
        every[:, known] = 1.0
    elif known.size:
        along = found.factor[known] / estimated.sigma[known, None]
        ends = found.ratios(along, found.points(along))
        for place in _off(ends, LOOKED_AT)[:MOST_FOLLOWED]:
            ends[:, place] = found.followed(along[place])
        every[:, known] = ends
    return IntervalEnds(lower=every[0], upper=every[1])


@np.errstate(all="ignore")
def derived_ends(
    found: Surroundings, gradient: Floats, values: Callable[[Floats], Floats], angle: bool
) -> IntervalEnds:
    """The same for a quantity with the ``gradient`` (k, n) and ``values`` (P, k) at P points, by the quick look alone.

    Beside the curvature of the model that of the quantity itself counts: how far it goes on the way to the linear ends;
    minus infinity where it has turned back there.
    """
    image = gradient @ found.factor
    sigma = np.sqrt(np.square(image).sum(axis=1))
    along = image / sigma[:, None]
    points = found.points(along)
    grown = np.ones((2, len(along))) if found.equations.linear else found.ratios(along, points)
    every, places = values(np.vstack([found.minimum.point, points])), np.arange(len(points)) % len(along)
    moves = every[1 + np.arange(len(points)), places] - every[0, places]
    ends = derived_ratios(moves.reshape(2, len(along)), sigma, grown, angle=angle)
    return IntervalEnds(lower=ends[0], upper=ends[1])


def _off(ends: Floats | tuple[Floats, Floats], limit: float) -> Indices:
    """Columns of ``ends`` (2, k) with an end that is farther from 1 than ``limit``; NaN is not."""
    lower, upper = ends
    return np.asarray(((np.abs(lower - 1.0) > limit) | (np.abs(upper - 1.0) > limit)).nonzero()[0])


def _complement(direction: Floats) -> Floats:
    """An orthonormal basis (k, k − 1) of what is orthogonal to a unit vector (k,)."""
    return np.asarray(np.linalg.qr(np.column_stack([direction, np.eye(len(direction))]))[0][:, 1:])


def points_after(equations: Surface, point: Floats, steps: Floats) -> Floats:
    """The points (k, N) from ``point`` (N,) after each of the ``steps`` (k, n), bounds left aside."""
    return equations.retract(np.tile(point, (len(steps), 1)), steps)


def residuals_at(equations: Surface, points: Floats) -> Floats:
    """Residuals (k, m) at points (k, N), which go through the kernels together."""
    if isinstance(equations, Assembled):
        return equations.residuals_at(points)
    return np.stack([equations.residuals(point) for point in points])
