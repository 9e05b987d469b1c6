"""The lines of an image that may be part of an outline, and how many more sheets cover their left than their right.

Each flat face and each stretch of a surface that is seen from one side is bounded counter-clockwise in the image: sides
that two of them share in opposite directions cancel, where a surface folds two add up. The number of sheets that cover
a point of the image is then its winding number about all arcs; no closed body has to be known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.outlines.folds import CELLS, folds_of
from mbm.kernels.outlines.surveyor import Flats, Surveyor
from mbm.kernels.types import Floats
from mbm.values import dataclass

NEAREST_DEPTH = 0.1
"""Depth in m from which something is seen."""

SAME = 1e-8
"""Of the image's size: sides of surfaces that are no farther apart are one."""

BENT = 8
"""Chords of the bent image of a straight line."""

RULED, UNEVEN, THINNED = 1e-6, 4.0, 8
"""A straight fold: how far it is from its chord, in lengths; how many times faster its image may run in one part than
in another, so that Gauss points and polynomials do on the longer chords; and of how many nodes one is kept.
"""

SPARSELY = 4
"""Of so many nodes of a grid one tells the size of a surface."""

POINT = 1e-10
"""Parameter beside a side that is a single point, where D would vanish all along."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arc:
    """``nodes`` (n + 1, 2) are parameters of a sheet, ``points`` their images (n + 1, 2), the more covered side left.

    Between two nodes it runs straight in the parameters, or, if ``fold``, where the surface folds beside that line.
    ``net`` is the number of that which it is an edge of, or −1.
    """

    sheet: int
    places: NDArray[np.int64]
    fold: bool
    straight: bool
    weight: int
    nodes: Floats
    points: Floats
    net: int = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Patch:
    """A surface with the images of its sides, (CELLS + 1, 3) each, counter-clockwise; None for one that is a point.

    ``turns`` (4, CELLS + 1) are values of D there, ``zeros`` where it changes its sign.
    """

    sheet: int
    places: NDArray[np.int64]
    sides: tuple[Floats | None, ...]
    turns: Floats
    zeros: tuple[Floats, ...]
    lines: tuple[Floats, ...]


def arcs_of(surveyor: Surveyor, numbers: Floats) -> tuple[Arc, ...] | None:
    """The arcs of a figure for numbers with corners; None where some of it is not in front of the camera."""
    arcs = _edges(surveyor, numbers)
    patches = [_patch(surveyor, sheet, places, numbers) for sheet, places in surveyor.figure.patches]
    if arcs is None or any(patch is None for patch in patches):
        return None
    surfaces = [patch for patch in patches if patch is not None]
    for patch in surfaces:
        for every in patch.lines:
            line, points = _thinned(every, _geometry(surveyor, patch, every, numbers)[:, :2])
            arcs.append(
                Arc(
                    sheet=patch.sheet,
                    places=patch.places,
                    fold=True,
                    straight=False,
                    weight=2,
                    nodes=line,
                    points=points,
                )
            )
    groups = _same_sides(surfaces)
    beside = _on_sides(arcs, np.array([surfaces[group[0][0]].sides[group[0][1]] for group in groups]))
    merged = {line for lines in beside.values() for line, _ in lines}
    shared = {group: [arcs[line].weight * way for line, way in lines] for group, lines in beside.items()}
    sides = _sides(surveyor, surfaces, numbers, [(each, sum(shared.get(k, ()))) for k, each in enumerate(groups)])
    return (*(arc for k, arc in enumerate(arcs) if k not in merged), *sides)


def _on_sides(arcs: list[Arc], sides: Floats) -> dict[int, list[tuple[int, int]]]:
    """The numbers of arcs of flat faces that run along one of ``sides`` (k, CELLS + 1, 3): 1, or against it: −1."""
    found: dict[int, list[tuple[int, int]]] = {}
    lines = [k for k, arc in enumerate(arcs) if not arc.fold and arc.net < 0] if len(sides) else []
    if not lines:
        return found
    limit = SAME * np.ptp(sides[..., :2].reshape(-1, 2), axis=0).max()
    ends = np.array([arcs[k].points[[0, -1]] for k in lines])
    tips = sides[:, [0, -1], :2]
    for way in (1, -1):
        near = np.abs(ends[:, None, ::way] - tips[None]).max(axis=(2, 3)) <= limit
        for line, side in np.argwhere(near).tolist():
            arc, images = arcs[lines[line]], sides[side, :, :2]
            if arc.straight:
                (x, y), (u, v) = (images - images[0]).T, images[-1] - images[0]
                away = np.abs(x * v - y * u) / max(np.hypot(u, v), 1e-300)
            else:
                away = np.abs(arc.points[::way] - images[:: CELLS // BENT])
            if away.max() <= limit:
                found.setdefault(side, []).append((lines[line], way))
    return found


def _thinned(nodes: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Every eighth node of a fold that is straight and evenly paced, as those of cylinders and cones are."""
    for each in (nodes, points):
        ways, whole = each - each[0], each[-1] - each[0]
        if np.abs(ways[:, 0] * whole[1] - ways[:, 1] * whole[0]).max() > RULED * np.dot(whole, whole):
            return nodes, points
    paces = np.diff(points, axis=0) @ (points[-1] - points[0])
    if not 0 < paces.max() < UNEVEN * paces.min():
        return nodes, points
    kept = [*range(0, len(nodes) - 1, THINNED), len(nodes) - 1]
    return nodes[kept], points[kept]


_ENDS, _BENT_NODES = (np.stack([np.linspace(0, 1, k + 1), np.zeros(k + 1)], axis=1) for k in (1, BENT))
"""Parameters of the nodes of lines."""


def _edges(surveyor: Surveyor, numbers: Floats) -> list[Arc] | None:
    """The lines, each weighed by the faces that it bounds; None where an end of one is not in front of the camera."""
    flats = surveyor.flats
    if not len(flats.sheet):
        return []
    ends = _ends_of_lines(surveyor, numbers)
    if not (ends[..., 2] >= NEAREST_DEPTH).all():
        return None
    turns = np.sign(_areas_of_faces(flats, ends)).astype(np.int64)
    around = np.repeat(turns, np.diff(flats.first, append=len(flats.sides)))
    weights = np.bincount(flats.sides, weights=np.where(flats.along, around, -around), minlength=len(ends))
    arcs = []
    for line in np.flatnonzero(weights).tolist():
        sheet, weight = int(flats.sheet[line]), int(weights[line])
        own = surveyor.sheets[sheet]
        places, nodes, points = flats.places[line, : own.inputs], _ENDS, ends[line, :, :2]
        if not own.straight:
            nodes, points = _BENT_NODES, surveyor.table(sheet, "places", _BENT_NODES, numbers[places])[:, :2]
        back = 1 if weight > 0 else -1
        arcs.append(
            Arc(
                sheet=sheet,
                places=places,
                fold=False,
                straight=own.straight,
                weight=abs(weight),
                nodes=nodes[::back],
                points=points[::back],
                net=int(flats.net[line]),
            )
        )
    return arcs


def _ends_of_lines(surveyor: Surveyor, numbers: Floats) -> Floats:
    """u, v and the depth of both ends of each line (lines, 2, 3)."""
    flats = surveyor.flats
    found = np.empty((len(flats.sheet), 2, 3))
    for sheet in np.unique(flats.sheet).tolist():
        own, programs = np.flatnonzero(flats.sheet == sheet), surveyor.sheets[sheet]
        inputs = numbers[flats.places[own, : programs.inputs]]
        if not programs.straight:
            at = np.tile(_ENDS, (len(own), 1))
            inputs = surveyor.table(sheet, "places", at, np.repeat(inputs, 2, axis=0))
        found[own] = inputs.reshape(-1, 2, 3)
    return found


def _areas_of_faces(flats: Flats, ends: Floats) -> Floats:
    """Twice the areas (faces,) of polygons, positive if they run counter-clockwise in the image."""
    if not len(flats.first):
        return np.zeros(0)
    corners = ends[flats.sides, np.where(flats.along, 0, 1), :2]
    corners -= np.repeat(corners[flats.first], np.diff(flats.first, append=len(corners)), axis=0)
    after = np.append(corners[1:], corners[:1], axis=0)
    after[flats.first - 1] = 0  # behind the last corner comes the first one, which adds nothing
    return np.add.reduceat(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0], flats.first)


def areas_of_flats(surveyor: Surveyor, numbers: Floats) -> Floats:
    """Twice the areas (faces and ends,) of the images of polygons in all that is flat: zero where it is edge-on."""
    figure, numbers = surveyor.figure, surveyor.with_corners(numbers)

    def images(patch: int, number: int) -> Floats:
        sheet, places = figure.patches[patch]
        return surveyor.table(sheet, "geometry", side_parameters(number, _SHARES), numbers[list(places)])[:, :2]

    areas = _areas_of_faces(surveyor.flats, _ends_of_lines(surveyor, numbers))
    return np.array([*areas, *(_area_of_end(images, loop) for loop in figure.ends)])


def doubled_area(points: Floats) -> float:
    """Of a polygon (n, 2), positive if it runs counter-clockwise."""
    x, y = (points[1:] - points[0]).T  # the first point adds nothing
    return float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))


def _patch(surveyor: Surveyor, sheet: int, places: tuple[int, ...], numbers: Floats) -> _Patch | None:
    own = np.array(places, dtype=np.int64)
    inputs = numbers[own]

    def table(at: Floats) -> Floats:
        return surveyor.table(sheet, "geometry", at, inputs)

    def fold(at: Floats) -> tuple[Floats, Floats]:
        found = table(at)
        return jacobian(found), found[:, 7:9]

    s = t = _SHARES
    grid = table(_NODES).reshape(CELLS + 1, CELLS + 1, -1)
    if not (grid[..., 2] >= NEAREST_DEPTH).all():
        return None
    places3 = grid[..., :3]
    around = _around(places3)
    size = np.ptp(places3[::SPARSELY, ::SPARSELY].reshape(-1, 3), axis=0).max()
    extended = np.ptp(around, axis=1).max(axis=1) > SAME * size
    sides = tuple(side if long else None for side, long in zip(around, extended.tolist(), strict=True))
    if not extended.all():
        s, t = s.copy(), t.copy()
        for line, end, side in ((t, 0, 0), (s, -1, 1), (t, -1, 2), (s, 0, 3)):
            if sides[side] is None:
                line[end] += POINT if end == 0 else -POINT
        lines = (grid[:, 0], s, t[0]), (grid[-1], s[-1], t), (grid[:, -1], s, t[-1]), (grid[0], s[0], t)
        for side in np.flatnonzero(~extended).tolist():
            on_line, first, second = lines[side]
            on_line[:] = table(np.stack(np.broadcast_arrays(first, second), axis=1))
    values = jacobian(grid.reshape(-1, grid.shape[2])).reshape(CELLS + 1, CELLS + 1)
    folds = folds_of(fold, (s, t), values)
    return _Patch(sheet=sheet, places=own, sides=sides, turns=_around(values), zeros=folds.zeros, lines=folds.lines)


def _around(grid: Floats) -> Floats:
    """The sides (4, CELLS + 1, …) of a grid, counter-clockwise."""
    return np.stack([grid[:, 0], grid[-1], grid[::-1, -1], grid[0, ::-1]])


def _grid(s: Floats, t: Floats) -> Floats:
    return np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2)


_SHARES = np.linspace(0, 1, CELLS + 1)
_NODES = _grid(_SHARES, _SHARES)


def jacobian(geometry: Floats) -> Floats:
    """D of rows of a surface's geometry."""
    return np.asarray(geometry[:, 3] * geometry[:, 6] - geometry[:, 4] * geometry[:, 5])


def _geometry(surveyor: Surveyor, patch: _Patch, at: Floats, numbers: Floats) -> Floats:
    return surveyor.table(patch.sheet, "geometry", at, numbers[patch.places])


def side_parameters(side: int, share: Floats) -> Floats:
    """Parameters (points, 2) at fractions of a side of the unit square, counter-clockwise."""
    zero, one = np.zeros_like(share), np.ones_like(share)
    pair = ((share, zero), (one, share), (1 - share, one), (zero, 1 - share))[side]
    return np.stack(pair, axis=1)


def _sides(
    surveyor: Surveyor, patches: list[_Patch], numbers: Floats, groups: list[tuple[list[tuple[int, int, bool]], int]]
) -> Iterator[Arc]:
    """The sides of surfaces; those that coincide are one arc, cut wherever one of its surfaces turns its other side.

    ``groups`` are these, each with the weight that flat faces have there.
    """

    def images(patch: int, number: int) -> Floats | None:
        return patches[patch].sides[number]

    loops = surveyor.figure.ends
    turns = [int(np.sign(_area_of_end(images, loop))) for loop in loops]
    ends = {
        (p, side): turn if along else -turn for turn, loop in zip(turns, loops, strict=True) for p, side, along in loop
    }
    for group, flat in groups:
        share = _cuts(patches, group)
        first, own, _ = group[0]
        weights = np.full(len(share) - 1, flat)
        for number, side, along in group:
            turn = _turned(patches[number], side, along, share) + ends.get((number, side), 0)
            weights += turn if along else -turn
        nodes, known = side_parameters(own, share), patches[first].sides[own]
        if known is None or share is not _SHARES:
            known = _geometry(surveyor, patches[first], nodes, numbers)
        points = known[:, :2]
        bounds = [0, *(np.flatnonzero(np.diff(weights)) + 1).tolist(), len(weights)]
        for begin, end in pairwise(bounds):
            weight = int(weights[begin])
            if weight:
                order = slice(begin, end + 1)
                back = 1 if weight > 0 else -1
                yield Arc(
                    sheet=patches[first].sheet,
                    places=patches[first].places,
                    fold=False,
                    straight=False,
                    weight=abs(weight),
                    nodes=nodes[order][::back],
                    points=points[order][::back],
                )


def _cuts(patches: list[_Patch], group: list[tuple[int, int, bool]]) -> Floats:
    """Where a side has its nodes: as a grid has, and where one of its surfaces turns its other side."""
    zeros = [patches[number].zeros[side] if along else 1 - patches[number].zeros[side] for number, side, along in group]
    if not any(len(each) for each in zeros):
        return _SHARES
    share = np.unique(np.concatenate([_SHARES, *zeros]))
    share = share[np.concatenate([[True], np.diff(share) > 1e-9])]
    share[-1] = 1.0
    return np.asarray(share)


def _turned(patch: _Patch, side: int, along: bool, share: Floats) -> NDArray[np.int64]:
    """The sign of D between nodes at shares of a side, or of what runs against it, from the grid's nodes around."""
    values, zeros = patch.turns[side], np.sort(patch.zeros[side])
    if share is _SHARES:
        return np.asarray(np.sign(values[:-1] + values[1:]).astype(np.int64)[:: 1 if along else -1])
    middle = (share[1:] + share[:-1]) / 2
    middle = middle if along else 1 - middle
    below = np.minimum((middle * CELLS).astype(np.int64), CELLS - 1)
    before, here, after = (np.searchsorted(zeros, each) for each in (_SHARES[below], middle, _SHARES[below + 1]))
    found = np.where(after == before, values[below] + values[below + 1], values[below + (here > before)])
    return np.asarray(np.sign(found).astype(np.int64))


def _area_of_end(images: Callable[[int, int], Floats | None], loop: tuple[tuple[int, int, bool], ...]) -> float:
    """Twice the area of a flat end, positive if it is seen counter-clockwise as its sides run; None: it is a point."""
    pieces = []
    for number, side, along in loop:
        points = images(number, side)
        if points is not None:
            pieces.append((points if along else points[::-1])[:-1, :2])
    return doubled_area(np.concatenate(pieces)) if pieces else 0.0


def _same_sides(patches: list[_Patch]) -> list[list[tuple[int, int, bool]]]:
    """Sides (patch, side, whether it runs as the first of its group does) that have the same image and depth."""
    keys = [(p, k) for p, patch in enumerate(patches) for k in range(4) if patch.sides[k] is not None]
    if not keys:
        return []
    curves = np.array([patches[p].sides[k] for p, k in keys])
    limit = SAME * np.ptp(curves[..., :2].reshape(-1, 2), axis=0).max()
    groups: list[list[tuple[int, int, bool]]] = []
    left = list(range(len(keys)))
    while left:
        first = left[0]
        rest = np.array(left)
        along = np.abs(curves[rest] - curves[first]).max(axis=(1, 2)) <= limit
        back = np.abs(curves[rest] - curves[first][::-1]).max(axis=(1, 2)) <= limit
        groups.append([(*keys[k], bool(a)) for k, a, b in zip(left, along, back, strict=True) if a or b])
        left = [k for k, a, b in zip(left, along, back, strict=True) if not (a or b)]
    return groups
