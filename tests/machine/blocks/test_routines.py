"""The texts of the routines as Python: what LLVM is given means what NumPy says."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.sparse.blocks import elimination, products, substitution
from mbm.sparse.blocks.parts import Products, product_name
from mbm.sparse.routines import blocks_module

ROUNDING = 1e-13
"""Sums of a few numbers of size 1."""


def test_products_of_blocks():
    generator = np.random.default_rng(1)
    values = generator.standard_normal((5, products.OUTPUTS, 7))
    rows, starts, targets = np.array([3, 0, 4]), np.array([0, 2, 3]), np.array([1, 0])
    blocks = np.zeros((2, 4, products.RIGHT))
    asked = Products()
    asked.targets, asked.starts, asked.rows, asked.values = targets, starts, rows, values.ravel()
    asked.width, asked.high, asked.left, asked.right = 7, 4, 0, 4
    products.add_products(0, 2, asked, blocks.ravel())
    expected = [
        values[4][:, :4].T @ values[4][:, 4:],
        values[3][:, :4].T @ values[3][:, 4:] + values[0][:, :4].T @ values[0][:, 4:],
    ]
    np.testing.assert_allclose(blocks, expected, atol=ROUNDING)


@pytest.mark.parametrize(("high", "wide"), [(1, 1), (3, 8), (4, 9), (9, 9), (7, 20)])
def test_the_product_that_is_subtracted(high, wide):
    size = elimination.SIZE
    generator = np.random.default_rng(high + wide)
    left, right = generator.standard_normal((size, 30)), generator.standard_normal((size, 30))
    target = generator.standard_normal((high, 25))
    expected = target.copy()
    expected[:, :wide] -= left[:, :high].T @ right[:, :wide]
    elimination.subtract_product(high, wide, 30, left.ravel(), right.ravel(), 25, target.reshape(-1))
    np.testing.assert_allclose(target, expected, atol=ROUNDING)


def test_inverse_roots():
    size = elimination.SIZE
    generator = np.random.default_rng(2)
    factors = generator.standard_normal((4, size, size + 3))
    blocks = factors @ factors.transpose(0, 2, 1)
    added = generator.random((4, size))
    roots = np.zeros_like(blocks)
    assert elimination.inverse_roots(0, 4, blocks.ravel(), added.ravel(), roots.reshape(-1)) == 0
    whole = blocks + added[:, :, None] * np.eye(size)
    np.testing.assert_allclose(roots, np.linalg.inv(np.linalg.cholesky(whole)), atol=1e-12)  # condition up to 1e2
    blocks[2] = -blocks[2]
    assert elimination.inverse_roots(0, 4, blocks.ravel(), added.ravel(), roots.reshape(-1)) == 3
    blocks[1, 0, 0] = np.nan
    assert elimination.inverse_roots(0, 4, blocks.ravel(), added.ravel(), roots.reshape(-1)) == 2


def test_triangular_solution():
    generator = np.random.default_rng(3)
    lower = np.tril(generator.standard_normal((6, 6))) + 4.0 * np.eye(6)
    right = generator.standard_normal(6)
    expected = np.linalg.solve(lower @ lower.T, right)
    substitution.solve_triangular(6, lower.ravel(), right)
    np.testing.assert_allclose(right, expected, atol=ROUNDING)


def test_the_module_has_a_product_for_each_size():
    found = [f.name for f in blocks_module([(2, 9), (3, 6)], None).functions if f.public]
    assert {product_name(2, 9), product_name(3, 6), "put_image"} <= set(found)
    assert "put_couplings" not in found
    assert "put_couplings" in [f.name for f in blocks_module([], 3).functions]
