"""Routines of generated solvers, run as the Python that they are, against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mbm.emit.routines.rooms import connected
from mbm.machine.records import slot, view
from mbm.solver import description as at
from mbm.solver.decisions import MANY_CONNECTED


def system_with(n: int, columns: np.ndarray) -> tuple[at.Problem, at.DataSet]:
    """``system`` and ``data`` of one block whose rows have derivatives by ``columns`` (rows, k)."""
    system = np.zeros(at.HEADER + at.BLOCK, dtype=np.int64)
    system[at.Problem.n], system[at.Problem.residual_blocks], system[slot(at.Problem, "blocks")] = n, 1, at.HEADER
    system[at.HEADER + at.Block.tangents] = system[at.HEADER + at.Block.columns] = columns.shape[1]
    data = np.zeros(at.DATA_HEAD + at.DATA_BLOCK, dtype=np.int64)
    data[at.DATA_HEAD + at.DataBlock.rows] = len(columns)
    return view(at.Problem, system), view(at.DataSet, data)


@pytest.mark.parametrize("rows", [3, 6, 9, 12])
@pytest.mark.parametrize("seed", range(6))
def test_connected_is_what_the_graph_of_the_equations_is(rows, seed):
    n = 6
    columns = np.random.default_rng(seed).integers(-1, n, size=(rows, 2))  # -1: a coordinate that stays
    edges = columns[(columns >= 0).all(axis=1)]
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    parts, _ = connected_components(graph, directed=False)
    system, data = system_with(n, columns)
    assert connected(system, data, columns.ravel(), np.zeros(n, dtype=np.int64)) == (parts == 1)


def test_many_unknowns_are_none_of_it():
    n = MANY_CONNECTED + 1
    columns = np.stack([np.zeros(n - 1, dtype=np.int64), np.arange(1, n)], axis=1)
    system, data = system_with(n, columns)
    assert connected(system, data, columns.ravel(), np.zeros(n, dtype=np.int64)) == 0
