"""Sparse Cholesky by fronts (Duff and Reid 1983): factor, solve, and the inverse on the pattern of the matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.fronts import Fronts
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
    """``P A Pᵀ = L Lᵀ``; for each of the ``numbers`` of fronts the lower triangle of its columns and the rows below it.

    The other fronts are single columns that touch no other, as those of what no equation mentions, of which there may
    be thousands: ``alone`` are their places, ``squares`` their elements, ``sources`` the entries that hold these.
    """

    fronts: Fronts
    numbers: Sequence[int]
    corners: Sequence[Floats]
    lower: Sequence[Floats]
    alone: Indices
    squares: Floats
    sources: Indices

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        from scipy.linalg.blas import dtrsm

        x = np.array(right[self.fronts.order])
        x[self.alone] /= self.squares[:, None]
        own_fronts = [self.fronts.fronts[number] for number in self.numbers]
        for front, corner, lower in zip(own_fronts, self.corners, self.lower, strict=True):
            own = slice(front.first, front.first + front.width)
            x[own] = dtrsm(1.0, corner.T, x[own], lower=0, trans_a=1)
            if lower.size:
                x[front.rows[front.width :]] -= lower @ x[own]
        for front, corner, lower in zip(
            reversed(own_fronts), reversed(self.corners), reversed(self.lower), strict=True
        ):
            own = slice(front.first, front.first + front.width)
            found = x[own]
            if lower.size:
                found = found - lower.T @ x[front.rows[front.width :]]
            x[own] = dtrsm(1.0, corner.T, found, lower=0)
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
        result[self.sources] = 1.0 / self.squares
        known: dict[int, Floats] = {}
        waiting = [0] * len(self.fronts.fronts)
        for number in self.numbers:
            parent = self.fronts.fronts[number].parent
            if parent >= 0:
                waiting[parent] += 1
        for k in range(len(self.numbers) - 1, -1, -1):
            number, corner, lower = self.numbers[k], self.corners[k], self.lower[k]
            front = self.fronts.fronts[number]
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

    taken = {front.parent for front in found.fronts}
    single = [len(f.rows) == 1 and len(f.source) == 1 and k not in taken for k, f in enumerate(found.fronts)]
    numbers = [number for number, alone in enumerate(single) if not alone]
    lone = [front for front, alone in zip(found.fronts, single, strict=True) if alone]
    sources = np.array([front.source[0] for front in lone], dtype=np.int64)
    squares = entries[sources]
    if not bool(((squares > 0.0) & np.isfinite(squares)).all()):
        return None
    pending: dict[int, list[tuple[int, Floats]]] = {number: [] for number in numbers}
    corners: list[Floats] = []
    below: list[Floats] = []
    for number in numbers:
        front = found.fronts[number]
        width, size = front.width, len(front.rows)
        whole = np.zeros((size, size))
        whole.reshape(-1)[front.target] = entries[front.source]
        for child, update in pending.pop(number):
            into = found.fronts[child].into
            whole[into[:, None], into] += update
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
    return FrontFactor(
        fronts=found,
        numbers=numbers,
        corners=corners,
        lower=below,
        alone=np.array([front.first for front in lone], dtype=np.int64),
        squares=squares,
        sources=sources,
    )
