"""Data that would be certain with other values: no counts, no successes, readings that are all below a limit.

What they tell of an estimate that no other data speak of is then all in their probability.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import places_in
from mbm.equations.scatter import tied_parts
from mbm.equations.solves import likely
from mbm.equations.types import Floats, Indices, Minimum
from mbm.problem.likelihoods.types import SHIFT
from mbm.values import dataclass

ROUNDED = 1e-9
"""Size of −log of a probability that is 1 but for roundings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certain:
    """Coordinates in parts (n,) that no equation joins; ``surprise`` is −log of the probability of each part's data.

    NaN where no values would make them certain.
    """

    parts: Indices
    surprise: Floats

    def of(self, coordinates: Indices) -> float:
        """−log of the probability of all data that speak of some coordinates; NaN where nothing makes them certain."""
        return float(self.surprise[np.unique(self.parts[coordinates])].sum())


def certain(equations: Assembled, minimum: Minimum) -> Certain | None:
    """What the data of each part of a dense problem are at a minimum; None where no part's would ever be certain."""
    readings = {group.number: stated for group, stated in likely(equations.groups)}
    if not readings or equations.rows is not None or equations.factors is not None or equations.structure is not None:
        return None
    columns = places_in(equations.free, len(equations.layout.number) + 1)
    first = 0
    rows, touched, surprise = [], [], []
    squares = np.square(minimum.residuals)
    for group in (*equations.groups, *equations.constraints):
        own = np.arange(group.rows) + first
        places = columns[np.minimum(group.columns, len(columns) - 1)]
        if group.gathered is not None:
            places = np.hstack([places, np.tile(columns[group.gathered.touched], (group.rows, 1))])
        line, slot = np.nonzero(places >= 0)
        rows.append(own[line])
        touched.append(places[line, slot])
        first += group.rows
        stated = readings.get(group.number)
        cost = np.full(group.rows, np.nan)
        if stated is not None:
            none = np.abs(stated.surprise - 0.5 * SHIFT * stated.shifted.sum()) <= ROUNDED
            lines = squares[group.first : group.first + group.count].reshape(group.rows, -1)
            cost = np.where(none, 0.5 * lines.sum(axis=1), np.nan)
        surprise.append(cost)
    of_row, of_column = tied_parts(np.concatenate(rows), np.concatenate(touched), first, equations.dimension)
    count = int(of_column.max(initial=-1)) + 1
    found = np.bincount(of_row, weights=np.concatenate(surprise), minlength=count)
    return Certain(parts=of_column, surprise=np.asarray(found, dtype=np.float64))
