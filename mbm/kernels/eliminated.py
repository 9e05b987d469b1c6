"""A kernel with errors in measured columns → the kernel of what is left of it once they are eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.types import Kernel
from mbm.machine.elimination import STEPS, Conditions, eliminated
from mbm.symbolic.types import ConstantInput

LARGEST = 20_000
"""Instructions, about, up to which the kernel is made: compiling it takes some tenths of a second."""


def eliminated_kernel(kernel: Kernel, noises: Sequence[tuple[int, int, bool]]) -> Kernel | None:
    """The kernel of the residuals that `mbm.machine.elimination` leaves, of variance 1; None: it would be too large, or
    calls functions in Python in the middle.

    Its parameters are those of ``kernel``, then the standard deviations of the uncertain ones, the weights of a row,
    and 1 for outputs with noise of their own, else 0. ``noises`` has for each equation the outputs ``first … last``
    and whether its weights are a matrix, row by row, or factors.
    """
    found = kernel.corrections
    if found is None or kernel.calls:
        return None
    c, k = len(found.columns), kernel.outputs
    algebra = c**3 + 2 * k * c * (c + k) + k**3
    if STEPS * (len(found.kernel.jacobian_program.instructions) + algebra) > LARGEST:
        return None
    whitening, weights = _whitening(noises)
    slopes = _pairs(found.slope_rows, found.slope_columns)
    made = eliminated(
        Conditions(
            equations=kernel.jacobian_program,
            corrections=found.kernel.jacobian_program,
            variables=len(kernel.variables),
            parameters=len(kernel.parameters),
            columns=found.columns,
            outputs=k,
            derivatives=_pairs(kernel.jacobian_rows, kernel.jacobian_columns),
            slopes=slopes,
            curvature=_pairs(found.curvature_rows, found.curvature_columns),
            whitening=whitening,
            weights=weights,
        )
    )
    names = (
        *(f"standard deviation {i + 1}" for i in range(c)),
        *(f"weight {i + 1}" for i in range(weights)),
        *(f"own noise {i + 1}" for i in range(k)),
    )
    return replace(
        kernel,
        parameters=(*kernel.parameters, *(ConstantInput(name) for name in names)),
        jacobian_rows=np.array([output for output, _ in made.derivatives], dtype=np.int64),
        jacobian_columns=np.array([tangent for _, tangent in made.derivatives], dtype=np.int64),
        dependence=np.ones((len(made.derivatives), len(kernel.tangents)), dtype=bool),
        value_program=made.values,
        jacobian_program=made.jacobian,
        corrections=None,
    )


def _pairs(rows: NDArray[np.int64], columns: NDArray[np.int64]) -> tuple[tuple[int, int], ...]:
    return tuple(zip(rows.tolist(), columns.tolist(), strict=True))


def _whitening(noises: Sequence[tuple[int, int, bool]]) -> tuple[tuple[tuple[tuple[int, int], ...], ...], int]:
    """For each output the weights and outputs whose products are its whitened value, and how many weights there are."""
    lines: list[tuple[tuple[int, int], ...]] = []
    place = 0
    for first, last, matrix in noises:
        size = last - first
        for i in range(size):
            if matrix:
                lines.append(tuple((place + i * size + j, first + j) for j in range(size)))
            else:
                lines.append(((place + i, first + i),))
        place += size * size if matrix else size
    return tuple(lines), place
