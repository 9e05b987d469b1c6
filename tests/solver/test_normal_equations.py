"""Factors from sums of products against NumPy's, in every target."""

from __future__ import annotations

import numpy as np
import pytest

EPSILON = np.finfo(float).eps


def columns_of(rows):
    return np.ascontiguousarray(rows.T).ravel()


def sums_of(solver, whole):
    found = np.zeros((whole.shape[1],) * 2)
    for first in range(0, len(whole), 20):
        part = whole[first : first + 20]
        solver("add_products", whole.shape[1], len(part), len(part), columns_of(part), found)
    return found


def factor(solver, whole):
    n = whole.shape[1] - 1
    triangle = sums_of(solver, whole)
    scratch = [np.full((n, n), np.nan) for _ in range(3)]
    square = solver("rooted", n, float(whole[:, n] @ whole[:, n]), triangle, np.zeros(n), *scratch)
    return square, triangle


def test_the_triangle_of_well_conditioned_rows(solver):
    whole = np.random.default_rng(1).standard_normal((60, 6)) * np.array([1, 1e-9, 1e9, 3, 7, 2])
    square, triangle = factor(solver, whole)
    wanted = np.linalg.qr(whole, mode="r")
    wanted *= np.sign(np.diag(wanted))[:, None]
    # Columns of condition 2 once they are scaled, whatever their units: some hundred roundings in each entry.
    scale = np.linalg.norm(whole, axis=0)
    np.testing.assert_allclose(triangle / scale, wanted / scale, rtol=0, atol=200 * EPSILON)
    condition = np.linalg.cond(whole[:, :5] / scale[:5])
    # Frobenius' norms are between the spectral ones and √n times those, twice.
    assert condition**2 <= square * (1 + 1e-12)
    assert square <= 25 * condition**2


@pytest.mark.parametrize("spoil", ["equal", "zero", "nan"])
def test_no_factor_of_what_is_not_positive_definite(solver, spoil):
    whole = np.random.default_rng(2).standard_normal((30, 4))
    whole[:, 1] = {"equal": whole[:, 0], "zero": 0.0, "nan": np.nan}[spoil]
    square, _ = factor(solver, whole)
    # Equal columns leave a pivot of zero or of a rounding.
    assert not square < 1e14
