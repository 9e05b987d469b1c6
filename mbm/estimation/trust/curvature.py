"""The ends of all 95 % intervals against the stated ones, found once: for the doubts, and for intervals by profile."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from mbm.equations.binding import Group, affine
from mbm.equations.types import Floats, Indices, Minimum
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.nonlinearity import (
    DETERMINED,
    IntervalEnds,
    Surroundings,
    derived_ends,
    interval_ends,
    surroundings,
)
from mbm.estimation.uncertainty.derived import Propagation
from mbm.values import dataclass

MOST_DERIVED = 20
"""Derived numbers whose intervals are looked at."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedEnds:
    """The ``ends`` of the numbers ``known`` (k,) of a derived quantity, by their places in it.

    ``values`` (P, k) gives these numbers at P points, ``gradient`` (k, n) is that at the minimum.
    """

    owner: int
    known: Indices
    ends: IntervalEnds
    gradient: Floats
    values: Callable[[Floats], Floats]
    angle: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curvature:
    """What was found ``around`` a minimum: the ``ends`` of its coordinates, and of quantities that are ``derived``."""

    around: Surroundings
    ends: IntervalEnds
    derived: tuple[DerivedEnds, ...]


@np.errstate(all="ignore")
def curvature(propagation: Propagation, minimum: Minimum, derived: tuple[DerivedSolution, ...]) -> Curvature | None:
    """How curvature moves the ends of intervals; None where it does not, or is not looked at (`surroundings`)."""
    if not minimum.reason.converged or (propagation.equations.linear and not derived):
        return None
    estimated = propagation.outcome.covariance
    around = surroundings(propagation.equations, minimum, estimated)
    if around is None:
        return None
    found = tuple(_derived(propagation, around, derived))
    return Curvature(around=around, ends=interval_ends(around, estimated), derived=found)


def _derived(
    propagation: Propagation, around: Surroundings, derived: tuple[DerivedSolution, ...]
) -> Iterator[DerivedEnds]:
    """Those of quantities that are derived once, and are numbers."""
    left = MOST_DERIVED
    equations, point = propagation.equations, around.minimum.point
    turned = equations.layout.reported(point) - point  # quantities are derived from reported angles
    free = np.zeros(len(equations.layout.number), dtype=bool)
    free[equations.free] = True
    for one in derived:
        stated = propagation.problem.derived[one.owner]
        count = one.sigma.size
        if stated.table is not None or stated.kind is not None or one.gradient is None or count > left:
            continue
        groups = propagation.binder.derived(propagation.kernels, one.owner)
        if len(groups) != 1 or (equations.linear and affine(groups[0], free)):
            continue
        left -= count
        sigma = one.sigma.ravel()
        parts = np.abs(one.gradient) @ np.nan_to_num(propagation.outcome.covariance.sigma)
        known = np.flatnonzero(np.isfinite(one.values.ravel()) & np.isfinite(sigma) & (sigma > DETERMINED * parts))
        if not known.size:
            continue
        values, gradient = _picked(groups[0], known, turned), one.gradient[known]
        ends = derived_ends(around, gradient, values, stated.angle)
        yield DerivedEnds(owner=one.owner, known=known, ends=ends, gradient=gradient, values=values, angle=stated.angle)


def _picked(group: Group, which: Indices, turned: Floats) -> Callable[[Floats], Floats]:
    return lambda points: group.values_at(points + turned)[:, 0, which]
