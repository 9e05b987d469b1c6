"""What sparse problems leave free, and the covariance of the rest, against the dense pseudo-inverse."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.sparse import system
from mbm.sparse.rank import PART, decided, free_count, orthonormal
from mbm.sparse.system import plan
from tests.sparse.networks import Network

SAME = 1e-9
"""Relative, after a pseudo-inverse of condition 1e4."""


@pytest.fixture(params=[400, 0], ids=["dense", "fronts"])
def narrow(request, monkeypatch):
    monkeypatch.setattr(system, "NARROW", request.param)
    if not request.param:
        monkeypatch.setattr(system, "WIDE", 0)


def tied_to_the_shared_numbers(network):
    """Values in which stations and points notice only their difference from the shared numbers' first column."""
    seen, tied = network.values()
    seen, tied = seen.copy(), tied.copy()
    seen[:, :, 7] = -seen[:, :, 0] - seen[:, :, 4]  # all first columns together: free
    tied[:, :, 0] = -tied[:, :, 4]
    return [seen, tied]


def dense(network, values):
    return network.structure().matrix(values).toarray()


def pseudo_inverse(jacobian, scale):
    return np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), rcond=1e-12, hermitian=True) / np.outer(
        scale, scale
    )


def test_a_common_free_direction_is_found_and_taken_out(narrow):
    network = Network(seed=3)
    values = tied_to_the_shared_numbers(network)
    found = decided(plan(network.structure()), values, np.zeros(network.columns, dtype=bool))
    assert found.inverse.null.shape[1] == 1
    assert found.complete
    jacobian = dense(network, values)
    assert np.abs(jacobian @ (found.inverse.null[:, 0] / found.inverse.scale)).max() < 1e-12
    expected = pseudo_inverse(jacobian, found.inverse.scale)
    np.testing.assert_allclose(found.inverse.variances(), np.diag(expected), rtol=SAME)
    chosen = np.eye(network.columns)[:, [0, 40, network.columns - 1]]
    np.testing.assert_allclose(found.inverse.solve(chosen), expected[:, [0, 40, network.columns - 1]], atol=SAME)


def test_members_that_are_seen_too_little_are_free_by_themselves(narrow):
    network = Network(seed=4)
    seen, tied = network.values()
    point = network.structure().pieces[0].members[1]
    seen[point == 7, :, 6] = 0.0  # the third column of point 7 is in no equation
    seen[point == 9, :, 5] = 2.0 * seen[point == 9, :, 4]  # two columns of point 9 only together
    found = decided(plan(network.structure()), [seen, tied], np.zeros(network.columns, dtype=bool))
    assert found.inverse.local.members.tolist() == [9]
    assert np.flatnonzero(found.unused).tolist() == [4 * network.stations + 3 * 7 + 2]
    jacobian = dense(network, [seen, tied])
    variances = np.diag(pseudo_inverse(jacobian, found.inverse.scale)).copy()
    known = ~found.unused
    np.testing.assert_allclose(found.inverse.variances()[known], variances[known], rtol=SAME)


def test_leverages_are_the_diagonal_of_the_hat_matrix(narrow):
    network = Network(seed=5)
    values = tied_to_the_shared_numbers(network)
    found = decided(plan(network.structure()), values, np.zeros(network.columns, dtype=bool))
    jacobian = dense(network, values)
    hat = np.einsum("ij,jk,ik->i", jacobian, pseudo_inverse(jacobian, found.inverse.scale), jacobian)
    leverages = found.inverse.leverages(values, np.zeros(network.columns, dtype=bool))
    np.testing.assert_allclose(leverages, hat, atol=SAME)
    assert leverages.sum() == pytest.approx(network.columns - 1, abs=1e-8)  # the rank


def test_held_columns_count_as_known(narrow):
    network = Network(seed=6)
    held = np.zeros(network.columns, dtype=bool)
    held[[0, 30]] = True
    found = decided(plan(network.structure()), network.values(), held)
    jacobian = network.jacobian()[:, ~held]
    expected = np.diag(np.linalg.inv(jacobian.T @ jacobian))
    np.testing.assert_allclose(found.inverse.variances()[~held], expected, rtol=SAME)


@pytest.mark.parametrize(
    ("shares", "count"),
    [
        ([1e-16, 1e-15, 1e-3], 2),
        ([1e-10, 1e-3], 1),
        ([1e-10, 1e-9, 1e-8], 0),
        ([2e-9, 1e-3], 0),
        ([1e-3, 1e-2], 0),
        ([1e-16, 1e-16], 2),
    ],
)
def test_zero_is_what_is_far_below_the_next(shares, count):
    assert free_count(np.array(shares)) == count


@pytest.mark.parametrize("rows", [7, PART, PART + 3, 5 * PART + 1])
@pytest.mark.parametrize("smallest", [1.0, 1e-14, 0.0])
def test_tall_matrices_have_an_orthonormal_basis_by_parts(rows, smallest):
    rng = np.random.default_rng(8)
    columns = rng.standard_normal((rows, 7)) * np.append(np.geomspace(1.0, 1e-8, 6), smallest)
    basis = orthonormal(columns)
    assert basis.shape == columns.shape
    # Householder reflections: a few units of rounding for each of the 7 columns, whatever the condition.
    np.testing.assert_allclose(basis.T @ basis, np.eye(7), atol=1e-14)
    outside = columns - basis @ (basis.T @ columns)
    assert (np.linalg.norm(outside, axis=0) <= 1e-14 * np.linalg.norm(columns, axis=0).max()).all()
