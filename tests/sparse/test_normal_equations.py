"""Blocks, elimination, factors and the selected inverse agree with the dense matrices they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.sparse.system import factorised, plan
from mbm.sparse.triangles import triangularised
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


def test_the_triangle_of_the_jacobian_is_the_same_factor(way, backend):
    network = Network(seed=3)
    found = plan(network.structure(), backend)
    jacobian, added = network.jacobian(), np.linspace(0.0, 1.0, network.columns)
    whole = jacobian.T @ jacobian + np.diag(added)
    factors = triangularised(found, network.values(), added)
    right = np.random.default_rng(5).standard_normal((network.columns, 3))
    np.testing.assert_allclose(factors.solve(right), np.linalg.solve(whole, right), atol=ROUNDING)
    other = factorised(found, found.accumulate(network.values()), added)
    for key, blocks in factors.inverse().items():
        np.testing.assert_allclose(blocks, other.inverse()[key], atol=ROUNDING)
    diagonal = np.diag(whole)
    assert factors.least_pivot(diagonal) == pytest.approx(other.least_pivot(diagonal), rel=ROUNDING)


def test_the_triangle_keeps_what_the_normal_equations_lose(way, backend):
    """The shared numbers' columns a and z become a and a + 1e-9 z: 1e-18 beside 1 in ``JᵀJ``, 1e-7 of it roundings."""
    network = Network(seed=4)
    found, (seen, tied) = plan(network.structure(), backend), network.values()
    jacobian = network.jacobian()
    expected = np.linalg.inv(jacobian.T @ jacobian)[-1, -1] * 1e18
    seen[:, :, 8] = seen[:, :, 7] + 1e-9 * seen[:, :, 8]
    factors = triangularised(found, [seen, tied], np.zeros(network.columns))
    unit = np.eye(network.columns)[:, -1:]
    assert factors.solve(unit)[-1, 0] == pytest.approx(expected, rel=1e-6)


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
