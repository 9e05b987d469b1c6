"""Kernels over tables, against the same formula in NumPy, in every target."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from mbm.machine.kinds import LANES
from mbm.solver.tables import Table

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
INPUTS, FIRST, OTHERS, PORTION = 3, 2, 4, 2


def outputs_of(x):
    """(…, 3) → (…, 6)."""
    a, b, c = np.moveaxis(x, -1, 0)
    return np.stack([a + b, c, a, b, a * c, b - c], axis=-1)


def numbers(begin, *shape):
    return np.ctypeslib.as_array((ctypes.c_double * int(np.prod(shape))).from_address(begin)).reshape(shape)


@pytest.mark.parametrize("rows", [0, 1, LANES, LANES + 1, PORTION * LANES, 5 * PORTION * LANES + 3])
def test_each_row_has_its_outputs_in_two_tables(solver, rows):
    blocks = []

    @SIGNATURE
    def kernel(given, target, count):
        blocks.append(count)
        x = numbers(given, count, INPUTS, LANES).transpose(0, 2, 1)
        numbers(target, count, FIRST + OTHERS, LANES)[...] = outputs_of(x).transpose(0, 2, 1)

    inputs = np.random.default_rng(rows).standard_normal((rows, INPUTS))
    first, others = np.full((rows + 1, FIRST), 7.0), np.full((rows + 1, OTHERS), 7.0)
    work = np.full(PORTION * LANES * (INPUTS + FIRST + OTHERS), np.nan)
    table = np.zeros(5, dtype=np.int64)
    table[[Table.kernel, Table.inputs, Table.first, Table.others, Table.portion]] = (
        ctypes.cast(kernel, ctypes.c_void_p).value,
        *(INPUTS, FIRST, OTHERS, PORTION),
    )
    assert solver("evaluate_rows", table, rows, inputs, first, others, work) == 0
    wanted = outputs_of(inputs)
    np.testing.assert_array_equal(first[:rows], wanted[:, :FIRST])
    np.testing.assert_array_equal(others[:rows], wanted[:, FIRST:])
    assert (first[rows:] == 7.0).all()
    assert (others[rows:] == 7.0).all()
    assert sum(blocks) == -(-rows // LANES)
    assert max(blocks, default=0) <= PORTION
