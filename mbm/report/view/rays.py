"""Images made by functions of the user: which equations are such, and where their cameras stand.

An equation of two measured columns whose model depends on estimated points of space, and on something else that has
keys of its own, is taken for an image of the points by a camera of that key. A point may move along its viewing ray
without changing its image: the ray is the null direction of the 2 × 3 derivative of the image. All rays of a camera
meet in its centre, which is found as the point of least squared distance to them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.expression.algebra import add
from mbm.expression.nodes import Column, ColumnMember, Component, leaves
from mbm.problem.types import Equation, Problem, UnknownKind
from mbm.report.types import Floats, Mask
from mbm.report.view.images import ImageRows, answer_lookup, points_seen, stepped, values_of
from mbm.report.view.seeings import Seeing, Sight, equations_of
from mbm.values import dataclass

STEP = 1e-5
"""Of central differences, as a share of the spread of the points: errors of 1e-10 beside rounding of 1e-11."""

FEWEST_RAYS = 3
"""Rays that place a camera."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placed:
    """A camera by its rays: ``centre`` (3,), right, up and forward as the rows of ``axes`` (3, 3).

    ``down``: the second image coordinate grows downward.
    """

    centre: Floats
    axes: Floats
    down: bool


def implied_seeings(problem: Problem) -> Iterator[Seeing]:
    """The equations that are images of estimated points, made by whatever functions."""
    for at, equation in equations_of(problem):
        sight = _implied(problem, equation)
        if sight is not None:
            yield Seeing(at=at, sign=1.0, sight=sight)


def _implied(problem: Problem, equation: Equation) -> Sight | None:
    measured = equation.measured
    if measured is None or len(measured) != 2 or not all(isinstance(m, Column) for m in measured):
        return None
    image = tuple(add(c, m, equation.span) for c, m in zip(equation.components, measured, strict=True))
    names = points_seen(image)
    if len(names) != 1 or problem.unknown(next(iter(names))).kind is not UnknownKind.VECTOR:
        return None
    (name,) = names
    found: dict[tuple[int, ...], Component] = {}
    for leaf in leaves(image):
        if isinstance(leaf, Component) and leaf.unknown == name and isinstance(leaf.member, ColumnMember):
            found[leaf.index] = leaf
    point = tuple(found[index] for index in sorted(found))
    if len(point) != 3 or len({leaf.member for leaf in point}) != 1:
        return None
    return Sight(image=image, point=point, camera=None, body=None, ray=(), lens=image, family=name)


def placed_by_rays(row: ImageRows, which: Mask, solution: Solution) -> Placed | None:
    """The camera of some rows (a mask); None where they are too few, or their rays do not meet."""
    positions = None if row.positions is None else row.positions[which]
    points = row.points[which]
    if len(points) < FEWEST_RAYS:
        return None
    known = answer_lookup(solution, row.table, positions)
    step = STEP * float(np.ptp(points, axis=0).max())
    slopes = np.empty((len(points), 2, 3))
    for k, leaf in enumerate(row.sight.point):
        target = leaf.identity if isinstance(leaf, Component) else None
        ahead, back = (values_of(row.sight.image, stepped(known, target, s), len(points)) for s in (step, -step))
        slopes[:, :, k] = (ahead - back) / (2 * step)
    rays = np.cross(slopes[:, 0], slopes[:, 1])
    lengths = np.linalg.norm(rays, axis=1)
    good = np.isfinite(rays).all(axis=1) & (lengths > 0)
    if int(good.sum()) < FEWEST_RAYS:
        return None
    rays, points, slopes = rays[good] / lengths[good, None], points[good], slopes[good]
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.cond(normal) > 1e10:
        return None
    centre = np.linalg.solve(normal, np.einsum("nij,nj->i", across, points))
    return _oriented(centre, points, slopes)


def _oriented(centre: Floats, points: Floats, slopes: Floats) -> Placed:
    """Forward is the mean way to the points, right that in which the first coordinate grows."""
    ways = points - centre
    forward = (ways / np.linalg.norm(ways, axis=1)[:, None]).mean(axis=0)
    forward = forward / np.linalg.norm(forward)
    growing = slopes[:, 0].mean(axis=0)
    right = growing - (growing @ forward) * forward
    right = right / np.linalg.norm(right)
    up = np.cross(right, forward)
    down = float(slopes[:, 1].mean(axis=0) @ up) < 0.0
    return Placed(centre=centre, axes=np.stack([right, up, forward]), down=down)
