"""Routines of generated solvers, run as the Python that they are, against NumPy and SciPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mbm.emit.routines.filtering import lower_factor
from mbm.emit.routines.rooms import connected
from mbm.emit.routines.rows import whiten_slopes
from mbm.emit.routines.systems import set_component
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


@pytest.mark.parametrize("size", [1, 2, 4])
def test_the_factor_of_a_covariance_is_that_of_cholesky(size):
    shape = np.random.default_rng(size).normal(size=(size, size))
    matrix, found = shape @ shape.T, np.zeros(size * size)
    assert lower_factor(matrix.ravel(), size, found) == 1
    np.testing.assert_allclose(np.tril(found.reshape(size, size)), np.linalg.cholesky(matrix), rtol=1e-12)


@pytest.mark.parametrize(
    "matrix",
    [[[1.0, 0.5], [0.4, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]],
)
def test_matrices_that_are_no_covariances_have_no_factor(matrix):
    assert lower_factor(np.ravel(matrix), 2, np.zeros(4)) == 0


def test_a_row_is_whitened_unit_by_unit():
    """Factors, a triangular matrix, and a unit that takes no part, whose numbers need not be any."""
    units = [(0, 2, 0, 0), (2, 4, 2, 1), (4, 5, 6, 0)]
    whole = np.array([[2.0, 0, 0, 0, 0], [0, 3.0, 0, 0, 0], [0, 0, 5.0, 0, 0], [0, 0, 7.0, 11.0, 0], [0, 0, 0, 0, 0]])
    outputs, tangents, places = [0, 1, 2, 3, 3, 4], [0, 1, 0, 1, 2, 0], np.array([2, 0, -1])  # the third is fixed
    block = SimpleNamespace(
        outputs=5,
        weights=7,
        columns=3,
        unit_count=3,
        units=[SimpleNamespace(first=a, last=b, weights=at, matrix=kind) for a, b, at, kind in units],
        nonzero_count=6,
        nonzeros=[
            SimpleNamespace(output=i, tangent=t, weight={0: 0, 1: 1, 4: 6}.get(i, -1))
            for i, t in zip(outputs, tangents, strict=True)
        ],
    )
    values, slopes = np.array([1.0, 10.0, 100.0, 1000.0, np.nan]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan])
    rows = SimpleNamespace(
        whitening=np.array([2.0, 3.0, 5.0, 0.0, 7.0, 11.0, 0.0]),
        columns=places,
        data=SimpleNamespace(blocks=[SimpleNamespace(weights=0, columns=0)]),
    )
    plain = np.zeros((5, 3))
    for i, t, slope in zip(outputs[:5], tangents[:5], slopes, strict=False):
        if places[t] >= 0:
            plain[i, places[t]] += slope
    residuals, jacobian = np.full(5, -1.0), np.full(15, -1.0)
    kernel = np.concatenate([values, slopes])
    whiten_slopes(SimpleNamespace(n=3, blocks=[block]), rows, 0, 0, kernel, np.zeros(15), residuals, jacobian)
    assert residuals.tolist() == (whole @ np.nan_to_num(values)).tolist()
    assert jacobian.reshape(5, 3).tolist() == (whole @ plain).tolist()


@pytest.mark.parametrize(("kind", "size", "tangents"), [(1, 1, 1), (2, 4, 3), (3, 3, 2)])
def test_numbers_that_turn_are_described(kind, size, tangents):
    piece = SimpleNamespace()
    problem = SimpleNamespace(
        number_of=np.full(9, 5), positive=np.full(9, 5), components=[None, piece], component_count=1
    )
    column = np.array([4, -1, 7][:tangents])
    set_component(problem, kind, 20, column)
    free = [place for place in column if place >= 0]
    assert problem.component_count == 2
    assert problem.number_of[free].tolist() == [-1] * len(free)
    assert problem.positive[free].tolist() == [0] * len(free)
    assert (problem.number_of == 5).sum() == (problem.positive == 5).sum() == 9 - len(free)
    numbers = [piece.number_0, piece.number_1, piece.number_2, piece.number_3]
    assert (piece.kind, numbers[:size]) == (kind, list(range(20, 20 + size)))
    assert [piece.column_0, piece.column_1, piece.column_2] == [*column, -1, -1][:3]


def test_numbers_that_stay_are_no_component():
    problem = SimpleNamespace(number_of=np.full(9, 5), positive=np.full(9, 5), components=[], component_count=0)
    set_component(problem, 2, 20, np.array([-1, -1, -1]))
    assert problem.component_count == 0
