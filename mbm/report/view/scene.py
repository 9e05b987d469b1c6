"""The scene of a problem: cameras with what they see, in the frame that most of it has coordinates in.

Where cameras stood: the frame in which what they see has coordinates, and their poses in it.

The points that a camera sees are formulas of coordinates in some frame: of a body's features, of columns such as x, y
and z of a target, or of estimated points. In the camera's frame they are R X + t, exactly, so that two evaluations a
unit apart give a column of R; the camera stands at −Rᵀ t.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Lookup
from mbm.expression.nodes import Column, Component, leaves
from mbm.expression.rows import RowChoice
from mbm.language.values import Transform
from mbm.problem.types import Problem, UnknownKind
from mbm.report.quantities import quantity_of
from mbm.report.types import Floats
from mbm.report.view.images import ImageRows, answer_lookup, right_up_forward, stepped, values_of
from mbm.report.view.rays import placed_by_rays
from mbm.report.view.solids import solid_of
from mbm.report.view.types import Mark, Solid, Stroke
from mbm.report.view.viewpoint import View
from mbm.shapes.types import Moved, Node, Shape
from mbm.text.types import MbmError
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


MOST_DOTS = 20_000
"""Points that are drawn: each so-manyth of more."""

MOST_CAMERAS, MOST_NAMED = 400, 30
"""Cameras that are drawn, and that are named."""

MOST_SPREADS = 60
"""Estimated points up to which their confidence ellipsoids are drawn."""

LARGEST_SPREAD = 0.5
"""Half axis of an ellipsoid that is drawn, as a share of the scene: greater ones would be all that is seen."""

FRUSTUM = 0.12
"""Length of a camera's pyramid, as a share of the scene."""

CHI_95_3D = 2.795483482915108
"""Radius in standard deviations that holds 95 % of a normal distribution of space: the root of χ²₃ at 95 %."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """A camera in a scene: ``centre`` (3,), ``axes`` (3, 3) with right, up and forward as rows.

    ``field`` (2,) are the tangents of half its field, as far as it was used.
    """

    name: str
    centre: Floats
    axes: Floats
    field: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Cameras, a solid of everything, and from where it is seen; ``notes`` say what was left out."""

    cameras: tuple[Camera, ...]
    solid: Solid
    view: View
    notes: tuple[str, ...] = ()


def scene_of(problem: Problem, rows: Sequence[ImageRows], solution: Solution, library: frozenset[str]) -> Scene | None:
    """The scene that the images of a problem show; None where no camera has a place."""
    sources = [(row, source) for row in rows if (source := source_of(row, solution)) is not None]
    if not sources:
        return None
    weight: dict[str, int] = {}
    for _, source in sources:
        frame = _frame(source)
        weight[frame] = weight.get(frame, 0) + len(source.points)
    chosen = max(weight, key=lambda frame: weight[frame])
    own = [(row, source) for row, source in sources if _frame(source) == chosen]
    left_out = sum(len(row.points) for row in rows) - weight[chosen]
    notes = [f"{left_out:,} measurements refer to other frames"] if left_out else []
    cameras = _cameras(own)
    points = np.unique(np.round(np.concatenate([source.points for _, source in own]), 12), axis=0)
    step = -(-len(points) // MOST_DOTS)
    if step > 1:
        notes.append(f"1 in {step} of {len(points):,} points is drawn in the scene")
    centres = np.stack([camera.centre for camera in cameras])
    size = float(np.ptp(np.concatenate([points, centres]), axis=0).max())
    strokes = [stroke for camera in cameras[:MOST_CAMERAS] for stroke in frustum(camera, FRUSTUM * size)]
    family = next((source.family for _, source in own if source.family is not None), None)
    strokes += _spreads(family, solution, LARGEST_SPREAD * size)
    bodies = list(_bodies(own, solution, library))
    named = cameras[:MOST_NAMED] if len(cameras) <= MOST_NAMED else ()
    solid = Solid(
        name="the scene",
        strokes=(*strokes, *(stroke for body in bodies for stroke in body.strokes)),
        faces=tuple(face for body in bodies for face in body.faces),
        patches=tuple(patch for body in bodies for patch in body.patches),
        marks=tuple(Mark(kind="camera", text=camera.name or "camera", at=camera.centre) for camera in named),
        unit=_unit(problem, own, bodies),
        dots=points[::step],
    )
    return Scene(cameras=cameras, solid=solid, view=_view(cameras, points), notes=tuple(notes))


def _unit(problem: Problem, own: Sequence[tuple[ImageRows, Source]], bodies: Sequence[Solid]) -> str:
    """``m`` where a body, or an unknown that the places depend on, is known to be in metres."""
    names = {leaf.unknown for row, _ in own for leaf in leaves(row.sight.point) if isinstance(leaf, Component)}
    units = {quantity_of(problem, problem.unknown(name)).unit for name in sorted(names)}
    return "m" if "m" in units | {body.unit for body in bodies} else ""


def _frame(source: Source) -> str:
    return "body" if source.body is not None else source.frame


def _cameras(own: Sequence[tuple[ImageRows, Source]]) -> tuple[Camera, ...]:
    """Each place that a camera stood at, once; turns and places that agree to nine digits are one."""
    several = len({row.sight.camera.name for row, _ in own if row.sight.camera is not None}) > 1
    found: dict[tuple[object, ...], tuple[str, ImageRows, Floats, Floats, list[Floats]]] = {}
    for row, source in own:
        frame = right_up_forward(row.sight.axes)
        name = row.sight.camera.name if row.sight.camera is not None else ""
        scale = np.linalg.norm(source.matrix[:, :, 0], axis=1)
        key_numbers = np.round(np.concatenate([source.matrix.reshape(-1, 9), source.offset], axis=1), 9)
        for place in np.unique(key_numbers, axis=0, return_index=True)[1].tolist():
            mask = (key_numbers == key_numbers[place]).all(axis=1)
            label = " ".join(filter(None, (name if several or not row.photo[place] else "", row.photo[place])))
            seen = source.points[mask] @ source.matrix[place].T + source.offset[place]
            turned = seen @ frame.T
            with np.errstate(all="ignore"):
                tangents = np.abs(turned[:, :2] / turned[:, 2:])
            key = (name, *key_numbers[place].tolist())
            matrix, offset = source.matrix[place] / scale[place], source.offset[place] / scale[place]
            found.setdefault(key, (label, row, matrix, offset, []))[4].append(tangents)
    return tuple(_camera(*each) for each in found.values())


def _camera(name: str, row: ImageRows, matrix: Floats, offset: Floats, tangents: Sequence[Floats]) -> Camera:
    every = np.concatenate(tangents)
    every = every[np.isfinite(every).all(axis=1)]
    half = np.clip(every.max(axis=0, initial=0.1), 0.1, 1.5)
    return Camera(
        name=name, centre=-matrix.T @ offset, axes=right_up_forward(row.sight.axes) @ matrix, field=np.asarray(half)
    )


def frustum(camera: Camera, length: float) -> Iterator[Stroke]:
    """The pyramid of a camera: four rays and the frame of its image, with a tip where up is."""
    right, up, forward = camera.axes
    x, y = camera.field * length / max(1.0, float(camera.field.max()))
    middle = camera.centre + length * forward
    corners = np.stack([middle + a * x * right + b * y * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    yield Stroke(points=np.concatenate([corners, corners[:1]]), kind="camera")
    for corner in corners:
        yield Stroke(points=np.stack([camera.centre, corner]), kind="camera")
    tip = middle + 1.4 * y * up
    yield Stroke(points=np.stack([corners[2], tip, corners[3]]), kind="camera")


def _spreads(family: str | None, solution: Solution, largest: float) -> Iterator[Stroke]:
    """The 95 % ellipsoids of estimated points, where they are few and none beyond ``largest``: three circles."""
    if family is None:
        return
    entry = solution.layout.entry(family)
    factor = solution.covariance.factor
    if entry.members > MOST_SPREADS or factor.shape[0] != len(solution.free) or not solution.sigma_known:
        return
    place = np.full(len(solution.layout.number), -1)
    place[solution.free] = np.arange(len(solution.free))
    angles = np.linspace(0.0, 2 * np.pi, 25)
    for member in range(entry.members):
        own = place[entry.first + 3 * member : entry.first + 3 * member + 3]
        if (own < 0).any() or np.isin(solution.free[own], solution.unused).any():
            continue
        centre = solution.numbers[entry.offset + 3 * member : entry.offset + 3 * member + 3]
        covariance = factor[own] @ factor[own].T
        if CHI_95_3D * float(np.sqrt(np.linalg.norm(covariance, 2))) <= largest:
            yield from ellipsoid(centre, covariance, angles)


def ellipsoid(centre: Floats, covariance: Floats, angles: Floats) -> Iterator[Stroke]:
    """The sections of a 95 % ellipsoid along its axes."""
    if not np.isfinite(covariance).all():
        return
    variances, directions = np.linalg.eigh(covariance)
    arms = CHI_95_3D * directions * np.sqrt(np.maximum(variances, 0.0))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        circle = np.cos(angles)[:, None] * arms[:, i] + np.sin(angles)[:, None] * arms[:, j]
        yield Stroke(points=centre + circle, kind="spread")


def _bodies(own: Sequence[tuple[ImageRows, Source]], solution: Solution, library: frozenset[str]) -> Iterator[Solid]:
    """The bodies whose features are seen, once each, in their own frames."""
    known = set()
    for row, source in own:
        if source.body is None:
            continue
        positions = None if row.positions is None else row.positions[:1]
        try:
            solid = solid_of(source.body, "", library, answer_lookup(solution, row.table, positions))
        except MbmError:
            continue
        key = tuple(np.round(np.concatenate(solid.bounds()), 9).tolist())
        if key not in known:
            known.add(key)
            yield solid


def _view(cameras: Sequence[Camera], points: Floats) -> View:
    """From beside the cameras, with that axis of space up which is most so in them."""
    up = np.mean([camera.axes[1] for camera in cameras], axis=0)
    axis = int(np.argmax(np.abs(up)))
    upward = np.zeros(3)
    upward[axis] = 1.0 if up[axis] >= 0 else -1.0
    back = np.mean([camera.centre for camera in cameras], axis=0) - points.mean(axis=0)
    return View.beside(back, upward)
