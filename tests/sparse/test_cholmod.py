"""CHOLMOD in place of the fronts gives the same answers; runs where scikit-sparse is installed."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.sparse import system
from mbm.sparse.cholmod import CholmodFactor
from mbm.sparse.system import factorised, plan
from tests.sparse.networks import Network

pytest.importorskip("sksparse.cholmod", reason="scikit-sparse is not installed")

ROUNDING = 1e-11


def test_the_library_solves_as_the_fronts_do(monkeypatch):
    monkeypatch.setattr(system, "NARROW", 0)
    monkeypatch.setattr(system, "WIDE", 0)
    network = Network()
    found = plan(network.structure())
    normal = found.accumulate(network.values())
    added = np.linspace(0.1, 1.0, network.columns)
    factors = factorised(found, normal, added)
    assert isinstance(factors.rest, CholmodFactor)
    jacobian = network.jacobian()
    whole = jacobian.T @ jacobian + np.diag(added)
    right = np.eye(network.columns)[:, :3]
    np.testing.assert_allclose(factors.solve(right), np.linalg.solve(whole, right), atol=ROUNDING)
    diagonal = np.concatenate(
        [np.einsum("bii->bi", factors.inverse()[f, f][w]).ravel() for f, w in enumerate(found.pattern.diagonal)]
    )
    np.testing.assert_allclose(diagonal, np.diag(np.linalg.inv(whole)), atol=ROUNDING)
    assert factorised(found, normal, np.full(network.columns, -1e3)) is None
