"""Linear least squares for unknowns in which all their equations are affine, given the others."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.numerics.finite import finite
from mbm.estimation.starts.closed_forms.situation import Candidate, Situation
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.values import dataclass

DETERMINED = 1e-12
"""Singular value of the scaled equations beside the largest, below which an unknown counts as not determined."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AffineRows:
    """Each row says ``matrix · x + offset = 0``: (n, s) and (n,), already divided by σ."""

    matrix: Floats
    offset: Floats


@dataclass(frozen=True, slots=True)
class Linear:
    """One step of least squares, where it determines everything."""

    name: str = "linear"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that are affine in the candidate's numbers, and enough of them."""
        if not candidate.flat or not candidate.lines:
            return None
        wanted = np.zeros(len(situation.layout.number), dtype=bool)
        wanted[candidate.coordinates] = True
        if not all(affine(group, wanted) for group, _, _ in candidate.lines):
            return None
        rows = candidate.scalars()
        size = candidate.places.shape[1]
        if len(rows) < size:
            return None
        origin = np.zeros(size)
        values, slopes = rows.values(origin)[:, 0], rows.slopes(origin)[:, 0]
        usable = np.isfinite(values) & finite(slopes, 1)
        if int(usable.sum()) < size:
            return None
        root = np.sqrt(rows.weight[usable])
        data = AffineRows(matrix=slopes[usable] * root[:, None], offset=values[usable] * root)
        return Plan(form=self, candidate=candidate, rows=rows.picked(usable), minimal=size, data=data)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution for each subset; NaN where it does not determine all numbers."""
        rows: AffineRows = plan.data
        matrix, right = rows.matrix[subsets], -rows.offset[subsets]
        return least_squares(matrix, right)[:, None, :]


def least_squares(matrix: Floats, right: Floats) -> Floats:
    """x (T, s) with the least ``|A x − b|`` for each of T systems (T, n, s), (T, n); NaN where they leave some open."""
    scale = np.linalg.norm(matrix, axis=1)
    scale = np.where(scale > 0, scale, 1.0)
    U, values, Vt = np.linalg.svd(matrix / scale[:, None, :], full_matrices=False)
    determined = values[:, -1] > DETERMINED * values[:, 0]
    inverse = np.where(determined[:, None], 1.0 / np.where(determined[:, None], values, 1.0), np.nan)
    return np.asarray(np.einsum("tji,tj,tkj,tk->ti", Vt, inverse, U, right) / scale)


LINEAR = Linear()
