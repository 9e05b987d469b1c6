"""A shape of the language → numbers to draw: its lines, faces, smooth patches, and the names of its features."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from mbm.expression.derivative import derivatives
from mbm.expression.evaluate import Lookup, evaluate
from mbm.expression.nodes import Constant, Expression, Leaf, Number, Parameter, leaves, postorder
from mbm.language.curves import CurveValue
from mbm.language.values import SCALARS, Transform
from mbm.report.types import Floats
from mbm.report.view import faults
from mbm.report.view.types import Mark, Solid, Stroke
from mbm.shapes.types import (
    CurveNode,
    Group,
    ModelCall,
    Moved,
    NamedPoint,
    Node,
    Part,
    Patch,
    Shape,
    Surface,
    SweptSide,
)
from mbm.text.types import MbmError
from mbm.values import dataclass

TURN = 73
"""Points around an axis, the first again at the end."""

ARC = 37
"""Points of a meridian that is bent."""

Profile = tuple[Floats, ...]
"""Stretches (k, 2) of radius and height, each beginning where the one before it ends, with a rim between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """The smooth patches (n, m, 3) of a body, and the rims where they meet."""

    patches: tuple[Floats, ...]
    rims: tuple[Stroke, ...]


def round_body(name: str, arguments: Mapping[str, float]) -> Body | None:
    """The surface of a round body of the library; None if the model called ``name`` has plane faces only."""
    make = _PROFILES.get(name)
    if make is None:
        return None
    numbers = list(arguments.values())
    profile, stretch = make(*numbers), np.ones(3)
    if name == "ellipsoid":
        profile, stretch = _PROFILES["sphere"](1.0), np.array(numbers)
    patches = tuple(_revolved(stretch_of) * stretch for stretch_of in profile)
    corners = [stretch_of[0] for stretch_of in profile] + [profile[-1][-1]]
    rims = _distinct(corner for corner in corners if corner[0] > 0.0 and len(profile[0]) < ARC)
    return Body(patches=patches, rims=tuple(Stroke(points=_revolved(c[None])[0]) for c in rims))


def _distinct(corners: Iterable[Floats]) -> list[Floats]:
    found: list[Floats] = []
    for corner in corners:
        if not any(np.array_equal(corner, other) for other in found):
            found.append(corner)
    return found


def _revolved(profile: Floats) -> Floats:
    """The grid (k, TURN, 3) of a profile (k, 2) turned about z."""
    angles = np.linspace(0.0, 2 * np.pi, TURN)
    rho, z = profile[:, :1], profile[:, 1:]
    return np.stack([rho * np.cos(angles), rho * np.sin(angles), np.broadcast_to(z, (len(z), TURN))], axis=2)


def _corners(*points: tuple[float, float]) -> Profile:
    """Straight stretches from point to point, each cut in four."""
    share = np.linspace(0.0, 1.0, 5)[:, None]
    ends = [np.array(p, dtype=float) for p in points]
    return tuple(a + share * (b - a) for a, b in pairwise(ends))


def _arc(middle: float, radius: float, first: float, last: float) -> Profile:
    angles = np.linspace(first, last, ARC)
    return (np.stack([middle + radius * np.cos(angles), radius * np.sin(angles)], axis=1),)


_PROFILES: Mapping[str, Callable[..., Profile]] = MappingProxyType(
    {
        "disk": lambda r: _corners((0, 0), (r, 0)),
        "cylinder": lambda r, h: _corners((0, 0), (r, 0), (r, h), (0, h)),
        "cone": lambda r, h: _corners((0, 0), (r, 0), (0, h)),
        "frustum": lambda r1, r2, h: _corners((0, 0), (r1, 0), (r2, h), (0, h)),
        "tube": lambda R, r, h: _corners((r, 0), (R, 0), (R, h), (r, h), (r, 0)),
        "sphere": lambda r: _arc(0.0, r, -np.pi / 2, np.pi / 2),
        "ellipsoid": lambda a, b, c: _arc(0.0, a, -np.pi / 2, np.pi / 2),
        "torus": lambda R, r: _arc(R, r, 0.0, 2 * np.pi),
    }
)


SAMPLES = 97
"""Points of a piece of a curve."""

GRID, STRAIGHT = 49, 5
"""Points of a smooth patch each way, and where it goes straight: facets are long there, and narrow across."""

FARTHEST = 1e100
"""Coordinate of a model; products of three greater ones may not be finite."""

MOST_NUMBERS = 2_000_000
"""Coordinates of one model; more would neither be seen nor drawn in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Affine:
    """x ↦ A x + b: ``matrix`` (3, 3), ``offset`` (3,)."""

    matrix: Floats = field(default_factory=lambda: np.eye(3))
    offset: Floats = field(default_factory=lambda: np.zeros(3))

    def of(self, points: Floats) -> Floats:
        """Points (…, 3) moved."""
        return np.asarray(points @ self.matrix.T + self.offset)

    def after(self, inner: Affine) -> Affine:
        """``inner``, then this."""
        return Affine(matrix=self.matrix @ inner.matrix, offset=self.of(inner.offset))


def only_numbers(leaf: Leaf) -> float:
    """The value of a leaf of a model whose arguments are all known."""
    if isinstance(leaf, Constant):
        return leaf.value
    raise MbmError(faults.no_value(getattr(leaf, "span", None)))


@np.errstate(all="ignore")  # what is not finite is found, and reported, at the end
def solid_of(shape: Shape, name: str, library: frozenset[str], lookup: Lookup = only_numbers) -> Solid:
    """The numbers of a shape; ``library`` are the models that are those of the package, ``lookup`` values of unknowns.

    Raises:
        MbmError: nothing-to-draw, model-without-values, too-much-to-draw; the shape is projected.

    """
    walk = _Walk(library, lookup)
    walk.node(shape.content, Affine(), "")
    found = Solid(
        name=name,
        strokes=tuple(walk.strokes),
        faces=tuple(walk.faces),
        patches=tuple(walk.patches),
        marks=tuple(walk.marks),
        unit="m" if walk.metric else "",
    )
    lo, hi = found.bounds()
    if not float(np.abs([lo, hi]).max()) < FARTHEST:  # NaN neither
        raise MbmError(faults.not_finite(name, shape.span))
    return found


class _Walk:
    """What a shape holds, collected node by node."""

    def __init__(self, library: frozenset[str], lookup: Lookup) -> None:
        self._library, self._lookup = library, lookup
        self._numbers = 0
        self._curves: dict[str, int] = {}
        self.strokes: list[Stroke] = []
        self.faces: list[Floats] = []
        self.patches: list[Floats] = []
        self.marks: list[Mark] = []
        self.metric = False

    def node(self, node: Node, frame: Affine, path: str, *, rounded: bool = False) -> None:
        """Collect ``node``, whose points lie in ``frame``; ``rounded``: its surface is drawn as a round body."""
        match node:
            case Moved():
                inner = frame.after(self._affine(node))
                for child in node.children:
                    self.node(child, inner, path, rounded=rounded)
            case Part():
                self._part(node, frame, path)
            case Group():
                for child in node.children:
                    self.node(child, frame, path, rounded=rounded)
            case ModelCall():
                self._model(node, frame, path)
            case Surface():
                self._surface(node, frame, rounded=rounded)
            case CurveNode():
                self._curve(node, frame, path)
            case SweptSide():
                self.patches.extend(frame.of(self._patch(patch)) for patch in node.patches)
            case NamedPoint():
                self.marks.append(
                    Mark(kind="point", text=node.name, at=frame.of(self._evaluated(node.position.elements)))
                )

    def _part(self, node: Part, frame: Affine, path: str) -> None:
        before = len(self.strokes), len(self.patches)
        name = f"{path}/{node.name}" if path else node.name
        for child in node.children:
            self.node(child, frame, name)
        own = [s.points for s in self.strokes[before[0] :]] + [p.reshape(-1, 3) for p in self.patches[before[1] :]]
        if own and not any(mark.kind == "part" and mark.text.startswith(f"{name}/") for mark in self.marks):
            points = np.vstack(own)
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            self.marks.append(Mark(kind="part", text=name, at=middle))

    def _model(self, node: ModelCall, frame: Affine, path: str) -> None:
        body = None
        if node.name in self._library:
            scalars = {name: v for name, v in node.arguments.items() if isinstance(v, SCALARS)}
            numbers = self._evaluated(tuple(scalars.values()))
            body = round_body(node.name, dict(zip(scalars, numbers.tolist(), strict=True)))
        if body is not None:
            self._count(sum(patch.size for patch in body.patches))
            self.patches.extend(frame.of(patch) for patch in body.patches)
            self.strokes.extend(Stroke(points=frame.of(rim.points)) for rim in body.rims)
        for child in node.children:
            self.node(child, frame, path, rounded=body is not None)

    def _surface(self, node: Surface, frame: Affine, *, rounded: bool) -> None:
        numbers = self._evaluated(tuple(e for p in node.vertexes.values() for e in p.elements))
        at = dict(zip(node.vertexes, frame.of(numbers.reshape(-1, 3)), strict=True))
        self.marks.extend(Mark(kind="vertex", text=str(n), at=p) for n, p in at.items())
        edges: dict[frozenset[int], list[Floats]] = {}
        for n, (a, b) in node.lines.items():
            self.marks.append(Mark(kind="line", text=str(n), at=(at[a] + at[b]) / 2))
            edges[frozenset((a, b))] = []
        for n, corners in node.planes.items():
            polygon = np.stack([at[c] for c in corners])
            normal = newell(polygon)
            self.marks.append(Mark(kind="plane", text=str(n), at=polygon.mean(axis=0), normal=normal))
            if rounded:
                continue
            self.faces.append(polygon)
            for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
                edges.setdefault(frozenset((a, b)), []).append(normal)
        for ends, normals in edges.items():
            both = np.stack(normals) if node.net is not None and len(normals) == 2 else None
            self.strokes.append(Stroke(points=np.stack([at[n] for n in sorted(ends)]), normals=both))

    def _curve(self, node: CurveNode, frame: Affine, path: str) -> None:
        points = frame.of(self._curve_points(node.curve))
        number = self._curves[path] = self._curves.get(path, 0) + 1
        self.strokes.append(Stroke(points=points))
        self.marks.append(Mark(kind="curve", text=str(number), at=points[len(points) // 3]))

    def _curve_points(self, curve: CurveValue) -> Floats:
        stretches = []
        for piece in curve.pieces:
            first, last = self._evaluated((piece.first, piece.last))
            here = {
                curve.parameter: np.linspace(first, last, 2 if _is_straight(piece.point, curve.parameter) else SAMPLES)
            }
            points = self._sampled(piece.point, here)
            stretches.append(points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))]))
        return np.vstack(stretches)

    def _patch(self, patch: Patch) -> Floats:
        (a, a0, a1), (b, b0, b1) = patch.first, patch.second
        ends = self._evaluated((a0, a1, b0, b1))
        n, m = (STRAIGHT if _is_straight(patch.point, each) else GRID for each in (a, b))
        s, t = np.meshgrid(np.linspace(ends[0], ends[1], n), np.linspace(ends[2], ends[3], m), indexing="ij")
        return self._sampled(patch.point, {a: s.ravel(), b: t.ravel()}).reshape(n, m, 3)

    def _affine(self, node: Moved) -> Affine:
        step = node.step
        if not isinstance(step, Transform):
            raise MbmError(faults.projected_shape(node.span))
        matrix = np.eye(3) if step.matrix is None else self._evaluated(step.matrix.elements).reshape(3, 3)
        offset = np.zeros(3) if step.offset is None else self._evaluated(step.offset)
        return Affine(matrix=matrix, offset=offset)

    def _evaluated(self, elements: tuple[Expression, ...]) -> Floats:
        """The numbers (n,) of scalars."""
        self._count(len(elements))
        self.metric = self.metric or any(
            isinstance(node, Number) and node.dimension is not None and node.dimension.exponents == _METRE
            for node in postorder(elements)
        )
        return np.array([float(np.ravel(v)[0]) for v in evaluate(elements, self._lookup)])

    def _sampled(self, elements: tuple[Expression, ...], given: dict[Parameter, Floats]) -> Floats:
        count = len(next(iter(given.values())))
        self._count(count * len(elements))

        def value(leaf: Leaf) -> Floats | float:
            return given[leaf] if isinstance(leaf, Parameter) and leaf in given else self._lookup(leaf)

        return np.stack([np.broadcast_to(v, count) for v in evaluate(elements, value)], axis=1)

    def _count(self, more: int) -> None:
        self._numbers += more
        if self._numbers > MOST_NUMBERS:
            raise MbmError(faults.too_much_to_draw(f"{MOST_NUMBERS:,} coordinates"))


def newell(polygon: Floats) -> Floats:
    """The normal (3,) of a polygon (k, 3), as long as twice its area (Newell's method)."""
    after = np.roll(polygon, -1, axis=0)
    return np.asarray(np.cross(polygon, after).sum(axis=0))


def _is_straight(point: tuple[Expression, ...], parameter: Parameter) -> bool:
    """Whether a formula is straight in a parameter: its slopes do not depend on that."""
    return all(leaf is not parameter for leaf in leaves(derivatives(point, parameter)))


_METRE = (1, 0, 0, 0, 0, 0, 0)
