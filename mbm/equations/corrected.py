"""The corrections of a measured column, as solves hold them and reports show them."""

from __future__ import annotations

from mbm.equations.types import Floats
from mbm.problem.tables import CellKey
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CorrectedColumn:
    """The corrections ``value`` (p,) of an uncertain column, to be added, and the stated ``sigma`` (p,), both in SI.

    ``rows`` (p,) count from 1 in the unfiltered table, None where a filter has left the row out; ``keys`` are those of
    the rows where the table has a key.
    """

    table: str
    column: str
    rows: tuple[int | None, ...]
    keys: tuple[CellKey | None, ...] | None
    value: Floats
    sigma: Floats
