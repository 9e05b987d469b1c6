"""Contraction of boxes to the hull-consistent ones: forward and backward through the network until nothing changes.

Boxes come by the hundred: the intervals of a node are (boxes, rows). A box that shrinks to nothing holds no solution.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals import arithmetic as of, inverses
from mbm.estimation.intervals.arithmetic import EXTENSIONS, Floats, Interval
from mbm.estimation.intervals.network import Demand, Network, Node
from mbm.expression.nodes import Operation
from mbm.values import dataclass

NUMBERS_AT_A_TIME = 2_000_000
"""Numbers of all nodes of the boxes that are contracted together: 32 MB of intervals."""

MOST_SWEEPS = 1000
"""Sweeps of a box whose contraction goes on; slow fixed points gain nothing that bisection would not."""

FIXED = 1e-13
"""A sweep that takes less than this part of every side has reached the fixed point, as far as doubles tell."""

CALM = 2
"""Sweeps without a gain that make a fixed point: the first may have narrowed what lies between, which the next uses."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boxes:
    """Boxes (n, N) of all unknown numbers, and in each the ranges (n, Q) of the scalars of derived quantities."""

    low: Floats
    high: Floats
    derived_low: Floats
    derived_high: Floats

    def __len__(self) -> int:
        return len(self.low)

    def at(self, which: Indices | Mask) -> Boxes:
        """Some of them."""
        return Boxes(
            low=self.low[which],
            high=self.high[which],
            derived_low=self.derived_low[which],
            derived_high=self.derived_high[which],
        )


def joined(parts: list[Boxes]) -> Boxes:
    """All boxes of the ``parts``, at least one."""
    return Boxes(
        low=np.concatenate([p.low for p in parts]),
        high=np.concatenate([p.high for p in parts]),
        derived_low=np.concatenate([p.derived_low for p in parts]),
        derived_high=np.concatenate([p.derived_high for p in parts]),
    )


def extension(node: Node, arguments: tuple[Interval, ...]) -> Interval:
    """The interval of an operation from those of its arguments."""
    if node.operation is Operation.POWER:
        if node.exponent is None:
            return _any_power(*arguments)
        power = _whole(node.exponent)
        return of.real_power(arguments[0], node.exponent) if power is None else of.whole_power(arguments[0], power)
    if node.turning and node.operation is Operation.ATAN2:
        return of.turning_direction(*arguments)
    if node.turning and node.operation is Operation.WRAP:
        return arguments[0]
    if node.operation is None:
        raise TypeError(node)
    return EXTENSIONS[node.operation](*arguments)


def _whole(exponent: Interval) -> int | None:
    """An exponent that is a whole number."""
    low, high = float(exponent[0][0, 0]), float(exponent[1][0, 0])
    return int(low) if low == high and low.is_integer() and abs(low) < 2**31 else None


def _any_power(base: Interval, exponent: Interval) -> Interval:
    """A power whose exponent is no one number: nothing is said where the base may be negative."""
    low, high = of.real_power(base, exponent)
    unsure = base[0] < 0.0
    return np.where(unsure, -np.inf, low), np.where(unsure, np.inf, high)


def inverse(node: Node, value: Interval, arguments: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """What the value of an operation leaves of its arguments."""
    if node.operation is Operation.POWER:
        if node.exponent is None:
            return arguments
        power = _whole(node.exponent)
        if power is not None:
            return (inverses.whole_root(value, power, arguments[0]),)
        return (inverses.real_root(value, float(node.exponent[0][0, 0]), arguments[0]),)
    if node.operation is None or node.operation not in inverses.INVERSES:
        return arguments
    return inverses.INVERSES[node.operation](value, *arguments)


class Sweeper:
    """The intervals of all nodes for some boxes (n, N), swept in place. Local to one contraction."""

    def __init__(self, network: Network, low: Floats, high: Floats) -> None:
        self.network = network
        self.low, self.high = low, high
        self.alive = np.ones(len(low), dtype=bool)
        self.extents: list[Interval | None] = [None] * len(network.nodes)
        self._demands: dict[int, list[Demand]] = {}
        for demand in network.demands:
            self._demands.setdefault(demand.node, []).append(demand)

    def forward(self, *, demanding: bool) -> None:
        """Every node from its arguments, within what it was before, and within what is demanded of it."""
        for number, node in enumerate(self.network.nodes):
            found = self._evaluated(node)
            if node.lenient:
                none = found[0] > found[1]
                found = np.where(none, -np.inf, found[0]), np.where(none, np.inf, found[1])
            before = self.extents[number]
            if before is not None and demanding and not node.lenient and not node.turning and node.operation:
                found = of.meet(found, before)
            if demanding:
                for demand in self._demands.get(number, ()):
                    found = of.meet(found, demand.allowed)
            if not node.lenient:
                self.alive &= (found[0] <= found[1]).all(axis=1)
            self.extents[number] = found

    def _evaluated(self, node: Node) -> Interval:
        if node.known is not None:
            return node.known
        if node.places is not None:
            return self.low[:, node.places], self.high[:, node.places]
        return extension(node, tuple(self.extent(a) for a in node.arguments))

    def extent(self, number: int) -> Interval:
        """The interval of a node."""
        found = self.extents[number]
        if found is None:
            raise TypeError(number)
        return found

    def backward(self) -> None:
        """From every node that has to exist what its value leaves of its arguments, the last first."""
        active: dict[int, Mask] = {}
        for number in reversed(range(len(self.network.nodes))):
            node = self.network.nodes[number]
            if node.known is not None or (node.lenient and number not in active):
                continue
            where = active.get(number) if node.lenient else None
            if node.places is not None:
                self._to_unknowns(node, self.extent(number), where)
            elif node.operation is Operation.IF:
                self._to_branches(node, number, where, active)
            else:
                arguments = tuple(self.extent(a) for a in node.arguments)
                for argument, found in zip(node.arguments, inverse(node, self.extent(number), arguments), strict=True):
                    self._leave(argument, found, where)
                    if self.network.nodes[argument].lenient and where is not None:
                        _add(active, argument, where, self.network.nodes[argument].rows)

    def _to_branches(self, node: Node, number: int, where: Mask | None, active: dict[int, Mask]) -> None:
        """The branch that holds for certain takes what its value is."""
        test, value = self.extent(node.arguments[0]), self.extent(number)
        for argument, holds in zip(node.arguments[1:], (test[0] >= 1.0, test[1] <= 0.0), strict=True):
            sure = np.broadcast_to(holds if where is None else holds & where, np.shape(value[0]))
            if bool(sure.any()):
                self._leave(argument, value, sure)
                if self.network.nodes[argument].lenient:
                    _add(active, argument, sure, self.network.nodes[argument].rows)

    def _leave(self, number: int, found: Interval, where: Mask | None) -> None:
        """A node within ``found`` (boxes, rows) too, where the mask says; a shared one within what all rows leave."""
        node = self.network.nodes[number]
        if node.known is not None:
            self._die(found, where)
            return
        low, high = found
        if where is not None:
            low, high = np.where(where, low, -np.inf), np.where(where, high, np.inf)
        if node.rows == 1 and low.shape[1] > 1:
            low, high = low.max(axis=1, keepdims=True), high.min(axis=1, keepdims=True)
        kept = of.meet(self.extent(number), (low, high))
        self.alive &= (kept[0] <= kept[1]).all(axis=1)
        self.extents[number] = kept

    def _die(self, found: Interval, where: Mask | None) -> None:
        wrong = found[0] > found[1]
        self.alive &= ~(wrong if where is None else wrong & where).any(axis=1)

    def _to_unknowns(self, node: Node, found: Interval, where: Mask | None) -> None:
        places = node.places
        if places is None:
            return
        low, high = found
        if where is not None:
            low, high = np.where(where, low, -np.inf), np.where(where, high, np.inf)
        if len(places) > 1:
            order = np.argsort(places, kind="stable")
            places, first = np.unique(places[order], return_index=True)
            low = np.maximum.reduceat(low[:, order], first, axis=1)
            high = np.minimum.reduceat(high[:, order], first, axis=1)
        self.low[:, places] = np.maximum(self.low[:, places], low)
        self.high[:, places] = np.minimum(self.high[:, places], high)
        self.alive &= (self.low[:, places] <= self.high[:, places]).all(axis=1)

    def keep(self, which: Mask) -> None:
        """Only some of the boxes from now on."""
        self.low, self.high, self.alive = self.low[which], self.high[which], self.alive[which]
        count = len(which)
        self.extents = [
            None if e is None else (e if len(e[0]) != count else (e[0][which], e[1][which])) for e in self.extents
        ]

    def derived(self) -> Interval:
        """The ranges (boxes, Q) of the scalars of the derived quantities, row by row."""
        return ranges(self.network, self.extents, len(self.low))


def _add(active: dict[int, Mask], number: int, where: Mask, rows: int) -> None:
    every: Mask = np.asarray(where.any(axis=1, keepdims=True)) if rows == 1 else where
    active[number] = every if number not in active else active[number] | every


def ranges(network: Network, extents: list[Interval | None], boxes: int) -> Interval:
    """The intervals of what is wanted, (boxes, Q): of each derived quantity row by row, component by component."""
    low, high = [np.empty((boxes, 0))], [np.empty((boxes, 0))]
    for wanted in network.wanted:
        rows = 1 if wanted.positions is None else len(wanted.positions)
        for ends, side in ((low, 0), (high, 1)):
            parts = [np.broadcast_to(_side(extents[n], side), (boxes, rows)) for n in wanted.nodes]
            ends.append(np.stack(parts, axis=2).reshape(boxes, rows * len(wanted.nodes)))
    return np.concatenate(low, axis=1), np.concatenate(high, axis=1)


def _side(extent: Interval | None, side: int) -> Floats:
    if extent is None:
        raise TypeError(side)
    return extent[side]


def portions(network: Network, count: int) -> Iterator[slice]:
    """Boxes that are worked on together."""
    step = max(NUMBERS_AT_A_TIME // network.numbers, 1)
    return (slice(first, first + step) for first in range(0, count, step))


@np.errstate(all="ignore")
def contracted(network: Network, low: Floats, high: Floats, *, shrink: float) -> Boxes:
    """The boxes (n, N) within which all demands may hold, contracted; those that hold nothing are left out.

    Sweeps go on as long as one takes more than the part ``shrink`` of some side of a box.
    """
    parts = [_portion(network, low[rows].copy(), high[rows].copy(), shrink) for rows in portions(network, len(low))]
    return joined(parts) if parts else evaluated(network, low, high)


def _portion(network: Network, low: Floats, high: Floats, shrink: float) -> Boxes:
    sweeper = Sweeper(network, low, high)
    done: list[Boxes] = []
    calm = np.zeros(len(low), dtype=np.int64)
    for _ in range(MOST_SWEEPS):
        before = sweeper.high - sweeper.low, np.isfinite(sweeper.low), np.isfinite(sweeper.high)
        sweeper.forward(demanding=True)
        sweeper.backward()
        gone = _taken(before, sweeper.low, sweeper.high) > shrink
        calm = np.where(gone.any(axis=1), 0, calm + 1)
        still = sweeper.alive & (calm < CALM)
        fixed = sweeper.alive & ~still
        if fixed.any():
            done.append(_finished(network, sweeper, fixed))
        if not still.any():
            break
        if not still.all():
            sweeper.keep(still)
            calm = calm[still]
    else:
        done.append(_finished(network, sweeper, sweeper.alive))
    return joined(done) if done else evaluated(network, low[:0], high[:0])


def _taken(before: tuple[Floats, Mask, Mask], low: Floats, high: Floats) -> Floats:
    """Which part of each side of the boxes a sweep took; all of it where a side was infinite and no longer is."""
    width = before[0]
    part = np.where(width > 0.0, 1.0 - (high - low) / width, 0.0)
    bounded = (~before[1] & np.isfinite(low)) | (~before[2] & np.isfinite(high))
    return np.where(np.isfinite(width), part, np.where(bounded, 1.0, 0.0))


def _finished(network: Network, sweeper: Sweeper, which: Mask) -> Boxes:
    """Boxes at their fixed point; derived quantities from what is left."""
    last = Sweeper(network, sweeper.low[which], sweeper.high[which])
    count = len(which)
    last.extents = [
        None if e is None else (e if len(e[0]) != count else (e[0][which], e[1][which])) for e in sweeper.extents
    ]
    last.forward(demanding=True)
    low, high = last.derived()
    return Boxes(low=last.low, high=last.high, derived_low=low, derived_high=high).at(last.alive)


@np.errstate(all="ignore")
def evaluated(network: Network, low: Floats, high: Floats) -> Boxes:
    """The boxes as they are, with the ranges of derived quantities by evaluation alone."""
    sweeper = Sweeper(network, low, high)
    sweeper.forward(demanding=False)
    derived_low, derived_high = sweeper.derived()
    return Boxes(low=low, high=high, derived_low=derived_low, derived_high=derived_high)
