"""The outline of a figure: smooth pieces end to end, each along a line of a sheet or along a fold of it.

Points are found on the surfaces themselves, never on chords; a piece is (arc, from, to) in chords of the arc.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from enum import Enum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.outlines.arcs import NEAREST_DEPTH, Arc, arcs_of, jacobian
from mbm.kernels.outlines.region import rings_of
from mbm.kernels.outlines.surveyor import Surveyor
from mbm.kernels.types import Floats
from mbm.values import dataclass

Indices = NDArray[np.int64]
Selected: TypeAlias = NDArray[np.bool_] | slice

PARALLEL = 1e-6
"""Sine of the angle below which two pieces go on into each other without a corner."""

TURN = 0.5
"""Angle in rad; six Gauss points of such a span leave some 1e-10 of its length."""

_FOLD_STEPS, _CROSSING_STEPS, _HALVINGS = 4, 6, 16

_SETTLED = 1e-8
"""Step towards a crossing, in chords, after which what is left is a rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spots:
    """Points on arcs: parameters ``at`` (n, 2), images ``x`` (n, 2) and derivatives ``way`` (n, 2) by the chord."""

    arc: Indices
    at: Floats
    x: Floats
    way: Floats

    def normals(self) -> Floats:
        """Unit normals (n, 2) that point away from what is covered."""
        x, y = self.way.T
        length = np.hypot(x, y)
        return np.stack([y / length, -x / length], axis=1)

    def enter(self, places: Indices, others: Spots, own: Selected = slice(None)) -> None:
        """Have some spots be others: those that ``own`` picks among them."""
        self.arc[places], self.at[places] = others.arc[own], others.at[own]
        self.x[places], self.way[places] = others.x[own], others.way[own]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArcTable:
    """Arcs as columns (arcs,): their sheets, whether they are folds, or straight; chords, and where ``nodes`` begin.

    ``images`` are those of the nodes. ``places`` (arcs, most inputs) hold the places of the inputs, as many as the
    sheet has. ``net``: what they are edges of, or −1.
    """

    sheet: Indices
    fold: NDArray[np.bool_]
    straight: NDArray[np.bool_]
    chords: Indices
    begin: Indices
    nodes: Floats
    images: Floats
    places: Indices
    net: Indices


def _table(arcs: tuple[Arc, ...]) -> ArcTable:
    chords = np.array([len(arc.nodes) - 1 for arc in arcs])
    places = np.zeros((len(arcs), max(len(arc.places) for arc in arcs)), dtype=np.int64)
    for k, arc in enumerate(arcs):
        places[k, : len(arc.places)] = arc.places
    return ArcTable(
        sheet=np.array([arc.sheet for arc in arcs]),
        fold=np.array([arc.fold for arc in arcs]),
        straight=np.array([arc.straight for arc in arcs]),
        chords=chords,
        begin=np.concatenate([[0], np.cumsum(chords + 1)[:-1]]),
        nodes=np.concatenate([arc.nodes for arc in arcs]),
        images=np.concatenate([arc.points for arc in arcs]),
        places=places,
        net=np.array([arc.net for arc in arcs]),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spans:
    """Parts of pieces, each within one chord of the arc, along which the outline turns by no more than `TURN`."""

    piece: Indices
    first: Floats
    last: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outline:
    """``arc``, ``first``, ``last`` (pieces,); ``following[k]`` is the piece after piece k on its ring.

    ``numbers`` are those of the figure, with corners. Derivatives are by the figure's own, (size,).
    """

    surveyor: Surveyor = field(repr=False)
    numbers: Floats = field(repr=False)
    arcs: ArcTable = field(repr=False)
    arc: Indices
    first: Floats
    last: Floats
    following: Indices
    spans: Spans = field(repr=False)

    @property
    def size(self) -> int:
        """How many numbers the figure has."""
        return self.surveyor.figure.size

    def spots(self, arc: Indices, places: Floats) -> Spots:
        """The points at ``places`` (chord and fraction) of arcs."""
        straight = self.arcs.straight[arc]
        if straight.all():
            return self._straight(arc, places)
        at, x, way = np.empty((len(arc), 2)), np.empty((len(arc), 2)), np.empty((len(arc), 2))
        own = np.flatnonzero(straight)
        if len(own):
            found = self._straight(arc[own], places[own])
            at[own], x[own], way[own] = found.at, found.x, found.way
        number = np.minimum(places.astype(np.int64), self.arcs.chords[arc] - 1)
        first = self.arcs.begin[arc] + number
        begin = self.arcs.nodes[first]
        chords = self.arcs.nodes[first + 1] - begin
        begin += (places - number)[:, None] * chords
        for sheet, fold, own in self._bent(arc, straight):
            here, chord = begin[own], chords[own]
            inputs = self.numbers[self.places(sheet, arc[own])]
            if fold:
                here, table, slope = self._folded(sheet, here, chord, inputs)
            else:
                table, slope = self.surveyor.table(sheet, "geometry", here, inputs), chord
            at[own], x[own] = here, table[:, :2]
            way[own] = self.pushed(sheet, table, slope)
        return Spots(arc=arc, at=at, x=x, way=way)

    def _straight(self, arc: Indices, places: Floats) -> Spots:
        """Those of straight arcs, of a single chord, along which the image moves evenly."""
        nodes, images, first, share = self.arcs.nodes, self.arcs.images, self.arcs.begin[arc], places[:, None]
        begin, x = nodes[first], images[first]
        way = images[first + 1] - x
        return Spots(arc=arc, at=begin + share * (nodes[first + 1] - begin), x=x + share * way, way=way)

    def pushed(self, sheet: int, table: Floats, direction: Floats) -> Floats:
        """The image (n, 2) of a direction (n, 2) in the parameters, for rows of geometry."""
        if self.surveyor.sheets[sheet].parameters == 1:
            return table[:, 3:5] * direction[:, :1]
        return np.asarray(np.einsum("nij,nj->ni", table[:, 3:7].reshape(-1, 2, 2), direction))

    def places(self, sheet: int, arc: Indices) -> Indices:
        """The places (n, inputs) of the inputs of arcs that are all of one sheet."""
        return np.asarray(self.arcs.places[arc, : self.surveyor.sheets[sheet].inputs])

    def _bent(self, arc: Indices, straight: NDArray[np.bool_]) -> Iterator[tuple[int, bool, Indices]]:
        """The positions of the arcs of each sheet that are not ``straight``, folds apart."""
        kinds = np.where(straight, -1, (2 * self.arcs.sheet + self.arcs.fold)[arc])
        for kind in np.unique(kinds[~straight]).tolist():
            yield kind // 2, bool(kind % 2), np.flatnonzero(kinds == kind)

    def by_sheet(self, arc: Indices) -> Iterator[tuple[int, Indices]]:
        """The positions of the arcs of each sheet."""
        sheets = self.arcs.sheet[arc]
        for sheet in np.unique(sheets).tolist():
            yield sheet, np.flatnonzero(sheets == sheet)

    def _folded(self, sheet: int, at: Floats, chord: Floats, inputs: Floats) -> tuple[Floats, Floats, Floats]:
        """The points of the fold square to ``chord`` from ``at``; their geometry; and how they move along it."""
        across = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        table = self.surveyor.table(sheet, "geometry", at, inputs)
        for _ in range(_FOLD_STEPS):
            tilt = np.einsum("ij,ij->i", table[:, 7:9], across)
            step = -jacobian(table) / tilt
            longest = np.abs(step).max(initial=0.0)
            if longest < 1e-12:
                break
            at = at + step[:, None] * across
            table = self.surveyor.table(sheet, "geometry", at, inputs)
            if longest < 1e-6:  # what is left is of the order of its square
                break
        tilt = np.einsum("ij,ij->i", table[:, 7:9], across)
        drift = -np.einsum("ij,ij->i", table[:, 7:9], chord) / tilt
        return at, table, chord + drift[:, None] * across

    def motion(self, spots: Spots, weights: Floats) -> Floats:
        """Σ weight (n, 2) × derivative by the numbers (size,) over spots and coordinates, with the parameters held."""
        total = np.zeros(self.size)
        for own, places, slopes in self.velocities(spots):
            np.add.at(total, places, np.einsum("nij,ni->nj", slopes, weights[own]))
        return total

    def velocities(self, spots: Spots) -> Iterator[tuple[Indices, Indices, Floats]]:
        """Positions of spots, the places (k, m) of their inputs and derivatives (k, 2, m) by these; sheet by sheet."""
        for sheet, own in self.by_sheet(spots.arc):
            arc = spots.arc[own]
            places = self.places(sheet, arc)
            table = self.surveyor.table(sheet, "motion", spots.at[own], self.numbers[places])
            slopes, nets = table.reshape(len(own), 2, places.shape[1]), self.arcs.net[arc]
            for net in np.unique(nets).tolist() if self.surveyor.figure.nets else ():
                some = nets == net
                yield own[some], *self.surveyor.by_numbers(net, places[some], slopes[some], self.numbers)
            if not self.surveyor.figure.nets:
                yield own, places, slopes

    def spread(self, spots: Spots) -> Floats:
        """Derivatives (n, 2, size) of the spots by all numbers, with the parameters held."""
        found = np.zeros((len(spots.arc), 2, self.size))
        for own, places, slopes in self.velocities(spots):
            for k in range(2):
                np.add.at(found[:, k], (own[:, None], places), slopes[:, k])
        return found

    def ends(self) -> tuple[Spots, Spots]:
        """Where each piece begins, and where it ends."""
        return self.pairs(self.arc, self.first, self.arc, self.last)

    def pairs(self, arc: Indices, places: Floats, other: Indices, others: Floats) -> tuple[Spots, Spots]:
        """The points at places of arcs and those at ``others``, found together."""
        both, count = self.spots(np.concatenate([arc, other]), np.concatenate([places, others])), len(arc)
        first, second = (
            Spots(arc=both.arc[own], at=both.at[own], x=both.x[own], way=both.way[own])
            for own in (slice(count), slice(count, None))
        )
        return first, second

    def stations(self, order: int) -> tuple[Indices, Spots, Floats]:
        """Gauss points of all spans: their pieces, the points, and weights for the fraction of the chord."""
        pieces, places, weights = [], [], []
        for straight, count in ((True, 2), (False, order)):
            own = self.arcs.straight[self.arc[self.spans.piece]] == straight
            nodes, shares = np.polynomial.legendre.leggauss(count)
            half = (self.spans.last - self.spans.first)[own, None] / 2
            places.append((self.spans.first[own, None] + half + half * nodes).ravel())
            weights.append((half * shares).ravel())
            pieces.append(np.repeat(self.spans.piece[own], count))
        piece, place = np.concatenate(pieces), np.concatenate(places)
        order_of = np.lexsort((place, piece))
        piece, place = piece[order_of], place[order_of]
        return piece, self.spots(self.arc[piece], place), np.concatenate(weights)[order_of]


class NoOutline(Enum):
    """Why a figure has no outline."""

    NOT_FINITE = "a number that the shape or its camera is made of is not finite"
    TOO_NEAR = f"a part of the shape is nearer than {NEAREST_DEPTH:g} m or behind the camera"
    NOTHING_COVERED = "the shape covers nothing of the image: it has no size, or is a plate that is seen edge-on"


def outline_of(surveyor: Surveyor, numbers: Floats) -> Outline | NoOutline:
    """The outline for these numbers (size,), or why there is none."""
    if not np.isfinite(numbers).all():
        return NoOutline.NOT_FINITE
    numbers = surveyor.with_corners(numbers)
    arcs = arcs_of(surveyor, numbers)
    if arcs is None:
        return NoOutline.TOO_NEAR
    rings = rings_of(arcs) if arcs else []
    if not rings:
        return NoOutline.NOTHING_COVERED
    pieces = [stretch for ring in rings for stretch in ring]
    following = np.concatenate(_following([len(ring) for ring in rings]))
    drafted = Outline(
        surveyor=surveyor,
        numbers=numbers,
        arcs=_table(arcs),
        arc=np.array([stretch.arc for stretch in pieces]),
        first=np.array([stretch.first for stretch in pieces]),
        last=np.array([stretch.last for stretch in pieces]),
        following=following,
        spans=Spans(piece=np.zeros(0, dtype=np.int64), first=np.zeros(0), last=np.zeros(0)),
    )
    crossed = _crossed(drafted)
    return replace(crossed, spans=_spans(crossed))


def _spans(outline: Outline) -> Spans:
    """Chord by chord, and halved where the outline turns much: at the tips of a disk that is seen nearly edge on."""
    straight = outline.arcs.straight[outline.arc]
    whole = np.flatnonzero(straight)
    done: list[tuple[Indices, Floats, Floats]] = [(whole, outline.first[whole], outline.last[whole])]
    below = np.where(straight, outline.first, np.floor(outline.first))
    count = np.where(straight, 0, np.ceil(outline.last) - below).astype(np.int64)
    piece = np.repeat(np.arange(len(count)), count)
    number = below[piece] + np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    first, last = np.maximum(number, outline.first[piece]), np.minimum(number + 1, outline.last[piece])
    for _ in range(_HALVINGS if len(piece) else 0):
        own = outline.arc[piece]
        ways = [each.way for each in outline.pairs(own, first, own, last)]
        across = ways[0][:, 0] * ways[1][:, 1] - ways[0][:, 1] * ways[1][:, 0]
        turning = np.abs(np.arctan2(across, np.sum(ways[0] * ways[1], axis=1))) > TURN
        done.append((piece[~turning], first[~turning], last[~turning]))
        middle = (first[turning] + last[turning]) / 2
        piece = np.repeat(piece[turning], 2)
        first, last = (np.stack(each, axis=1).ravel() for each in ((first[turning], middle), (middle, last[turning])))
        if not len(piece):
            break
    piece, first, last = (np.concatenate(each) for each in zip(*done, (piece, first, last), strict=True))
    order = np.lexsort((first, piece))
    return Spans(piece=piece[order], first=first[order], last=last[order])


def _following(counts: Sequence[int]) -> list[Indices]:
    found, first = [], 0
    for count in counts:
        found.append(first + np.roll(np.arange(count), -1))
        first += count
    return found


def _crossed(drafted: Outline) -> Outline:
    """The same with the crossings of arcs where the arcs cross, no longer where their chords do.

    Where one arc begins or ends on another, its end stays; so do the ends of a piece of which the search turns the
    one past the other, as where arcs all but touch.
    """
    lengths = drafted.arcs.chords
    after = drafted.following
    first, last = drafted.first.copy(), drafted.last.copy()
    ends, begins = last == lengths[drafted.arc], first[after] == 0
    same = (drafted.arc == drafted.arc[after]) & (np.abs(last - first[after]) < 1e-6)
    own = np.flatnonzero(~(ends & begins) & ~same)
    if not len(own):
        return drafted
    other, ends, begins = after[own], ends[own], begins[own]
    for _ in range(_CROSSING_STEPS):
        ahead, back = _gaps(*drafted.pairs(drafted.arc[own], last[own], drafted.arc[other], first[other]), ends, begins)
        last[own] = np.clip(last[own] + ahead, 0, lengths[drafted.arc[own]])
        first[other] = np.clip(first[other] + back, 0, lengths[drafted.arc[other]])
        if max(np.abs(ahead).max(), np.abs(back).max()) < _SETTLED:
            break
    kept = first <= last
    return replace(drafted, first=np.where(kept, first, drafted.first), last=np.where(kept, last, drafted.last))


def _gaps(here: Spots, there: Spots, ends: NDArray[np.bool_], begins: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Steps of both places to where the tangents cross; of one alone, to what is nearest to the end of the other."""
    gap = there.x - here.x
    turn = here.way[:, 0] * there.way[:, 1] - here.way[:, 1] * there.way[:, 0]
    with np.errstate(all="ignore"):
        ahead = (gap[:, 0] * there.way[:, 1] - gap[:, 1] * there.way[:, 0]) / turn
        back = (gap[:, 0] * here.way[:, 1] - gap[:, 1] * here.way[:, 0]) / turn
        ahead = np.where(begins, np.einsum("ij,ij->i", gap, here.way) / np.sum(here.way**2, axis=1), ahead)
        back = np.where(ends, -np.einsum("ij,ij->i", gap, there.way) / np.sum(there.way**2, axis=1), back)
        sound = (np.abs(ahead) < 1) & (np.abs(back) < 1)
    return np.where(sound & ~ends, ahead, 0), np.where(sound & ~begins, back, 0)
