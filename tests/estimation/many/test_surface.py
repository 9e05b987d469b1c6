"""Surfaces of constraints in many solves: the rank decision and covariance that each has by itself."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.equations.metric import metric, scale_of
from mbm.estimation.batches.factor import factors
from mbm.estimation.batches.surface import Held, lengths, tangents
from mbm.estimation.uncertainty.observability import Surface, covariance, observability


def drawn(generator, solves=40, rows=9, width=5, most=4):
    """Jacobians, slopes of constraints (the last is twice the first), which of them hold, and which are equations."""
    jacobian = generator.standard_normal((solves, rows, width)) * np.array([1.0, 1e3, 1e-4, 1.0, 30.0])
    slopes = generator.standard_normal((solves, most, width))
    slopes[:, -1] = -2.0 * slopes[:, 0]
    forcing = generator.random((solves, most)) < 0.5
    equality = forcing & (generator.random((solves, most)) < 0.4)
    return jacobian, slopes, forcing, equality


def held(slopes, forcing, equality):
    none = np.zeros(forcing.shape, dtype=bool)
    values = np.zeros(forcing.shape)
    return Held(
        values=values, slopes=slopes, there=~none, equality=equality, violated=none, active=forcing, forcing=forcing
    )


@pytest.mark.parametrize("felt", [True, False])
def test_rank_and_covariance_are_those_of_each_solve(felt):
    """``felt`` False: the last unknown is in constraints alone, which leave it free where too few hold."""
    jacobian, slopes, forcing, equality = drawn(np.random.default_rng(3))
    if not felt:
        jacobian[:, :, 4] = 0.0
    along = tangents(held(slopes, forcing, equality), jacobian)
    found = factors(jacobian, along)
    counts = []
    for k in range(len(jacobian)):
        surface = Surface(slopes=slopes[k, forcing[k]], equality=equality[k, forcing[k]]) if forcing[k].any() else None
        alone = observability(jacobian[k], np.ones(5), np.zeros(5, dtype=bool), surface)
        assert along.clear[k]
        assert found.good[k] == alone.observable
        if not found.good[k]:
            continue
        counts.append(int(along.taken[k]))
        assert 5 - along.taken[k] + along.equalities[k] == alone.rank == alone.dimension
        there = covariance(alone).matrix
        size = np.sqrt(np.outer(np.diag(there), np.diag(there)))
        # both are backward stable, with conditions below 1e4
        assert np.abs(found.root[k] @ found.root[k].T - there).max() <= 1e-9 * size.max()
        np.testing.assert_allclose(
            np.sqrt(np.diag(found.root[k] @ found.root[k].T)), np.sqrt(np.diag(there)), rtol=1e-8
        )
        assert not found.root[k][:, : along.taken[k]].any()
    assert len(set(counts)) > 2


def test_constraints_that_depend_on_one_another_nearly_are_left_alone():
    jacobian, slopes, _, _ = drawn(np.random.default_rng(4))
    slopes[:, 1] = slopes[:, 0] * (1.0 + 1e-9 * np.arange(5))
    jacobian /= lengths(jacobian)[:, None]  # so that no coordinate is so weak that the difference is drowned by it
    every = np.ones(slopes.shape[:2], dtype=bool)
    assert not tangents(held(slopes, every, every), jacobian).clear.any()


def test_scales_are_those_of_each_solve():
    jacobian, slopes, _, _ = drawn(np.random.default_rng(5))
    jacobian[::2, :, 1] = 0.0
    jacobian[::3, :, 4] = 0.0
    slopes[::4, :, 4] = 0.0
    found = scale_of(lengths(jacobian), slopes)
    for k in range(len(jacobian)):
        np.testing.assert_allclose(found[k], metric(jacobian[k], slopes[k]), rtol=1e-12)  # sums in another order
