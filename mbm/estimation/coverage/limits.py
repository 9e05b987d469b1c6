"""Hard limits of single coordinates: `:in`, positive unknowns, and constraints on one coordinate alone.

What an estimate would be without a limit that holds it, and how far it would scatter then, follows from the
linearisation: the step and the standard deviation along the one direction that the limit closes.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.spreads import Limited
from mbm.equations.surface import exact_constraints
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum
from mbm.values import dataclass


@np.errstate(all="ignore")
def limited(equations: Assembled, minimum: Minimum, covariance: Covariance) -> Limited | None:
    """The limits at a minimum; None where there are none.

    Where an estimate would be without the limit that holds it is not said under losses, not of likelihoods, and not
    where an equation ties it to others.
    """
    lower, upper, place = *box(equations), equations.coordinates(minimum.point)
    held: Mask = np.asarray(minimum.at_bound != 0)
    tied: Mask = np.zeros(len(lower), dtype=bool)
    state = minimum.constraints
    if state is not None and minimum.blocks is None:
        slopes = np.asarray(state.slopes)
        single, owner = single_limits(slopes, exact_constraints(equations) & ~state.equality)
        held |= narrow(lower, upper, place, Lines(state.values, slopes, state.forcing, single, owner))
        tied = np.asarray(slopes[state.equality].any(axis=0))
    if not (held.any() or np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    step, sigma = np.full(len(lower), np.inf), np.full(len(lower), np.nan)
    if minimum.blocks is None and held.any() and not (equations.lossy or equations.likely):
        image = minimum.jacobian @ covariance.factor
        tangent = image / np.sqrt(np.square(image).sum(axis=0))
        step, sigma = released(minimum.jacobian, tangent, minimum.residuals)
        step, sigma = np.where(tied, np.inf, step), sigma * np.sqrt(covariance.variance)
    return Limited(lower=lower, upper=upper, step=np.where(held, step, np.nan), sigma=np.where(held, sigma, np.nan))


def box(equations: Assembled) -> tuple[Floats, Floats]:
    """The limits (n,) that the unknowns themselves state."""
    lower, upper = equations.lower.copy(), equations.upper.copy()
    lower[equations.positive] = np.maximum(lower[equations.positive], 0.0)
    return lower, upper


def single_limits(slopes: Floats, inequality: Mask) -> tuple[Mask, Indices]:
    """Which of the constraints with ``slopes`` (…, c, n) limit one coordinate alone, and which one that is."""
    touched = slopes != 0.0
    return np.asarray(inequality & (touched.sum(axis=-1) == 1)), np.asarray(touched.argmax(axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Constraints ``values`` (…, c) ≤ 0 with ``slopes`` (…, c, n), some of them ``forcing`` (…, c).

    Those that are ``single`` (…, c) limit the coordinate ``owner`` (…, c) alone.
    """

    values: Floats
    slopes: Floats
    forcing: Mask
    single: Mask
    owner: Indices


def narrow(lower: Floats, upper: Floats, place: Floats, lines: Lines) -> Mask:
    """Narrow limits (…, n) about coordinates ``place`` (…, n) by constraints; which coordinates (…, n) these hold."""
    held = np.zeros(lower.shape, dtype=bool)
    for at in map(tuple, np.argwhere(lines.single)):
        coordinate = (*at[:-1], int(lines.owner[at]))
        slope = lines.slopes[(*at, coordinate[-1])]
        end = place[coordinate] - lines.values[at] / slope
        if slope > 0.0:
            upper[coordinate] = min(upper[coordinate], max(end, place[coordinate]))
        else:
            lower[coordinate] = max(lower[coordinate], min(end, place[coordinate]))
        held[coordinate] |= bool(lines.forcing[at])
    return held


def released(jacobian: Floats, tangent: Floats, residuals: Floats) -> tuple[Floats, Floats]:
    """Of each coordinate the step (…, n) that it takes alone if it is set free, and its sigma at unit variance.

    ``tangent`` (…, m, k) has the directions in which the residuals (…, m) move otherwise, orthonormal.
    """
    along = np.nan_to_num(tangent)
    own = jacobian - np.matmul(along, np.matmul(np.swapaxes(along, -1, -2), jacobian))
    length = np.square(own).sum(axis=-2)
    return -(own * residuals[..., None]).sum(axis=-2) / length, 1.0 / np.sqrt(length)


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """All limits: ``room`` (c,) is left to them, ``slopes`` (c, n) are those of what they limit, and the covariance is
    ``factor`` (n, r) times its transpose.
    """

    room: Floats
    slopes: Floats
    factor: Floats

    def beside(self) -> Mask:
        """Which coordinates (n,) are not the only ones that are limited."""
        touched = self.slopes != 0.0
        alone = touched & (touched.sum(axis=1, keepdims=True) == 1)
        return np.asarray(alone.sum(axis=0) < len(touched))

    @np.errstate(all="ignore")
    def passed(self, gradient: Floats, linear: Floats, *, own: bool) -> Mask:
        """Whether the most probable places at a linear end, which is so far (k,), of quantities with the gradient
        (k, n) lie beyond a limit (k,): those of what a quantity is made of alone are left out if they are not its
        ``own``.
        """
        image = gradient @ self.factor
        moved = self.slopes @ self.factor @ image.T * (linear / np.square(image).sum(axis=1))
        others = (self.slopes != 0.0) @ (gradient == 0.0).T
        return np.asarray(((np.abs(moved) > self.room[:, None]) & (own | others)).any(axis=0))


def edges(equations: Assembled, minimum: Minimum, limits: Limited, factor: Floats) -> Edges:
    """The limits at a minimum, as far as its covariance is known."""
    count, place, state = equations.dimension, equations.coordinates(minimum.point), minimum.constraints
    if minimum.blocks is not None:
        return Edges(np.zeros(0), np.zeros((0, count)), np.zeros((count, 0)))
    room, slopes = [limits.upper - place, place - limits.lower], [np.eye(count), -np.eye(count)]
    if state is not None:
        room.append(-state.values[~state.equality])
        slopes.append(np.asarray(state.slopes)[~state.equality])
    every = np.concatenate(room)
    return Edges(every[np.isfinite(every)], np.vstack(slopes)[np.isfinite(every)], factor)
