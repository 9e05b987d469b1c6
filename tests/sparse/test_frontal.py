"""Compiled fronts and their order: against dense matrices, and against the order that SciPy finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from mbm.kernels.store import standard_store
from mbm.kernels.types import MachineCode
from mbm.sparse import frontal
from mbm.sparse.frontal import Fronts, fronts
from mbm.sparse.routines import Making

pytest.importorskip("llvmlite")


@pytest.fixture(scope="module")
def made():
    return Making(MachineCode(store=standard_store()), 0).front_routines()


def matrix(generator, blocks: int, density: float):
    """A positive definite matrix of random blocks, its entries' rows and columns (upper triangle), and block sizes."""
    sizes = generator.integers(1, 7, blocks)
    met = np.triu(generator.random((blocks, blocks)) < density, 1) | np.eye(blocks, dtype=bool)
    block_of = np.repeat(np.arange(blocks), sizes)
    filled = np.triu((met | met.T)[block_of][:, block_of])
    dense = np.where(filled, generator.standard_normal(filled.shape), 0.0)
    dense = np.triu(dense, 1) + np.triu(dense, 1).T
    dense += np.diag(np.abs(dense).sum(axis=1) + 1.0)
    row, column = np.nonzero(filled)
    return dense, row, column, sizes


def compiled(made, row, column, sizes):
    tree = fronts(row, column, sizes, lambda *graph: frontal.minimum_degree(made, *graph))
    return frontal.front_solver(tree, made)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.0, 0.03, 0.1, 0.5, 1.0]))
@settings(max_examples=60)
def test_factor_solutions_and_inverse_are_those_of_the_dense_matrix(made, seed, blocks, density):
    generator = np.random.default_rng(seed)
    dense, row, column, sizes = matrix(generator, blocks, density)
    factor = compiled(made, row, column, sizes).factorise(dense[row, column])
    right = generator.standard_normal((len(dense), 3))
    # Diagonally dominant matrices: conditions below 1e3, so that rounding leaves 1e-12 with room.
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=0, atol=1e-12)
    np.testing.assert_allclose(factor.inverse(len(row)), np.linalg.inv(dense)[row, column], rtol=0, atol=1e-12)


def test_a_matrix_that_is_not_positive_has_no_factor(made):
    dense, row, column, sizes = matrix(np.random.default_rng(1), 20, 0.2)
    found = compiled(made, row, column, sizes)
    for wrong in (-1.0, np.nan, np.inf):
        entries = dense[row, column]
        entries[np.flatnonzero(row == column)[-1]] = wrong
        assert found.factorise(entries) is None
    assert found.factorise(dense[row, column]) is not None


def grid(side: int):
    """The graph of a square grid."""
    place = np.arange(side * side).reshape(side, side)
    left = np.concatenate([place[:, :-1].ravel(), place[:-1].ravel(), place.ravel()])
    return left, np.concatenate([place[:, 1:].ravel(), place[1:].ravel(), place.ravel()]), np.ones(side**2, dtype=int)


def scipys(left, right, sizes):
    """Multiple minimum degree of the graph of blocks (Liu 1985): the block at each place."""
    count, ones = len(sizes), np.ones(len(left))
    graph = coo_array((ones, (left, right)), shape=(count, count)).tocsc()
    graph.data[:] = -1.0
    graph = graph + graph.T
    weight = np.asarray(abs(graph).sum(axis=0)).reshape(-1) + 1.0
    graph.setdiag(2.0 * weight)
    options = {"SymmetricMode": True}
    factor = splu(graph.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    order = np.empty(count, dtype=np.int64)
    order[factor.perm_c] = np.arange(count)
    return order


def entries_of(tree: Fronts) -> int:
    return sum(front.width * len(front.rows) for front in tree.fronts)


@pytest.mark.parametrize("side", [5, 30, 60])
def test_the_order_fills_no_more_than_scipys(made, side):
    graph = grid(side)
    order = frontal.minimum_degree(made, *graph)
    assert np.array_equal(np.sort(order), np.arange(side**2))
    ours = fronts(*graph, lambda *given: frontal.minimum_degree(made, *given))
    # Orders of minimum degree differ by how they break ties, on grids by a tenth or two.
    assert entries_of(ours) <= 1.3 * entries_of(fronts(*graph, scipys))


def test_columns_that_weigh_more_come_later(made):
    """In a star whose centre is one column wide and whose rays are three, all of one degree come before the centre."""
    rays = 20
    left, right = np.zeros(rays, dtype=np.int64), np.arange(1, rays + 1)
    order = frontal.minimum_degree(made, left, right, np.array([1, *[3] * rays]))
    assert order.tolist().index(0) >= rays - 1


def test_an_order_for_which_room_was_too_little_is_found_again(made, monkeypatch):
    generator = np.random.default_rng(3)
    left, right = np.nonzero(np.triu(generator.random((150, 150)) < 0.05, 1))
    sizes = np.ones(150, dtype=np.int64)
    wanted = frontal.minimum_degree(made, left, right, sizes)
    monkeypatch.setattr(frontal, "ROOM", 1)
    calls = []
    call = type(made).call
    monkeypatch.setattr(type(made), "call", lambda self, *given: calls.append(1) or call(self, *given))
    assert np.array_equal(frontal.minimum_degree(made, left, right, sizes), wanted)
    assert len(calls) > 1


def test_fronts_stand_in_postorder(made):
    """All fronts below one come directly before it: the stack of updates and the path of parts rely on it."""
    _, row, column, sizes = matrix(np.random.default_rng(8), 80, 0.03)
    tree = fronts(row, column, sizes, lambda *graph: frontal.minimum_degree(made, *graph))
    below = [1] * len(tree.fronts)
    for number, front in enumerate(tree.fronts):
        if front.parent >= 0:
            assert front.parent > number
            below[front.parent] += below[number]
    for number in range(len(tree.fronts)):
        inside = range(number - below[number] + 1, number)
        assert all(tree.fronts[k].parent in range(number - below[number] + 1, number + 1) for k in inside)


@pytest.mark.parametrize("sizes", [[1] * 9, [1, 3, 1, 1, 2, 1]])
def test_columns_that_touch_no_other(made, sizes):
    generator = np.random.default_rng(4)
    blocks = np.array(sizes)
    owner = np.repeat(np.arange(len(blocks)), blocks)
    whole = np.where(owner[:, None] == owner, generator.standard_normal((len(owner), len(owner))), 0.0)
    whole = whole @ whole.T + np.eye(len(owner))
    row, column = np.nonzero(np.triu(whole))
    solver = compiled(made, row, column, blocks)
    factor = solver.factorise(whole[row, column])
    right = generator.standard_normal((len(owner), 3))
    # Of well conditioned matrices of nine rows, the roundings are those of a few operations.
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(whole, right), rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(factor.inverse(len(row)), np.linalg.inv(whole)[row, column], rtol=1e-11, atol=1e-13)
    assert solver.factorise(np.where(row == column, -1.0, whole[row, column])) is None
