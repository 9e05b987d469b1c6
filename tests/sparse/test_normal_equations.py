"""Blocks, elimination, factors and the selected inverse agree with the dense matrices they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.sparse import system
from mbm.sparse.cholesky import factorise
from mbm.sparse.fronts import fronts
from mbm.sparse.system import factorised, plan
from tests.sparse.networks import Network

ROUNDING = 1e-11
"""Matrices of a few hundred rows with condition numbers up to 1e3."""

WAYS = {"dense": {}, "fronts": {"NARROW": 0, "WIDE": 0}, "filled": {"NARROW": 0, "FULL": 0.0}}


@pytest.fixture(params=WAYS, ids=list(WAYS))
def way(request, monkeypatch):
    for name, value in WAYS[request.param].items():
        monkeypatch.setattr(system, name, value)
    return request.param


def test_the_matrix_of_the_pieces_is_the_jacobian():
    network = Network()
    found = network.structure()
    np.testing.assert_array_equal(found.matrix(network.values()).toarray(), network.jacobian())


def test_normal_equations_and_their_solution(way):
    network = Network()
    found = plan(network.structure())
    assert found.elimination is not None
    assert found.elimination.family == 1  # no two points meet, and they are most of the columns
    assert (found.tree is not None) == (way == "fronts")
    normal = found.accumulate(network.values())
    jacobian = network.jacobian()
    whole = jacobian.T @ jacobian
    np.testing.assert_allclose(normal.diagonal(), np.diag(whole), rtol=ROUNDING)
    added = np.linspace(0.1, 1.0, network.columns)
    factors = factorised(found, normal, added)
    right = np.random.default_rng(5).standard_normal((network.columns, 3))
    expected = np.linalg.solve(whole + np.diag(added), right)
    np.testing.assert_allclose(factors.solve(right), expected, atol=ROUNDING)


def test_the_inverse_on_the_pattern(way):
    network = Network(seed=2)
    found = plan(network.structure())
    added = np.full(network.columns, 0.5)
    factors = factorised(found, found.accumulate(network.values()), added)
    jacobian = network.jacobian()
    expected = np.linalg.inv(jacobian.T @ jacobian + np.diag(added))
    families = found.structure.families
    checked = 0
    for key, blocks in factors.inverse().items():
        pair, left, right = found.pattern.pairs[key], families[key[0]], families[key[1]]
        for block, i, j in zip(blocks, pair.i, pair.j, strict=True):
            rows = slice(left.first + i * left.size, left.first + (i + 1) * left.size)
            columns = slice(right.first + j * right.size, right.first + (j + 1) * right.size)
            np.testing.assert_allclose(block, expected[rows, columns], atol=ROUNDING)
            checked += 1
    assert checked > 300


def test_a_matrix_that_is_not_positive_has_no_factor(way):
    network = Network()
    found = plan(network.structure())
    normal = found.accumulate(network.values())
    assert factorised(found, normal, np.full(network.columns, -1e3)) is None


@pytest.mark.parametrize("seed", range(4))
def test_fronts_of_random_graphs(seed):
    generator = np.random.default_rng(seed)
    sizes = generator.integers(1, 5, 60)
    block = np.repeat(np.arange(60), sizes)
    graph = generator.random((60, 60)) < 0.03 * (seed + 1)
    mask = (graph | graph.T | np.eye(60, dtype=bool))[np.ix_(block, block)]
    matrix = generator.standard_normal(mask.shape) * mask
    matrix = matrix + matrix.T + 60.0 * np.eye(len(block))
    rows, columns = np.nonzero(np.triu(mask))
    tree = fronts(rows, columns, sizes)
    factor = factorise(tree, matrix[rows, columns])
    right = generator.standard_normal((len(block), 2))
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(matrix, right), atol=ROUNDING)
    inverse = factor.inverse(len(rows))
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix)[rows, columns], atol=ROUNDING)
    assert sorted(tree.order) == list(range(len(block)))
