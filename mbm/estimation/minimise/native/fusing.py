"""Which groups of equations have their rows fused in one function, that function, and the table that says so.

Worth while for streams: compiling it takes as long as thousands of small solves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Indices
from mbm.estimation.minimise.native.packing import Fused, triangle_kind
from mbm.machine.merged import Part, fused
from mbm.solver import description as of

if TYPE_CHECKING:
    from mbm.kernels.store import Store

FEW_ROWS = 3
"""Rows of a group that are fused at most: more fill the lanes of its own kernel."""

MOST_RESIDUALS = 64
MOST_OPERATIONS = 2_000
"""Residuals and operations of fused rows at most: straight lines take a tenth of a millisecond an operation to
compile, and beyond the nearest cache they are no faster than loops."""


def unitable(groups: Sequence[Group], rows: Sequence[int]) -> tuple[int, ...]:
    """How many rows of each group, of which a data set has ``rows`` at most, are fused: all or none."""
    found = []
    residuals = operations = 0
    for group, count in zip(groups, rows, strict=True):
        alike = all(group.shared) and all(group.shared_columns)
        plain = group.whiteners and not any(group.losses)
        more = count * len(group.kernel.jacobian_program.instructions)
        own = count if plain and alike and 0 < count <= FEW_ROWS else 0
        if operations + more > MOST_OPERATIONS or residuals + count * group.kernel.outputs > MOST_RESIDUALS:
            own = 0
        if own:
            operations += more
            residuals += count * group.kernel.outputs
        found.append(own)
    return tuple(found)


def places_of(groups: Sequence[Group], rows: Sequence[int]) -> tuple[bytes, ...]:
    """Which numbers and coordinates the rows that are fused vary with."""
    chosen = [group for group, count in zip(groups, rows, strict=False) if count]
    return tuple(part.tobytes() for group in chosen for part in (group.places, group.touched))


def fused_rows(equations: Assembled, rows: Sequence[int], store: Store | None) -> Fused | None:
    """The function for so many rows of each group; None where there are none."""
    from mbm.kernels.native.fused import united_code

    if not any(rows):
        return None
    column = equations.columns
    counts = rows[: len(equations.groups)]
    parts = [_part(group, count, column) for group, count in zip(equations.groups, counts, strict=True) if count]
    residuals = sum(part.rows * part.outputs for part in parts)
    numbers = len(equations.layout.start)
    library = united_code(fused(parts, numbers, equations.dimension), numbers, residuals, store)
    head = np.zeros(of.FUSED, dtype=np.int64)
    head[of.Fused.values] = library.address("values")
    head[of.Fused.jacobian] = library.address("jacobian")
    head[of.Fused.residuals] = residuals
    reals = sum(part.rows * (part.parameters + part.weights) for part in parts)
    return Fused(table=np.concatenate([head, np.array(counts, dtype=np.int64)]), reals=reals, library=library)


def _part(group: Group, rows: int, column: Indices) -> Part:
    """The rows of one group."""
    kernel = group.kernel
    columns = column[group.touched[0]][kernel.jacobian_columns].tolist()
    whitening: list[tuple[tuple[int, int], ...]] = []
    weights = 0
    for each in group.whiteners:
        size = each.last - each.first
        kind = triangle_kind(each)
        for i in range(size):
            if kind == 0:
                whitening.append(((weights + i, each.first + i),))
            else:
                used = range(i + 1) if kind == 1 else range(i, size)
                whitening.append(tuple((weights + i * size + j, each.first + j) for j in used))
        weights += size * size if kind else size
    return Part(
        program=kernel.jacobian_program,
        rows=rows,
        outputs=kernel.outputs,
        derivatives=tuple(zip(kernel.jacobian_rows.tolist(), columns, strict=True)),
        numbers=tuple(group.places[0].tolist()),
        parameters=len(kernel.parameters),
        whitening=tuple(whitening),
        weights=weights,
    )
