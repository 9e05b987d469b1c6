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

from collections.abc import Iterator
from itertools import pairwise

from mbm.expression.algebra import ONE, ZERO, add, multiply, subtract
from mbm.expression.nodes import Expression, Parameter
from mbm.language.curves import CurveValue, Piece, Point
from mbm.language.values import Array
from mbm.shapes.motions import Motion, Placing, Stretch
from mbm.shapes.profiles import Profile
from mbm.shapes.types import CurveNode, Group, Node, Patch, Surface, SweptSide
from mbm.text.types import Span


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
