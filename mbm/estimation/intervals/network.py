"""What interval methods answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mbm.equations.layout import Layout
from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals.arithmetic import Floats, Interval
from mbm.expression.nodes import Operation
from mbm.problem.tables import CellKey, Table
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Node:
    """One value in each of ``rows`` rows (1: shared).

    Exactly one of the following holds it: ``known`` numbers (1, rows); the places of the unknown numbers that it is
    (rows,), ``places``; an ``operation`` on the nodes ``arguments``, with the known ``exponent`` of a power.
    ``lenient``: it need not exist in all rows: only a branch that may not be taken or a derived quantity asks for it.
    ``turning``: an angle of which only the value but for whole turns counts, so that it may lie beyond ±π.
    """

    rows: int
    known: Interval | None = None
    places: Indices | None = None
    operation: Operation | None = None
    arguments: tuple[int, ...] = ()
    exponent: Interval | None = None
    lenient: bool = False
    turning: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Demand:
    """What a node has to lie in, row by row (1, rows); ``observed``: a measurement says so, else a constraint."""

    node: int
    allowed: Interval
    observed: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wanted:
    """The nodes (size of them) of a derived quantity in the rows at ``positions`` of its table (None: once).

    ``angle``: it is one angle, of which only the value but for whole turns counts.
    """

    owner: int
    nodes: tuple[int, ...]
    positions: Indices | None
    angle: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """Nodes, arguments before what uses them, and what is demanded of them.

    ``low`` and ``high`` (N,) hold what is stated of the unknown numbers before any equation, ``full_turn`` (N,) those
    that are angles of which nothing is stated; ``free`` (N,) are not fixed.
    """

    layout: Layout
    nodes: tuple[Node, ...]
    demands: tuple[Demand, ...]
    wanted: tuple[Wanted, ...]
    low: Floats
    high: Floats
    free: Mask
    full_turn: Mask

    @property
    def numbers(self) -> int:
        """Numbers of all nodes together: what one box takes."""
        return sum(node.rows for node in self.nodes) or 1

    def without_observations(self) -> Network:
        """The constraints alone."""
        return replace(self, demands=tuple(each for each in self.demands if not each.observed))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ranges:
    """Bounds in SI: of all unknown numbers (N,), and of the scalars of derived quantities (Q,), infinite if there is
    none; the wanted ones follow one another row by row.
    """

    low: Floats
    high: Floats
    derived_low: Floats
    derived_high: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Enclosure:
    """One solve by intervals.

    ``whole`` (None: no vector meets all demands) bounds the set, ``pieces`` its separate parts (none, if it may hang
    together). ``boxes`` were examined; ``reached``: the bounds are as narrow as was asked.
    """

    key: Mapping[str, CellKey]
    tables: Mapping[str, Table]
    layout: Layout
    wanted: tuple[Wanted, ...]
    whole: Ranges | None
    pieces: tuple[Ranges, ...]
    method: str
    boxes: int
    reached: bool
    seconds: float
