"""What interval methods answer."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.equations.layout import Layout
from mbm.estimation.intervals.arithmetic import Floats
from mbm.estimation.intervals.network import Wanted
from mbm.problem.tables import CellKey, Table
from mbm.values import dataclass


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
