"""Where cameras stood: the frame in which what they see has coordinates, and their poses in it.

The points that a camera sees are formulas of coordinates in some frame: of a body's features, of columns such as x, y
and z of a target, or of estimated points. In the camera's frame they are R X + t, exactly, so that two evaluations a
unit apart give a column of R; the camera stands at −Rᵀ t.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Lookup
from mbm.expression.nodes import Column, Component, RowChoice, leaves
from mbm.language.values import Transform
from mbm.problem.types import UnknownKind
from mbm.report.types import Floats
from mbm.report.view.images import ImageRows, right_up_forward
from mbm.report.view.rays import placed_by_rays
from mbm.report.view.values import answer_lookup, stepped, values_of
from mbm.shapes.types import Moved, Node, Shape
from mbm.values import dataclass

_SQUARE = 1e-6
"""By how much columns of R may fail to be at right angles, relative to their lengths."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """What the rows of an image see, in one frame.

    ``points`` (n, 3) there; in the cameras' frames they are ``matrix`` (n, 3, 3) times them plus ``offset`` (n, 3).
    ``frame`` tells frames apart; ``family`` is the unknown whose members the points are, None where they are given.
    """

    frame: str
    points: Floats
    matrix: Floats
    offset: Floats
    family: str | None = None
    body: Shape | None = None


def source_of(row: ImageRows, solution: Solution) -> Source | None:
    """Where the points of some rows have coordinates; None if their formulas do not say."""
    if row.sight.family is not None:
        return _by_rays(row, row.sight.family, solution)
    known = answer_lookup(solution, row.table, row.positions)
    if row.sight.body is not None:
        return _of_body(row, row.sight.body, known)
    for frame, targets, family in _candidates(row, solution):
        found = _of_coordinates(row, known, targets)
        if found is not None:
            points, matrix = found
            offset = row.points - np.einsum("nij,nj->ni", matrix, points)
            return Source(frame=frame, points=points, matrix=matrix, offset=offset, family=family)
    return None


def _by_rays(row: ImageRows, family: str, solution: Solution) -> Source | None:
    """The poses of cameras that are known by their rays only; rows of those that have no place are left out."""
    names = np.array(row.photo)
    matrix, offset = np.full((len(names), 3, 3), np.nan), np.full((len(names), 3), np.nan)
    for name in dict.fromkeys(row.photo):
        placed = placed_by_rays(row, names == name, solution)
        if placed is not None:
            matrix[names == name] = right_up_forward(row.sight.axes).T @ placed.axes
            offset[names == name] = -(matrix[names == name][0] @ placed.centre)
    if not bool(np.isfinite(matrix).all()):
        return None
    return Source(frame=f"family {family}", points=row.points, matrix=matrix, offset=offset, family=family)


def _of_body(row: ImageRows, body: Shape, known: Lookup) -> Source:
    """The frame of the model itself: what stands inside of the transforms around it."""
    count = len(row.points)
    matrix, offset = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    node: Node = body.content
    while isinstance(node, Moved) and isinstance(node.step, Transform):
        step = node.step
        if step.offset is not None:
            offset = offset + np.einsum("nij,nj->ni", matrix, values_of(step.offset, known, count))
        if step.matrix is not None:
            matrix = matrix @ values_of(step.matrix.elements, known, count).reshape(count, 3, 3)
        node = node.children[0]
    points = np.asarray(np.linalg.solve(matrix, (row.points - offset)[:, :, None])[:, :, 0], dtype=np.float64)
    inner = Shape(content=node, span=body.span)
    return Source(frame=f"body {id(node)}", points=points, matrix=matrix, offset=offset, body=inner)


def _candidates(row: ImageRows, solution: Solution) -> Iterator[tuple[str, tuple[object, ...], str | None]]:
    """Coordinates that the points may be given in: columns of the row, then families of vectors, the largest first."""
    found = leaves(row.sight.point)
    columns = [leaf for leaf in found if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and not leaf.sampling]
    named = dict.fromkeys(leaf.identity for leaf in columns)
    if len(named) in (2, 3):
        yield "columns", tuple(named), None
    families: dict[tuple[str, object], set[tuple[object, ...]]] = {}
    for leaf in found:
        if isinstance(leaf, Component) and _is_vector(leaf, solution):
            families.setdefault((leaf.unknown, leaf.member), set()).add(leaf.identity)
    sizes = {name: solution.layout.entry(name).members for name, _ in families}
    for name, member in sorted(families, key=lambda family: -sizes[family[0]]):
        if len(families[name, member]) == 3:
            yield f"family {name}", tuple((name, (i,), member) for i in (1, 2, 3)), name


def _is_vector(leaf: Component, solution: Solution) -> bool:
    unknown = solution.layout.entry(leaf.unknown).unknown
    return unknown.kind is UnknownKind.VECTOR and unknown.shape == (3,)


def _of_coordinates(row: ImageRows, known: Lookup, targets: tuple[object, ...]) -> tuple[Floats, Floats] | None:
    """The points (n, 3) and R (n, 3, 3) where ``targets`` are coordinates; the third is 0 if there are but two."""
    count = len(row.points)
    sides = []
    for target in targets:
        ahead = values_of(row.sight.point, stepped(known, target, 1.0), count)
        sides.append(ahead - row.points)
    if len(sides) == 2:
        sides.append(np.cross(sides[0], sides[1]))
    matrix = np.stack(sides, axis=2)
    product = matrix.transpose(0, 2, 1) @ matrix
    scale = product[:, 0, 0]
    with np.errstate(all="ignore"):
        skew = np.abs(product / scale[:, None, None] - np.eye(3)).max()
    if not skew < _SQUARE:
        return None
    at = {leaf.identity: leaf for leaf in leaves(row.sight.point) if isinstance(leaf, Column | Component)}
    points = np.zeros((count, 3))
    for k, target in enumerate(targets):
        points[:, k] = known(at[target])  # type: ignore[index]
    return points, matrix
