"""Groups of equations and systems of corrections → pieces: which blocks of unknowns each row or component touches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.corrections.system import System
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask
from mbm.sparse.structure import BlockFamily, Piece, distinct
from mbm.values import dataclass

Number = TypeVar("Number", np.float64, np.int64)

WIDEST = 12
"""Coordinates of an unknown that stay together in one block; those of longer vectors and arrays are blocks of one."""

TOGETHER = 6
"""Equations of a component that stand in one row of its piece; more of them take several rows. Products of rows are
compiled for their number of equations, and the sizes of components are as various as data are."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unknowns:
    """The families of blocks, the ``number`` of each unknown's, and which coordinates are ``free`` (M,)."""

    families: tuple[BlockFamily, ...]
    number: Mapping[str, int]
    free: Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroupPlace:
    """A group that has a piece: nonzero ``chosen[k]`` of its kernel goes to place ``target[k]`` of a row's values.

    It is of output ``lines[k]``, and is multiplied by that one's weight: ``weights`` (rows, outputs), zero for
    residuals that are left out. Outputs that are whitened by ``matrices`` (their places, and (rows, k, k)) have the
    weight 1. ``kept`` (rows, width) is 0 for columns of fixed coordinates; None where none are.
    """

    group: Group
    piece: Piece
    chosen: Indices
    target: Indices
    lines: Indices
    weights: Floats
    matrices: tuple[tuple[slice, Floats], ...]
    kept: Floats | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartPlace:
    """Part ``number`` of a system: ``place`` has its rows as if they stood alone.

    ``equations`` (rows, outputs) are among all of the system, and local block b of row r begins at column
    ``columns[b, r]`` of the values of its component.
    """

    number: int
    place: GroupPlace
    equations: Indices
    columns: Indices

    def add(self, slopes: Floats, target: Floats) -> None:
        """Add the Jacobian of the rows (rows, outputs, own width) to that of all equations (R·k, width)."""
        piece = self.place.piece
        lines = self.equations[:, :, None]
        for begin, end, columns in zip(piece.starts, (*piece.starts[1:], piece.width), self.columns, strict=True):
            target[lines, columns[:, None, None] + np.arange(end - begin)] += slopes[:, :, begin:end]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SystemPlace:
    """System ``number``, which has a piece: each of its components takes ``lines`` rows of that, one after the other.

    The last of them may have more equations than the component has left; those are zero. Parts that touch nothing free
    are left out.
    """

    number: int
    system: System
    piece: Piece
    lines: int
    parts: tuple[PartPlace, ...]

    @property
    def order(self) -> Indices:
        """Which of all residuals stands at each of the piece's; -1: none."""
        return self._filled_up(self.system.residuals, -1).reshape(-1)

    def in_rows(self, slopes: Floats) -> Floats:
        """The Jacobian of all components (R, k, width) as the values of the piece."""
        return self._filled_up(slopes, 0).reshape(self.piece.rows, self.piece.outputs, self.piece.width)

    def _filled_up(self, of_components: NDArray[Number], value: int) -> NDArray[Number]:
        missing = self.lines * self.piece.outputs - of_components.shape[1]
        if not missing:
            return of_components
        return np.pad(of_components, ((0, 0), (0, missing), (0, 0))[: of_components.ndim], constant_values=value)


def block_size(entry: Entry) -> int:
    """Coordinates in each block of an unknown."""
    freedom = entry.unknown.freedom
    return freedom if freedom <= WIDEST else 1


def group_place(equations: Assembled, group: Group, first: int, unknowns: Unknowns) -> GroupPlace | None:
    """The piece of a group from residual ``first`` on: its tangents by member of a family.

    None where it touches nothing that is free. A group that is part of a system has its rows that count.
    """
    number, free = unknowns.number, unknowns.free
    local: dict[tuple[object, ...], int] = {}
    starts: list[int] = []
    families: list[int] = []
    members: list[Indices] = []
    kept: list[Mask] = []
    place = np.full(len(group.kernel.tangents), -1, dtype=np.int64)
    width = 0
    for j, slot in enumerate(group.kernel.tangents):
        if slot.unknown not in number:
            continue
        entry = equations.layout.entry(slot.unknown)
        size = block_size(entry)
        block, component = divmod(slot.component, size)
        key = (slot.unknown, slot.member, block)
        if key not in local:
            local[key] = len(starts)
            starts.append(width)
            families.append(number[slot.unknown])
            begin = group.columns[:, j] - entry.first - component
            members.append(begin // size)
            kept.append(free[entry.first + begin[:, None] + np.arange(size)])
            width += size
        place[j] = starts[local[key]] + component
    if not starts:
        return None
    columns = place[group.kernel.jacobian_columns]
    chosen = np.flatnonzero(columns >= 0)
    piece = Piece(
        first=first,
        outputs=group.kernel.outputs,
        families=tuple(families),
        members=np.array(members),
        starts=tuple(starts),
        width=width,
    )
    mask = np.concatenate(kept, axis=1)
    lines = group.kernel.jacobian_rows[chosen]
    weights, matrices = _weights(equations, group)
    return GroupPlace(
        group=group,
        piece=piece,
        chosen=chosen,
        target=lines * width + columns[chosen],
        lines=lines,
        weights=weights,
        matrices=matrices,
        kept=None if mask.all() else mask.astype(np.float64),
    )


def _weights(equations: Assembled, group: Group) -> tuple[Floats, tuple[tuple[slice, Floats], ...]]:
    """What multiplies each output (rows, outputs), and the matrices that whiten some outputs together.

    Noise factors of systems divide what corrections have left, and constraints have none.
    """
    weights = np.ones((group.rows, group.kernel.outputs))
    if group.whiteners and not equations.eliminated(group):
        own = slice(group.first, group.first + group.count)
        if equations.factors is not None:
            weights /= equations.factors[own].reshape(weights.shape)
        if equations.rows is not None:
            counted = np.zeros(equations.whole)
            counted[equations.rows] = 1.0
            weights *= counted[own].reshape(weights.shape)
    matrices = []
    for whitener in group.whiteners:
        own = slice(whitener.first, whitener.last)
        if whitener.weights.ndim == 2:
            weights[:, own] *= whitener.weights
        else:
            matrices.append((own, whitener.weights * weights[:, own, None]))
            weights[:, own] = 1.0
    return weights, tuple(matrices)


def system_place(
    equations: Assembled, number: int, system: System, first: int, unknowns: Unknowns
) -> SystemPlace | None:
    """The piece of a system from residual ``first`` on; None where it touches nothing that is free.

    A component touches the blocks that its rows touch. Where it touches fewer members of a family than others do, the
    first of them is repeated, with zeros.
    """
    count, k = system.noisy.shape
    lines = -(-k // TOGETHER)
    losses = {group.first: group.losses for group in equations.groups if group.rows}
    groups = [replace(part.group, losses=losses[part.group.first]) for part in system.parts]
    found = [(i, group_place(equations, group, 0, unknowns)) for i, group in enumerate(groups)]
    places = [(i, place) for i, place in found if place is not None]
    if not places:
        return None
    kinds, most = len(unknowns.families), 1 + max(int(place.piece.members.max(initial=0)) for _, place in places)
    codes = []
    for i, place in places:
        component = system.parts[i].equations[:, 0] // k
        codes.append((component * kinds + np.array(place.piece.families)[:, None]) * most + place.piece.members)
    every = distinct(np.concatenate([each.ravel() for each in codes]))
    (component, family), member = np.divmod(every // most, kinds), every % most
    firsts = np.flatnonzero(np.diff(every // most, prepend=-1))
    rank = np.arange(len(every)) - np.repeat(firsts, np.diff(firsts, append=len(every)))
    depth = np.zeros(kinds, dtype=np.int64)
    np.maximum.at(depth, family, rank + 1)
    families = np.repeat(np.arange(kinds), depth)
    block = (np.cumsum(depth) - depth)[family] + rank
    members = np.zeros((kinds, count), dtype=np.int64)
    members[family[firsts], component[firsts]] = member[firsts]
    members = members[families]
    members[block, component] = member
    sizes = np.array([unknowns.families[f].size for f in families])
    starts = np.cumsum(sizes) - sizes
    return SystemPlace(
        number=number,
        system=system,
        piece=Piece(
            first=first,
            outputs=-(-k // lines),
            families=tuple(families.tolist()),
            members=np.repeat(members, lines, axis=1),
            starts=tuple(starts.tolist()),
            width=int(sizes.sum()),
        ),
        lines=lines,
        parts=tuple(
            PartPlace(
                number=i,
                place=place,
                equations=system.parts[i].equations,
                columns=starts[block[np.searchsorted(every, each)]],
            )
            for (i, place), each in zip(places, codes, strict=True)
        ),
    )
