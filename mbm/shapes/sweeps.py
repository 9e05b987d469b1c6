"""Bodies and sheets that a profile sweeps, with their numbered features (LANGUAGE §3).

With V, L the greatest numbers of a vertex and a line of the profile, F its faces, and sections numbered j = 0, 1, …:

* vertex ``j V + n`` and line ``j L + n`` are those of the profile in section j, curves those of the first section, then
  of the next;
* where the way from section to section is straight, line ``S L + j V + n`` (of S sections) joins vertex n of sections
  j and j + 1, and plane ``2 F + j L + n`` is the side over line n between them;
* where it is smooth, the ways of the vertexes follow the other curves;
* planes ``1…F`` are the faces of the first section, ``F+1…2F`` of the last, all seen from outside; a closed way has
  neither, and its sides are numbered ``j L + n``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

from mbm.expression.algebra import ONE, ZERO, add, multiply, subtract
from mbm.expression.nodes import Expression, Number, Parameter
from mbm.language.curves import CurveValue, Piece, Point
from mbm.language.values import Array, Call
from mbm.shapes import faults
from mbm.shapes.features import Place, carried, carried_curve, contents
from mbm.shapes.motions import Motion, Placing, Stretch
from mbm.shapes.types import CurveNode, Group, Node, Part, Patch, Surface, SweptSide
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
        for edge in _edges(self.faces):
            around.setdefault(frozenset(edge), []).append(edge)
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
    if not surfaces:
        return Profile(vertexes={}, lines={}, faces=(), curves=tuple(curves))
    surface, vertexes = surfaces[0]
    faces = _faces(surface, vertexes, span)
    # beside curves, planes are flat pieces within what these go round (the four corners of a disk)
    lines = surface.lines if curves else _lines(surface, faces)
    return Profile(vertexes=vertexes, lines=lines, faces=faces, curves=tuple(curves))


def _edges(faces: tuple[tuple[int, ...], ...]) -> Iterator[tuple[int, int]]:
    """Neighbouring vertexes around each face, in its direction."""
    for face in faces:
        yield from pairwise((*face, face[0]))


def _lines(surface: Surface, faces: tuple[tuple[int, ...], ...]) -> Mapping[int, tuple[int, ...]]:
    """Its lines, and numbered on from them the edges of its faces that are none of them."""
    lines = dict(surface.lines)
    named = {frozenset(ends) for ends in lines.values()}
    for edge in _edges(faces):
        if frozenset(edge) not in named:
            named.add(frozenset(edge))
            lines[max(lines, default=0) + 1] = edge
    return lines


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


def swept(profile: Profile, motion: Motion, span: Span) -> Group:
    """What ``profile`` sweeps in ``motion``."""
    nodes: list[Node] = []
    if profile.vertexes:
        nodes.append(_surface(profile, motion, span))
    for place in motion.sections:
        nodes.extend(CurveNode(curve=curve.mapped(place), span=span) for curve in profile.curves)
    if motion.stretches:
        paths = (_path(profile.vertexes[n], motion.stretches, span) for n in sorted(profile.vertexes))
        nodes.extend(CurveNode(curve=path, span=span) for path in paths)
    nodes.extend(_smooth_sides(profile, motion, span))
    return Group(children=tuple(nodes), span=span)


def _surface(profile: Profile, motion: Motion, span: Span) -> Surface:
    sections, straight = motion.sections, not motion.stretches
    step, line_step, count = profile.vertex_step, profile.line_step, len(motion.sections)
    vertexes = {
        j * step + n: Array((3,), place(point))
        for j, place in enumerate(sections)
        for n, point in profile.vertexes.items()
    }
    lines = {
        j * line_step + n: (j * step + a, j * step + b) for j in range(count) for n, (a, b) in profile.lines.items()
    }
    planes: dict[int, tuple[int, ...]] = {}
    faces = () if motion.closed else profile.faces
    last = (count - 1) * step
    for number, face in enumerate(faces, 1):
        ends = (face, tuple(last + n for n in face))
        backward, forward = ends[::-1] if motion.against else ends
        planes[number if backward is face else len(faces) + number] = (backward[0], *reversed(backward[1:]))
        planes[number if forward is face else len(faces) + number] = forward
    if straight:
        for j, after in _joints(count, closed=motion.closed):
            for n in profile.vertexes:
                lines[count * line_step + j * step + n] = (j * step + n, after * step + n)
            for n, (a, b) in profile.sides().items():
                here, there = j * step, after * step
                planes[2 * len(faces) + j * line_step + n] = (here + a, here + b, there + b, there + a)
    return Surface(vertexes=dict(sorted(vertexes.items())), lines=lines, planes=planes, span=span)


def _joints(count: int, *, closed: bool) -> Iterator[tuple[int, int]]:
    """Each section with the one that it is joined to."""
    yield from pairwise(range(count))
    if closed:
        yield count - 1, 0


def _path(vertex: Point, stretches: tuple[Stretch, ...], span: Span) -> CurveValue:
    """The way of a vertex in a smooth motion."""
    pieces = tuple(Piece(first=s.first, last=s.last, point=s.place(vertex)) for s in stretches)
    return CurveValue(parameter=stretches[0].parameter, pieces=pieces, span=span)


def _smooth_sides(profile: Profile, motion: Motion, span: Span) -> Iterator[SweptSide]:
    """The sides over curves, and in a smooth motion those over lines."""
    for curve in profile.curves:
        ends = (
            () if motion.closed else _ends(len(curve.pieces), len(motion.stretches) or len(motion.sections) - 1, motion)
        )
        yield SweptSide(patches=tuple(_patches(curve, motion, span)), ends=ends, span=span)
    if motion.stretches:
        for a, b in profile.sides().values():
            edge = _edge(profile.vertexes[a], profile.vertexes[b], span)
            yield SweptSide(patches=tuple(_patches(edge, motion, span)), ends=(), span=span)


def _ends(pieces: int, ways: int, motion: Motion) -> tuple[tuple[tuple[int, int, bool], ...], ...]:
    """The sides of `_patches` where the way begins, and where it ends, in the direction of the curve."""
    first, last = ((3, False), (1, True)) if motion.against else ((0, True), (2, False))
    begin = tuple((k * ways, *first) for k in range(pieces))
    return begin, tuple((k * ways + ways - 1, *last) for k in range(pieces))


def _edge(a: Point, b: Point, span: Span) -> CurveValue:
    parameter = Parameter("s", span)
    piece = Piece(first=ZERO, last=ONE, point=_between(a, b, parameter, span))
    return CurveValue(parameter=parameter, pieces=(piece,), span=span)


def _between(a: Point, b: Point, share: Expression, span: Span) -> Point:
    pairs = zip(a, b, strict=True)
    return tuple(add(x, multiply(share, subtract(y, x, span), span), span) for x, y in pairs)


def _patches(curve: CurveValue, motion: Motion, span: Span) -> Iterator[Patch]:
    """What each piece of a curve sweeps on each stretch of the way, turned so that it is seen from outside."""
    for piece in curve.pieces:
        for stretch in motion.stretches or _ruled(motion, span):
            own = (curve.parameter, piece.first, piece.last)
            way = (stretch.parameter, stretch.first, stretch.last)
            first, second = (way, own) if motion.against else (own, way)
            yield Patch(first=first, second=second, point=stretch.place(piece.point))


def _ruled(motion: Motion, span: Span) -> tuple[Stretch, ...]:
    """The straight ways between sections as stretches, from 0 to 1."""
    share = Parameter("w", span)

    def place(start: Placing, end: Placing) -> Placing:
        return lambda p: _between(start(p), end(p), share, span)

    joints = _joints(len(motion.sections), closed=motion.closed)
    return tuple(
        Stretch(parameter=share, first=ZERO, last=ONE, place=place(motion.sections[i], motion.sections[j]))
        for i, j in joints
    )


def points_of(profile: Profile, motion: Motion) -> int:
    """How many points a sweep makes, those of patches among them."""
    pieces = sum(len(curve.pieces) for curve in profile.curves)
    places = len(motion.sections) + len(motion.stretches)
    return (len(profile.vertexes) + len(profile.lines) + pieces) * places
