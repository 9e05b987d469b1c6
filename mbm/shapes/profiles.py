"""What is swept: the vertexes, lines, faces and curves of a plane shape."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.expression.nodes import Number
from mbm.language.curves import CurveValue, Point
from mbm.language.values import Array, Call
from mbm.shapes import faults
from mbm.shapes.features import Place, carried, carried_curve, contents
from mbm.shapes.types import CurveNode, Node, Part, Surface, SweptSide
from mbm.text.types import MbmError, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """A plane shape in z = 0: points of three numbers, lines and faces over their numbers, curves in their order.

    Each of ``faces`` is told once, counter-clockwise seen from +z.
    """

    vertexes: Mapping[int, Point]
    lines: Mapping[int, tuple[int, ...]]
    faces: tuple[tuple[int, ...], ...]
    curves: tuple[CurveValue, ...]

    @property
    def vertex_step(self) -> int:
        """The greatest number of a vertex: what the vertexes of the next section are numbered beyond."""
        return max(self.vertexes, default=0)

    @property
    def line_step(self) -> int:
        """The greatest number of a line."""
        return max(self.lines, default=0)

    def sides(self) -> dict[int, tuple[int, int]]:
        """The lines over which there is a side, by number, each in the direction that has the inside on its left.

        Where there are faces, these are the lines that belong to one of them only; else all lines.
        """
        around: dict[frozenset[int], list[tuple[int, int]]] = {}
        for face in self.faces:
            for a, b in zip(face, (*face[1:], face[0]), strict=True):
                around.setdefault(frozenset((a, b)), []).append((a, b))
        found = {}
        for number, (a, b) in self.lines.items():
            edges = around.get(frozenset((a, b)), [] if self.faces else [(a, b)])
            if len(edges) == 1:
                found[number] = edges[0]
        return found


def profile_of(nodes: tuple[Node, ...], call: Call, span: Span) -> Profile:
    """The plane shape that ``nodes`` describe; named points are left out.

    Raises:
        MbmError: bad-profile, they describe no plane shape, or more than one surface.

    """
    surfaces: list[tuple[Surface, Mapping[int, Point]]] = []
    curves: list[CurveValue] = []
    for node, steps in contents(call, Place(nodes=nodes, steps=(), owner="the profile")):
        if isinstance(node, Part | SweptSide):
            what = f"the part `{node.name}`" if isinstance(node, Part) else "a body"
            raise MbmError(faults.bad_profile(span, f"it holds {what}"))
        if isinstance(node, Surface):
            points = {n: _plane(carried(p, steps, call), span) for n, p in node.vertexes.items()}
            surfaces.append((node, points))
        elif isinstance(node, CurveNode):
            moved = carried_curve(node.curve, steps, call)
            for piece in moved.pieces:
                _plane(Array((len(piece.point),), piece.point), span)
            curves.append(moved)
    if len(surfaces) > 1:
        raise MbmError(faults.bad_profile(span, f"it has {len(surfaces)} surfaces"))
    if not surfaces and not curves:
        raise MbmError(faults.bad_profile(span, "it has neither vertexes nor curves"))
    surface, vertexes = surfaces[0] if surfaces else (None, {})
    return Profile(
        vertexes=vertexes,
        lines=surface.lines if surface is not None else {},
        faces=_faces(surface, vertexes, span) if surface is not None else (),
        curves=tuple(curves),
    )


def _plane(point: Array, span: Span) -> Point:
    z = point.elements[2] if len(point.elements) == 3 else None
    if not isinstance(z, Number) or z.value != 0:
        raise MbmError(faults.bad_profile(span, "it does not lie in z = 0"))
    return point.elements


def _faces(surface: Surface, vertexes: Mapping[int, Point], span: Span) -> tuple[tuple[int, ...], ...]:
    """The planes without those that are the back of one before."""
    found: dict[frozenset[int], tuple[int, ...]] = {}
    for number in sorted(surface.planes):
        face = surface.planes[number]
        if frozenset(face) not in found and _is_clockwise(face, vertexes):
            raise MbmError(faults.bad_profile(span, f"its plane {number} runs clockwise seen from +z"))
        found.setdefault(frozenset(face), face)
    return tuple(found.values())


def _is_clockwise(face: tuple[int, ...], vertexes: Mapping[int, Point]) -> bool:
    """Whether numbers tell so; where there are unknowns, the order is believed."""
    corners = [[c.value for c in vertexes[n][:2] if isinstance(c, Number)] for n in face]
    if any(len(corner) < 2 for corner in corners):
        return False
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return sum(float(a[0]) * float(b[1]) - float(a[1]) * float(b[0]) for a, b in pairs) < 0
