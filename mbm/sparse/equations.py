"""Assembled equations as the sparse solver sees them: their blocks, and their Jacobian piece by piece."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.forwarding import Forwarding
from mbm.equations.layout import Entry
from mbm.equations.losses import rooted_jacobian
from mbm.equations.types import Floats, Indices, Mask
from mbm.kernels.types import Backend
from mbm.sparse.arithmetic import Arithmetic
from mbm.sparse.structure import BlockFamily, Piece, Structure, structure
from mbm.values import dataclass

WIDEST = 12
"""Coordinates of an unknown that stay together in one block; those of longer vectors and arrays are blocks of one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroupPlace:
    """A group that has a piece: nonzero ``chosen[k]`` of its kernel goes to place ``target[k]`` of a row's values.

    It is of output ``lines[k]``, and is multiplied by that one's weight: ``weights`` (rows, outputs), zero for
    residuals that are left out. Outputs that are whitened by ``matrices`` (their places, and (rows, k, k)) have the
    weight 1. ``kept`` (rows, width) is 0 for columns of fixed coordinates; None where none are. Where corrections of
    measured values are eliminated, ``system`` has those rows of the group that count, and weights and matrices are of
    these rows alone; else it is None.
    """

    group: Group
    piece: Piece
    chosen: Indices
    target: Indices
    lines: Indices
    weights: Floats
    matrices: tuple[tuple[slice, Floats], ...]
    kept: Floats | None
    system: int | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocked(Forwarding):
    """``equations`` with all residuals in place: those that are left out are zero (protocol ``BlockEquations``).

    ``count`` and ``jacobian`` are of those alone that count. The constraints, to which ``limits`` belong, stand behind
    the residuals in the structure, and are zero.
    """

    equations: Assembled
    found: Structure
    places: tuple[GroupPlace, ...]
    limits: tuple[GroupPlace, ...] = ()

    @property
    def lower(self) -> Floats:
        """Hard lower bounds (n,)."""
        return self.equations.lower

    @property
    def upper(self) -> Floats:
        """Hard upper bounds (n,)."""
        return self.equations.upper

    @property
    def linear(self) -> bool:
        """The residuals are affine."""
        return self.equations.linear

    @property
    def backend(self) -> Backend | None:
        """What evaluates the kernels."""
        return self.equations.backend

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals with losses (all,), zero where left out."""
        found, rows = self.equations.residuals(x), self.found.rows
        if rows is None:
            return found
        result = np.zeros(self.found.count)
        result[rows] = found
        return result

    def structure(self) -> Structure:
        """Which blocks there are."""
        return self.found

    def block_jacobian(self, x: Floats, arithmetic: Arithmetic) -> list[Floats]:
        """The whitened Jacobian with losses, for each piece (rows, outputs, width)."""
        return [self._piece(place, x, arithmetic, plain=False) for place in self.places] + self._nothing()

    def plain_block_jacobian(self, x: Floats, arithmetic: Arithmetic) -> list[Floats]:
        """The same without losses."""
        return [self._piece(place, x, arithmetic, plain=True) for place in self.places] + self._nothing()

    def _nothing(self) -> list[Floats]:
        """Zeros for the pieces of constraints."""
        pieces = [place.piece for place in self.limits]
        return [np.zeros((piece.rows, piece.outputs, piece.width)) for piece in pieces]

    def penalties(self, x: Floats, weight: Floats, arithmetic: Arithmetic) -> list[Floats]:
        """The Jacobian of the constraints (k,), each times its ``weight`` (k,), for each piece that ``limits`` have."""
        first = self.equations.whole
        return [
            self._piece(place, x, arithmetic, plain=True)
            * weight[slice(place.piece.first - first, place.piece.residuals.stop - first)].reshape(
                place.piece.rows, place.piece.outputs, 1
            )
            for place in self.limits
        ]

    def _piece(self, place: GroupPlace, x: Floats, arithmetic: Arithmetic, *, plain: bool) -> Floats:
        group, factors = place.group, self.equations.factors
        effective = self._effective(place, x, arithmetic)
        values, result = _slopes(place, group, x, arithmetic) if effective is None else effective
        if place.kept is not None:
            result *= place.kept[:, None, :]
        if group.losses and not plain:
            residuals = group.whitened(values) if effective is None else values
            if factors is not None:
                residuals = residuals / factors[place.piece.residuals].reshape(residuals.shape)
            for whitener, loss in zip(group.whiteners, group.losses, strict=True):
                own = slice(whitener.first, whitener.last)
                result[:, own] = rooted_jacobian(loss, residuals[:, own], result[:, own])
        return result

    def _effective(self, place: GroupPlace, x: Floats, arithmetic: Arithmetic) -> tuple[Floats, Floats] | None:
        """Whitened residuals of a group whose corrections are eliminated, without noise factors, and its Jacobian.

        None: it has no corrections.
        """
        if place.system is None or self.equations.implicit is None:
            return None
        found = self.equations.implicit.corrected_rows(place.system, x)
        slopes = found.root.apply(_slopes(place, found.group, x, arithmetic)[1])
        if self.equations.factors is not None:
            factors = self.equations.factors[place.piece.residuals].reshape(place.piece.rows, -1)
            slopes /= factors[found.rows, :, None]
        return _among(place.piece.rows, found.rows, found.residuals), _among(place.piece.rows, found.rows, slopes)


def _slopes(place: GroupPlace, group: Group, x: Floats, arithmetic: Arithmetic) -> tuple[Floats, Floats]:
    """The values of the rows of ``group``, and their Jacobian times the weights of ``place``."""
    outputs = group.kernel.outputs
    result = np.zeros((group.rows, outputs, place.piece.width))
    values = np.empty((group.rows, outputs))
    arithmetic.put_jacobian(group, x, place.weights, (place.chosen, place.target, place.lines), values, result)
    for own, matrices in place.matrices:
        result[:, own] = np.matmul(matrices, result[:, own])
    return values, result


def _among(count: int, rows: Indices, part: Floats) -> Floats:
    """What some of ``count`` rows have, zero in the others."""
    if len(rows) == count:
        return part
    result = np.zeros((count, *part.shape[1:]))
    result[rows] = part
    return result


def blocked(equations: Assembled) -> Blocked:
    """The blocks of equations: a family for each unknown that is not wholly fixed, a piece for each group."""
    layout = equations.layout
    free = np.zeros(len(layout.number), dtype=bool)
    free[equations.free] = True
    families: list[BlockFamily] = []
    number: dict[str, int] = {}
    column = np.full(len(free), -1, dtype=np.int64)
    reached = 0
    for entry in layout.entries:
        if not free[entry.coordinates].any():
            continue
        number[entry.unknown.name] = len(families)
        total = entry.members * entry.unknown.freedom
        size = _block_size(entry)
        families.append(BlockFamily(first=reached, members=total // size, size=size))
        column[entry.coordinates] = reached + np.arange(total)
        reached += total
    places = tuple(_places(equations, equations.groups, 0, number, free))
    limits = tuple(_places(equations, equations.constraints, equations.whole, number, free))
    pieces = [place.piece for place in (*places, *limits)]
    count, rows = equations.whole + len(equations.equality), equations.rows
    if limits and rows is None:
        rows = np.arange(equations.whole)
    found = structure(families, pieces, column[equations.free], count, rows)
    return Blocked(equations=equations, found=found, places=places, limits=limits)


def _block_size(entry: Entry) -> int:
    freedom = entry.unknown.freedom
    return freedom if freedom <= WIDEST else 1


def _places(
    equations: Assembled, groups: Iterable[Group], first: int, number: dict[str, int], free: Mask
) -> Iterator[GroupPlace]:
    """The pieces of groups whose values begin at ``first``; those that touch nothing that is free have none."""
    for group in groups:
        corrected = equations.implicit is not None and group.kernel.corrections is not None
        system = equations.implicit.system_of(group) if equations.implicit is not None and corrected else None
        if not group.rows or (corrected and system is None):
            continue
        found = _place(equations, group, first, number, free, system)
        if found is not None:
            yield found


def _place(
    equations: Assembled, group: Group, begin: int, number: dict[str, int], free: Mask, system: int | None
) -> GroupPlace | None:
    """The piece of a group: its tangents by member of a family; None where it touches nothing that is free."""
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
        size = _block_size(entry)
        block, component = divmod(slot.component, size)
        key = (slot.unknown, slot.member, block)
        if key not in local:
            local[key] = len(starts)
            starts.append(width)
            families.append(number[slot.unknown])
            first = group.columns[:, j] - entry.first - component
            members.append(first // size)
            kept.append(free[entry.first + first[:, None] + np.arange(size)])
            width += size
        place[j] = starts[local[key]] + component
    if not starts:
        return None
    columns = place[group.kernel.jacobian_columns]
    chosen = np.flatnonzero(columns >= 0)
    piece = Piece(
        first=begin + group.first,
        outputs=group.kernel.outputs,
        families=tuple(families),
        members=np.array(members),
        starts=tuple(starts),
        width=width,
    )
    mask = np.concatenate(kept, axis=1)
    lines = group.kernel.jacobian_rows[chosen]
    weights, matrices = _weights(equations, group, piece, system)
    return GroupPlace(
        group=group,
        piece=piece,
        chosen=chosen,
        target=lines * width + columns[chosen],
        lines=lines,
        weights=weights,
        matrices=matrices,
        kept=None if mask.all() else mask.astype(np.float64),
        system=system,
    )


def _weights(
    equations: Assembled, group: Group, piece: Piece, system: int | None
) -> tuple[Floats, tuple[tuple[slice, Floats], ...]]:
    """What multiplies each output (rows, outputs), and the matrices that whiten some outputs together."""
    if system is not None and equations.implicit is not None:
        group = equations.implicit.systems[system].parts[0].group
    weights = np.ones((group.rows, group.kernel.outputs))
    if piece.first >= equations.whole:  # constraints
        return weights, ()
    if system is None and equations.factors is not None:
        weights /= equations.factors[piece.residuals].reshape(weights.shape)
    if system is None and equations.rows is not None:
        counted = np.zeros(equations.whole)
        counted[equations.rows] = 1.0
        weights *= counted[piece.residuals].reshape(weights.shape)
    matrices = []
    for whitener in group.whiteners:
        own = slice(whitener.first, whitener.last)
        if whitener.weights.ndim == 2:
            weights[:, own] *= whitener.weights
        else:
            matrices.append((own, whitener.weights * weights[:, own, None]))
            weights[:, own] = 1.0
    return weights, tuple(matrices)
