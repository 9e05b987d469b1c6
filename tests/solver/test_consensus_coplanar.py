"""Stations in a plane, judged by the Python that is printed, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.machine.records import put, slots_of, view
from mbm.solver import consensus_records as c
from mbm.solver.consensus_begin import MOMENTS, one_sided, smallest_share


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_the_smallest_share_is_that_of_the_eigenvalues(d, seed):
    factor = np.random.default_rng(seed).normal(size=(d, d))
    matrix = factor @ factor.T
    values = np.linalg.eigvalsh(matrix)
    # both are off by some units in the last place of the largest eigenvalue
    assert smallest_share(d, matrix.ravel().copy()) == pytest.approx(values[0] / values[-1], rel=1e-9, abs=1e-14)


def rules_of_spheres(d, offset):
    """Rules whose closed form is that of spheres in d dimensions."""
    head = slots_of(c.Rules)
    rules = np.zeros(head + 8, dtype=np.int64)
    put(rules, c.Rules, form=c.SPHERES, about=head, form_width=d + 3)
    rules[head : head + 2] = d, offset
    return view(c.Rules, rules)


def stations(extent: float) -> np.ndarray:
    """Ten stations about a tilted plane, as far off it as ``extent`` says, and one of which nothing is known."""
    generator = np.random.default_rng(3)
    axes = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    places = (generator.normal(size=(10, 3)) * [5.0, 3.0, extent]) @ axes + [100.0, -20.0, 7.0]
    return np.vstack([np.hstack([places, np.ones((10, 3))]), np.full((1, 6), np.nan)])


@pytest.mark.parametrize(("extent", "offset", "flat"), [(0.0, 0, 1), (1e-3, 0, 0), (0.0, 1, 0)])
def test_stations_in_a_plane_see_mirrored_places_alike(extent, offset, flat):
    assert one_sided(rules_of_spheres(3, offset), 11, stations(extent).ravel(), np.zeros(MOMENTS)) == flat
