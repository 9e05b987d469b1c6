"""Nonzeros of kernel Jacobians → the dense Jacobian over the free numbers: where each of them goes, found once."""

from __future__ import annotations

import numpy as np

from mbm.solution.types import Floats, Indices
from mbm.values import dataclass

BLOCK = 2048
"""Rows that are written together, so that they stay in the cache; all at once take nine times longer (measured)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """The places of one group's nonzeros.

    ``fixed`` holds (nonzero, output, column) where all rows go to one column; ``varying`` (nonzero, output, columns
    (rows,)) where the column depends on the row, -1 for a number that is not free.
    """

    fixed: tuple[tuple[int, int, int], ...]
    varying: tuple[tuple[int, int, Indices], ...]

    def add(self, nonzeros: Floats, target: Floats) -> None:
        """Add nonzeros (rows, nonzeros) to ``target`` (rows, outputs, width)."""
        rows = len(target)
        for start in range(0, rows, BLOCK):
            block, found = target[start : start + BLOCK], nonzeros[start : start + BLOCK]
            for k, i, column in self.fixed:
                block[:, i, column] += found[:, k]
            if not self.varying:
                continue
            lines = np.arange(len(block))
            for k, i, columns in self.varying:
                chosen = columns[start : start + BLOCK]
                kept = chosen >= 0
                if kept.all():
                    block[lines, i, chosen] += found[:, k]
                else:
                    block[lines[kept], i, chosen[kept]] += found[kept, k]


def scatter(rows: Indices, variables: Indices, index: Indices, shared: tuple[bool, ...], columns: Indices) -> Scatter:
    """Where nonzero k, of output ``rows[k]`` and variable ``variables[k]``, goes.

    ``index`` (rows, variables) places each variable in the vector of all numbers, ``shared`` says where it does so
    equally for all rows, and ``columns`` (N,) gives the column of each number, -1 where it is not free.
    """
    fixed: list[tuple[int, int, int]] = []
    varying: list[tuple[int, int, Indices]] = []
    found: dict[int, Indices] = {}
    for k, (i, j) in enumerate(zip(rows.tolist(), variables.tolist(), strict=True)):
        if not len(index):
            break
        if shared[j]:
            column = int(columns[index[0, j]])
            if column >= 0:
                fixed.append((k, i, column))
            continue
        if j not in found:
            found[j] = columns[index[:, j]]
        varying.append((k, i, found[j]))
    return Scatter(fixed=tuple(fixed), varying=tuple(varying))
