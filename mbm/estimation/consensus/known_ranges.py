"""The closed form of ranges of a compiled problem: recognised once, for the data sets to come."""

from __future__ import annotations

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache
from mbm.estimation.settings import Settings
from mbm.solver.range_maps import RangeMaps

OFTEN = 2
"""Data sets from which on ranges are recognised: that takes as long as a few searches for all closed forms."""


class KnownRanges:
    """What was found of equations of one structure: how many were looked at, then their ranges, None: they are none.

    Local to one compiled problem.
    """

    def __init__(self) -> None:
        self._found: dict[object, int | RangeMaps | None] = {}

    def of(self, equations: Assembled, settings: Settings, *, stated: bool, many: bool = False) -> RangeMaps | None:
        """The ranges that give all numbers of equations without losses and constraints, if that is known of them.

        ``many``: they are those of one of many data sets, so that it pays to find out at once.
        """
        key = tuple((g.number, g.shared) for g in equations.groups), equations.free.tobytes()
        found = self._found.get(key, 0)
        if isinstance(found, int):
            found = found + 1 if not many and found + 1 < OFTEN else _recognised(equations, settings, stated=stated)
            self._found[key] = found
        if not isinstance(found, RangeMaps):
            return None
        # Here and below: loaded where many data sets are solved only, so that the others start at once.
        from mbm.estimation.starts.closed_forms.rows import ENOUGH

        return found if all(group.rows <= ENOUGH for group in equations.groups) else None


def _recognised(equations: Assembled, settings: Settings, *, stated: bool) -> RangeMaps | None:
    families = any(entry.keys is not None for entry in equations.layout.entries)
    if families or equations.likely or equations.implicit is not None or equations.structure is not None:
        return None
    from mbm.estimation.consensus.recognised import recognised

    found = recognised(equations, settings)
    ranges = None if found is None else found.ranges(stated=stated)
    return ranges if ranges is not None and ranges.whole else None


def known_ranges(cache: EvaluationCache) -> KnownRanges:
    """What was found of the equations of a compiled problem."""
    found = cache.native.get("ranges")
    if not isinstance(found, KnownRanges):
        found = cache.native["ranges"] = KnownRanges()
    return found
