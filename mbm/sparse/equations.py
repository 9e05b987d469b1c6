"""Assembled equations as the sparse solver sees them: their blocks, and their Jacobian piece by piece."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.losses import rooted_jacobian
from mbm.equations.metric import Forwarding
from mbm.equations.types import Floats, Indices
from mbm.kernels.types import Backend
from mbm.sparse.arithmetic import Arithmetic
from mbm.sparse.groups import GroupPlace, SystemPlace, Unknowns, block_size, group_place, system_place
from mbm.sparse.structure import BlockFamily, Structure, structure
from mbm.values import dataclass


class ForwardingBlocks(Forwarding):
    """A base of equations whose Jacobian is made block by block: what they have besides is that of ``equations``."""

    __slots__ = ()

    if TYPE_CHECKING:
        equations: Assembled | Blocked

    @property
    def lower(self) -> Floats:
        """Hard lower bounds (n,)."""
        return self.equations.lower

    @property
    def upper(self) -> Floats:
        """Hard upper bounds (n,)."""
        return self.equations.upper

    @property
    def backend(self) -> Backend | None:
        """What evaluates the kernels."""
        return self.equations.backend

    @property
    def floored(self) -> bool:
        """Some combination of residuals has hardly any noise beside others."""
        return self.equations.floored


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocked(ForwardingBlocks):
    """``equations`` with residuals piece by piece: those that are left out are zero (protocol ``BlockEquations``).

    ``count`` and ``jacobian`` are of those alone that count. First come the groups of equations, then the systems with
    errors in measured columns. The constraints, to which ``limits`` belong, stand behind the residuals in the
    structure, and are zero.
    """

    equations: Assembled
    found: Structure
    places: tuple[GroupPlace | SystemPlace, ...]
    limits: tuple[GroupPlace, ...] = ()

    @property
    def linear(self) -> bool:
        """The residuals are affine."""
        return self.equations.linear

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
        return [
            self._piece(place, x, arithmetic, plain=True)
            * weight[place.group.first : place.group.first + place.group.count].reshape(
                place.piece.rows, place.piece.outputs, 1
            )
            for place in self.limits
        ]

    def _piece(self, place: GroupPlace | SystemPlace, x: Floats, arithmetic: Arithmetic, *, plain: bool) -> Floats:
        if isinstance(place, SystemPlace):
            return self._of_system(place, x, arithmetic, plain=plain)
        group, factors = place.group, self.equations.factors
        values, result = _slopes(place, group, x, arithmetic)
        if group.losses and not plain:
            residuals = group.whitened(values)
            if factors is not None:
                residuals /= factors[group.first : group.first + group.count].reshape(residuals.shape)
            result = _with_losses(group, residuals, result)
        return result

    def _of_system(self, place: SystemPlace, x: Floats, arithmetic: Arithmetic, *, plain: bool) -> Floats:
        """The Jacobian of what corrections have left of a system, as the values of its piece."""
        if self.equations.implicit is None:
            raise TypeError(place.number)
        system, width = place.system, place.piece.width
        found = self.equations.implicit.components(place.number, x)
        result = np.zeros((system.noisy.size, width))
        for part in place.parts:
            part.add(_slopes(part.place, found.groups[part.number], x, arithmetic)[1], result)
        result = found.root.apply(result.reshape(*system.noisy.shape, width))
        residuals = found.residuals
        if self.equations.factors is not None:
            factors = self.equations.factors[system.residuals]
            result, residuals = result / factors[:, :, None], residuals / factors
        flat = result.reshape(-1, width)
        for part in () if plain else place.parts:
            lines, group = part.equations, part.place.group
            if group.losses:
                flat[lines] = _with_losses(group, residuals.reshape(-1)[lines], flat[lines])
        return place.in_rows(result)


def _with_losses(group: Group, residuals: Floats, slopes: Floats) -> Floats:
    """The Jacobian (rows, outputs, width) of residuals (rows, outputs) in square-root form."""
    result = slopes.copy()
    for whitener, loss in zip(group.whiteners, group.losses, strict=True):
        own = slice(whitener.first, whitener.last)
        result[:, own] = rooted_jacobian(loss, residuals[:, own], slopes[:, own])
    return result


def _slopes(place: GroupPlace, group: Group, x: Floats, arithmetic: Arithmetic) -> tuple[Floats, Floats]:
    """The values of the rows of ``group``, and their Jacobian times the weights of ``place``, 0 by what is fixed."""
    outputs = group.kernel.outputs
    result = np.zeros((group.rows, outputs, place.piece.width))
    values = np.empty((group.rows, outputs))
    arithmetic.put_jacobian(group, x, place.weights, (place.chosen, place.target, place.lines), values, result)
    for own, matrices in place.matrices:
        result[:, own] = np.matmul(matrices, result[:, own])
    if place.kept is not None:
        result *= place.kept[:, None, :]
    return values, result


def blocked(equations: Assembled) -> Blocked:
    """The blocks of equations: a family for each unknown that is not wholly fixed, a piece for each group or system."""
    layout = equations.layout
    free = equations.is_free
    families: list[BlockFamily] = []
    number: dict[str, int] = {}
    column = np.full(len(free), -1, dtype=np.int64)
    reached = 0
    for entry in layout.entries:
        if not free[entry.coordinates].any():
            continue
        number[entry.unknown.name] = len(families)
        total = entry.members * entry.unknown.freedom
        size = block_size(entry)
        families.append(BlockFamily(first=reached, members=total // size, size=size))
        column[entry.coordinates] = reached + np.arange(total)
        reached += total
    unknowns = Unknowns(families=tuple(families), number=number, free=free)
    found = tuple(_places(equations, unknowns))
    places = tuple(place for _, place in found if place is not None)
    order = np.concatenate([np.zeros(0, dtype=np.int64), *(residuals for residuals, _ in found)])
    counted = np.flatnonzero(order >= 0)
    limits = tuple(
        place
        for group in equations.constraints
        if group.rows and (place := group_place(equations, group, len(order) + group.first, unknowns)) is not None
    )
    rows = np.full(equations.whole, -1, dtype=np.int64)
    rows[order[counted]] = counted
    rows = rows if equations.rows is None else rows[equations.rows]
    whole = not limits and np.array_equal(rows, np.arange(len(order)))
    layout_of = structure(
        families,
        [place.piece for place in (*places, *limits)],
        column[equations.free],
        len(order) + len(equations.equality),
        None if whole else rows,
    )
    return Blocked(equations=equations, found=layout_of, places=places, limits=limits)


def _places(equations: Assembled, unknowns: Unknowns) -> Iterator[tuple[Indices, GroupPlace | SystemPlace | None]]:
    """Which residuals stand next (-1: none), of a group or of a system, and their piece.

    The piece is None where nothing free is touched.
    """
    first = 0
    for group in equations.groups:
        if group.rows and not equations.eliminated(group):
            yield np.arange(group.first, group.first + group.count), group_place(equations, group, first, unknowns)
            first += group.count
    for number, system in enumerate(() if equations.implicit is None else equations.implicit.systems):
        place = system_place(equations, number, system, first, unknowns)
        order = system.residuals.reshape(-1) if place is None else place.order
        yield order, place
        first += len(order)
