"""Sparse Cholesky by fronts (Duff and Reid 1983): factor, solve, and the inverse on the pattern of the matrix."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import Protocol

import numpy as np

from mbm.solution.sparse.fronts import Fronts
from mbm.solution.types import Floats
from mbm.values import dataclass


class SparseFactor(Protocol):
    """The factor of a sparse matrix: that of this file, or of a library, or of compiled routines."""

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        ...

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix."""
        ...


class SparseSolver(Protocol):
    """What makes such factors, for one pattern."""

    def factorise(self, entries: Floats) -> SparseFactor | None:
        """The factor of the matrix with these entries; None: not positive."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontFactor:
    """``P A Pᵀ = L Lᵀ``; for each front the lower triangle of its columns and the rows below it."""

    fronts: Fronts
    corners: Sequence[Floats]
    lower: Sequence[Floats]

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        from scipy.linalg.blas import dtrsm

        x = np.array(right[self.fronts.order])
        for front, corner, lower in zip(self.fronts.fronts, self.corners, self.lower, strict=True):
            own = slice(front.first, front.first + front.width)
            if front.width == 1:
                x[own] /= corner[0, 0]
            else:
                x[own] = dtrsm(1.0, corner.T, x[own], lower=0, trans_a=1)
            if lower.size:
                x[front.rows[front.width :]] -= lower @ x[own]
        for front, corner, lower in zip(
            reversed(self.fronts.fronts), reversed(self.corners), reversed(self.lower), strict=True
        ):
            own = slice(front.first, front.first + front.width)
            found = x[own]
            if lower.size:
                found = found - lower.T @ x[front.rows[front.width :]]
            x[own] = found / corner[0, 0] if front.width == 1 else dtrsm(1.0, corner.T, found, lower=0)
        result = np.empty_like(x)
        result[self.fronts.order] = x
        return result

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix (Takahashi, Fagan and Chin 1973).

        From the last front to the first: the rows below a front are rows of its parent, whose part of the inverse is
        known by then.
        """
        from scipy.linalg.blas import dtrsm

        result = np.empty(entries)
        known: dict[int, Floats] = {}
        waiting = [0] * len(self.fronts.fronts)
        for front in self.fronts.fronts:
            if front.parent >= 0:
                waiting[front.parent] += 1
        for number in range(len(self.fronts.fronts) - 1, -1, -1):
            front, corner, lower = self.fronts.fronts[number], self.corners[number], self.lower[number]
            width, size = front.width, len(front.rows)
            part = np.empty((size, size))
            root = np.asarray(dtrsm(1.0, corner.T, np.eye(width), lower=0, trans_a=1))
            part[:width, :width] = root.T @ root
            if size > width:
                rest = known[front.parent][front.into[:, None], front.into]
                slope = lower @ root
                across = rest @ slope
                part[width:, width:] = rest
                part[width:, :width] = -across
                part[:width, width:] = -across.T
                part[:width, :width] += slope.T @ across
            result[front.source] = part.reshape(-1)[front.target]
            if waiting[number]:
                known[number] = part
            if front.parent >= 0:
                waiting[front.parent] -= 1
                if not waiting[front.parent]:
                    del known[front.parent]
        return result


def factorise(found: Fronts, entries: Floats) -> FrontFactor | None:
    """The factor of the matrix whose entries are given in the order of the fronts' analysis; None: not positive."""
    from scipy.linalg.blas import dtrsm

    pending: list[list[tuple[int, Floats]]] = [[] for _ in found.fronts]
    corners: list[Floats] = []
    below: list[Floats] = []
    for number, front in enumerate(found.fronts):
        width, size = front.width, len(front.rows)
        if size == 1 and not pending[number]:  # what no equation mentions, thousands of which may be
            square = float(entries[front.source[0]]) if len(front.source) else 0.0
            if not 0.0 < square < inf:
                return None
            corners.append(np.full((1, 1), sqrt(square)))
            below.append(np.empty((0, 1)))
            continue
        whole = np.zeros((size, size))
        whole.reshape(-1)[front.target] = entries[front.source]
        for child, update in pending[number]:
            into = found.fronts[child].into
            whole[into[:, None], into] += update
        pending[number] = []
        try:
            corner: Floats = np.asarray(np.linalg.cholesky(whole[:width, :width]), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(corner[-1, -1]):
            return None
        lower = np.empty((size - width, width))
        if size > width:
            lower = np.asarray(dtrsm(1.0, corner.T, whole[width:, :width].T, lower=0, trans_a=1)).T
            if front.parent >= 0:
                pending[front.parent].append((number, whole[width:, width:] - lower @ lower.T))
        corners.append(corner)
        below.append(lower)
    return FrontFactor(fronts=found, corners=corners, lower=below)
