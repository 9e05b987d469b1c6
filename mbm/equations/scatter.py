"""Nonzeros of kernel Jacobians → the dense Jacobian over the free numbers: where each of them goes, found once.

And the parts into which they tie rows and columns together.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.values import dataclass

BLOCK = 2048
"""Rows that are written together, so that they stay in the cache; all at once take nine times longer (measured)."""

FEW = 16
"""Up to so many rows all nonzeros are added at once: one alone costs a microsecond. Of more rows each goes alone."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """The places of one group's nonzeros.

    ``fixed`` holds nonzeros, outputs and columns (nonzeros,) of those that go to one column for all rows, in parts
    that do not name a place twice; ``varying`` (nonzero, output, columns (rows,)) where the column depends on the row,
    -1 for a number that is not free.
    """

    fixed: tuple[tuple[Indices, Indices, Indices], ...]
    varying: tuple[tuple[int, int, Indices], ...]

    def add(self, nonzeros: Floats, target: Floats) -> None:
        """Add nonzeros (rows, nonzeros) to ``target`` (rows, outputs, width)."""
        rows = len(target)
        for start in range(0, rows, BLOCK):
            block, found = target[start : start + BLOCK], nonzeros[start : start + BLOCK]
            for ks, outputs, columns in self.fixed:
                if len(block) <= FEW:
                    block[:, outputs, columns] += found[:, ks]
                    continue
                for k, i, column in zip(ks, outputs, columns, strict=True):
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
    fixed: list[dict[tuple[int, int], int]] = []
    varying: list[tuple[int, int, Indices]] = []
    found: dict[int, Indices] = {}
    for k, (i, j) in enumerate(zip(rows.tolist(), variables.tolist(), strict=True)):
        if not len(index):
            break
        if shared[j]:
            column = int(columns[index[0, j]])
            if column >= 0:
                part = next((each for each in fixed if (i, column) not in each), None)
                if part is None:
                    fixed.append(part := {})
                part[i, column] = k
            continue
        if j not in found:
            found[j] = columns[index[:, j]]
        varying.append((k, i, found[j]))
    parts = [(np.array(list(part.values())), *np.array(list(part)).T) for part in fixed]
    return Scatter(fixed=tuple(parts), varying=tuple(varying))


def tied_parts(row: Indices, column: Indices, rows: int, columns: int) -> tuple[Indices, Indices]:
    """The part, from 0, of each row and each column, where rows ``row`` (k,) have nonzeros in ``column`` (k,)."""
    # Loaded when parts are asked for only, so that most problems start at once.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(row)), (row, rows + column)), shape=(rows + columns, rows + columns))
    _, part = connected_components(links, directed=False)
    return part[:rows], part[rows:]
