"""Rotations, poses, similarities, directions that are themselves measured: the value at which a residual vanishes."""

from __future__ import annotations

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.intersection import solved
from mbm.estimation.starts.closed_forms.motions import origin, stepped
from mbm.estimation.starts.closed_forms.relative_poses import relates
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.values import dataclass

NEWTON = 30
SOLVED = 1e-9
"""Residual at which a value counts as found, beside that at the start."""

MOST = 4
"""Rows of a subset whose values are given as solutions; the best fitting one is kept."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Newton's method on each row by itself, from no motion; a row determines the value."""

    name: str = "measured"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows with as many components as one curved unknown has coordinates, each with a value that it vanishes at.

        Not those that measure a motion from another member of its family: what is known of all of them together is
        better than what one neighbour says (`relative_poses`).
        """
        del situation
        entry = candidate.entries[0]
        if len(candidate.entries) != 1 or entry.unknown.manifold.flat:
            return None
        rows = candidate.rows(entry.unknown.freedom)
        if not len(rows):
            return None
        rows = rows.picked(np.concatenate([np.full(len(p.lines), not relates(p.group, entry)) for p in rows.pieces]))
        if not len(rows):
            return None
        values = vanishing(rows, entry)
        known = finite(values, 1)
        if not bool(known.any()):
            return None
        return Plan(form=self, candidate=candidate, rows=rows.picked(known), minimal=1, data=values[known])

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """The values of the first few rows of each subset."""
        values: Floats = plan.data
        return np.asarray(values[subsets[:, :MOST]])


def vanishing(rows: Rows, entry: Entry) -> Floats:
    """The value (n, s) at which each row vanishes, NaN where Newton finds none."""
    found = np.tile(origin(entry), (len(rows), 1))
    scale = np.ones(len(rows))
    with np.errstate(all="ignore"):
        for number in range(NEWTON):
            values, slopes = rows.linearised(found)
            size = np.abs(values).max(axis=1)
            if number == 0:
                scale = 1.0 + np.where(np.isfinite(size), size, 0.0)
            step = solved(slopes, values)
            usable = finite(step, 1)
            if not bool((usable & (size > SOLVED * scale)).any()):
                break
            found = stepped(entry, found, np.where(usable[:, None], -step, 0.0))
        size = np.abs(rows.values(found)).max(axis=1)
    return np.where((size <= 10 * SOLVED * scale)[:, None], found, np.nan)


MEASURED = Measured()
