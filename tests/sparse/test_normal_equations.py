"""Blocks, elimination, factors and the selected inverse agree with the dense matrices they stand for."""

from __future__ import annotations

import numpy as np

from mbm.sparse.system import factorised, plan
from tests.sparse.networks import Network

ROUNDING = 1e-11
"""Matrices of a few hundred rows with condition numbers up to 1e3."""


def test_the_matrix_of_the_pieces_is_the_jacobian():
    network = Network()
    found = network.structure()
    np.testing.assert_array_equal(found.matrix(network.values()).toarray(), network.jacobian())


def test_normal_equations_and_their_solution(way, backend):
    network = Network()
    found = plan(network.structure(), backend)
    assert found.elimination is not None
    assert found.elimination.family == 1  # no two points meet, and they are most of the columns
    assert (found.fronts is not None) == (way == "fronts")
    normal = found.accumulate(network.values())
    jacobian = network.jacobian()
    whole = jacobian.T @ jacobian
    np.testing.assert_allclose(normal.diagonal(), np.diag(whole), rtol=ROUNDING)
    added = np.linspace(0.1, 1.0, network.columns)
    factors = factorised(found, normal, added)
    right = np.random.default_rng(5).standard_normal((network.columns, 3))
    expected = np.linalg.solve(whole + np.diag(added), right)
    np.testing.assert_allclose(factors.solve(right), expected, atol=ROUNDING)
    np.testing.assert_allclose(factors.solve(right[:, :1]), expected[:, :1], atol=ROUNDING)


def test_the_inverse_on_the_pattern(way, backend):
    network = Network(seed=2)
    found = plan(network.structure(), backend)
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
    alone = factors.inverse(across=False)
    for key, blocks in alone.items():
        np.testing.assert_allclose(blocks, factors.inverse()[key], atol=ROUNDING)
    assert found.elimination.family in {family for key in alone for family in key}


def test_a_matrix_that_is_not_positive_has_no_factor(way, backend):
    network = Network()
    found = plan(network.structure(), backend)
    normal = found.accumulate(network.values())
    assert factorised(found, normal, np.full(network.columns, -1e3)) is None
