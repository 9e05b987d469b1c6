"""The rows of some solves, and where their residuals stand: those of one, or of many side by side."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.binding import ALL, Group
from mbm.equations.likelihoods import Readings, larger, untested
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.problem.likelihoods.types import SHIFT
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.losses import Acting, LossFunction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lines:
    """The rows of one group that K solves have.

    ``solve`` (R,) of each row, ascending, ``slots`` (R, outputs) among the residuals of its solve, of which ``kept``
    (R, outputs) count, and its ``place`` (R,) in the group; ``whiteners`` are those of these rows. ``block`` is where
    the residuals stand in each solve, if they do so equally in all of them.
    """

    group: Group
    solve: Indices
    slots: Indices
    kept: Mask
    place: Indices | slice
    whiteners: tuple[Whitener, ...]
    block: slice | None = None

    @property
    def positions(self) -> Indices | None:
        """The places (R,) of the rows in their table; None without one."""
        return None if self.group.positions is None else np.asarray(self.group.positions[self.place])

    def summed(self, values: Floats | Mask) -> Floats:
        """Sums (K,) of numbers (K, m) over the residuals of each solve."""
        if self.block is not None:
            return np.asarray(values[:, self.block].sum(axis=1, dtype=np.float64))
        rows = values[self.solve[:, None], self.slots].sum(axis=1, dtype=np.float64)
        return np.asarray(np.bincount(self.solve, rows, len(values)), dtype=np.float64)

    def put(self, values: NDArray[Any], target: NDArray[Any]) -> None:
        """Put what the rows have (R, outputs, …) among the numbers (K, m, …) of the residuals of their solves."""
        if self.block is None:
            target[self.solve[:, None], self.slots] = values
        else:
            target[:, self.block] = values.reshape(target[:, self.block].shape)


class Solves:
    """The rows of K solves, ``lines`` group by group; ``size`` are K and m, the largest number of residuals of a solve.

    What a solve has less is 0. ``consensus``: some may be left out. ``factors`` (K, m) multiply the noise that the
    whiteners have (None: 1).
    """

    lines: tuple[Lines, ...]

    def __init__(
        self,
        equations: Assembled,
        lines: tuple[Lines, ...],
        size: tuple[int, int],
        *,
        consensus: bool,
        factors: Floats | None = None,
    ) -> None:
        self.equations = equations
        self.lines = lines
        self.count, self.most = size
        self.consensus = consensus
        self.factors = factors

    def block_slots(self, owner: int) -> tuple[Indices, Indices]:
        """Solve (P,) and place (P,) of the residuals of a block that count."""
        mine = [each for each in self.lines if each.group.kernel.owner == owner]
        solves = [np.repeat(each.solve, each.slots.shape[1])[each.kept.ravel()] for each in mine]
        slots = [each.slots[each.kept] for each in mine]
        none = np.zeros(0, dtype=np.int64)
        return np.concatenate([none, *solves]), np.concatenate([none, *slots])

    def of_blocks(self, owners: Sequence[int], *, counting: bool = False) -> Mask:
        """Which residuals (K, m) are those of some blocks, and were not left out; ``counting`` as parts of χ²."""
        result = np.zeros((self.count, self.most), dtype=bool)
        for each in self.lines:
            if each.group.kernel.owner in owners:
                each.put(each.kept & each.group.counting if counting else each.kept, result)
        return result

    def kept(self) -> Mask:
        """Which residuals (K, m) are there, and were not left out."""
        return self.of_blocks([each.group.kernel.owner for each in self.lines])

    def by_slot(self, values: Sequence[NDArray[Any] | None], missing: float = 1.0) -> NDArray[Any]:
        """Numbers (K, m) of the residuals, from those (R, outputs) of the rows of each group (None: ``missing``)."""
        result = np.full((self.count, self.most), missing)
        for each, own in zip(self.lines, values, strict=True):
            if own is not None:
                each.put(np.broadcast_to(own, each.slots.shape), result)
        return result

    def deviations(self) -> Floats:
        """The standard deviations (K, m) of independent components; 1 where a row has a matrix instead."""
        found = self.by_slot([_deviations(each.whiteners) for each in self.lines])
        return found if self.factors is None else found * self.factors

    def acting(self) -> Iterator[Acting]:
        """Each loss with the places of the residuals of its units."""
        return ((loss, (solve[:, None], slots)) for loss, solve, slots in self.losses())

    def losses(self) -> Iterator[tuple[LossFunction, Indices, Indices]]:
        """Each loss, with solve (U,) and places (U, k) of the residuals of its units."""
        for each in self.lines:
            for whitener, loss in zip(each.whiteners, each.group.losses, strict=False):
                yield loss, each.solve, each.slots[:, whitener.first : whitener.last]


def likely(groups: Sequence[Group]) -> Iterator[tuple[Group, Readings]]:
    """The groups with a likelihood."""
    return ((group, group.readings) for group in groups if group.readings is not None)


def alone(equations: Assembled) -> Solves:
    """One solve."""
    kept = equations.rows is None or np.isin(np.arange(equations.whole), equations.rows)
    lines = lines_of(equations.groups, np.broadcast_to(kept, equations.whole))
    factors = None if equations.factors is None else equations.factors[None]
    return Solves(equations, lines, (1, equations.whole), consensus=equations.rows is not None, factors=factors)


def lines_of(groups: Sequence[Group], kept: Mask) -> tuple[Lines, ...]:
    """The rows of the groups of one solve, of whose residuals those ``kept`` (m,) count."""
    places = [group.first + np.arange(group.count).reshape(group.rows, group.kernel.outputs) for group in groups]
    return tuple(
        Lines(
            group=group,
            solve=np.zeros(group.rows, dtype=np.int64),
            slots=slots,
            kept=kept[slots],
            place=ALL,
            whiteners=group.whiteners,
            block=slice(group.first, group.first + group.count),
        )
        for group, slots in zip(groups, places, strict=True)
    )


def mean_roots(lines: Iterable[Lines], residuals: Floats, counting: Mask, blocks: int) -> Floats:
    """Root mean squares (K, blocks) of the residuals (K, m) of each block that are ``counting``; NaN without any."""
    squares, found = np.where(counting, np.square(residuals), 0.0), np.zeros((2, len(residuals), blocks))
    for each in lines:
        found[:, :, each.group.kernel.owner] += each.summed(squares), each.summed(counting)
    return np.asarray(np.sqrt(found[0] / found[1]))


def used_rows(lines: Iterable[Lines], counting: Mask, blocks: int) -> Indices:
    """How many rows (K, blocks) of each block have a residual that is ``counting`` (K, m)."""
    used = np.zeros((len(counting), blocks), dtype=np.int64)
    for each in lines:
        mine = each.solve[counting[each.solve[:, None], each.slots].any(axis=1)]
        used[:, each.group.kernel.owner] += np.bincount(mine, minlength=len(used))
    return used


@np.errstate(divide="ignore")
def _deviations(whiteners: tuple[Whitener, ...]) -> Floats | None:
    """Those (R, outputs) of the rows of a group; None where some equation has none."""
    if not whiteners or any(each.weights.ndim != 2 for each in whiteners):
        return None
    return np.concatenate([1.0 / each.weights for each in whiteners], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What K solves count: χ² and the number of its residuals, log L (None: no likelihood), whether χ² is none, by
    what factor it is `larger`, how many rows with an unknown scale are ``limits``, and the squares of residuals that
    are ``uncounted``.
    """

    cost: Floats
    rows: Indices
    log_likelihood: Floats | None
    untested: Mask
    larger: Floats
    limits: Floats
    uncounted: Floats

    def tested(self, scattered: Floats) -> Floats:
        """What stands against χ² (K,): ``scattered`` where there is no likelihood."""
        return scattered if self.log_likelihood is None else self.cost


def counted_of(solves: Solves, residuals: Floats, rows: Indices) -> Counted:
    """What solves count of their ``residuals`` (K, m), of which they have so many ``rows`` (K,)."""
    squares = np.square(residuals)
    whole, none = squares.sum(axis=1), np.zeros(solves.count, dtype=bool)
    zeros, ones = np.zeros(solves.count), np.ones(solves.count)
    if not solves.equations.likely:
        return Counted(
            cost=whole, rows=rows, log_likelihood=None, untested=none, larger=ones, limits=zeros, uncounted=zeros
        )
    surprise, excess, lines, limits, cost = (zeros.copy() for _ in range(5))

    def add(target: Floats, each: Lines, values: Floats) -> None:
        target += np.bincount(each.solve, weights=values, minlength=solves.count)

    for each in solves.lines:
        group, stated, count = each.group, each.group.readings, np.bincount(each.solve, minlength=solves.count)
        add(cost, each, squares[each.solve[:, None], each.slots[:, group.counting]].sum(axis=1))
        if stated is None:
            roots = np.hstack([_roots(w.weights[each.place]) for w in group.whiteners])
            add(surprise, each, (0.5 * np.log(2.0 * np.pi) - np.log(roots)).sum(axis=1))
            continue
        rows = rows - count * int(stated.uncounted.sum())
        add(surprise, each, stated.surprise[each.place] - 0.5 * SHIFT * int(stated.shifted.sum()))
        add(excess, each, stated.excess[each.place])
        lines += count
        if stated.scales:
            add(limits, each, stated.limits[each.place].astype(np.float64))
    if solves.factors is not None:
        surprise += np.log(solves.factors).sum(axis=1)
    none = untested(excess, lines)
    return Counted(
        cost=cost,
        rows=rows,
        log_likelihood=-0.5 * whole - surprise,
        untested=none,
        larger=np.where(none, larger(excess, lines), 1.0),
        limits=limits,
        uncounted=whole - cost,
    )


def _roots(weights: Floats) -> Floats:
    """The diagonal (R, k) of weights."""
    return np.abs(weights if weights.ndim == 2 else np.diagonal(weights, axis1=1, axis2=2))
