"""Routines of generated solvers, run as the Python that they are, against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mbm.emit.routines.forms import MOMENTS, one_sided, smallest_share
from mbm.emit.routines.rooms import MANY, connected
from mbm.target.solver import consensus_description as c
from mbm.target.solver import description as at


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_the_smallest_share_is_that_of_the_eigenvalues(d, seed):
    factor = np.random.default_rng(seed).normal(size=(d, d))
    matrix = factor @ factor.T
    values = np.linalg.eigvalsh(matrix)
    # both are off by some units in the last place of the largest eigenvalue
    assert smallest_share(d, matrix.ravel().copy()) == pytest.approx(values[0] / values[-1], rel=1e-9, abs=1e-14)


def rules_of_spheres(d: int, offset: int) -> np.ndarray:
    """Rules whose closed form is that of spheres in d dimensions."""
    rules = np.zeros(c.HEADER + 8, dtype=np.int64)
    rules[c.FORM], rules[c.FORM_AT], rules[c.FORM_WIDTH] = c.SPHERES, c.HEADER, d + 3
    rules[c.HEADER : c.HEADER + 2] = d, offset
    return rules


def stations(extent: float) -> np.ndarray:
    """Ten stations about a tilted plane, as far off it as ``extent`` says, and one of which nothing is known."""
    generator = np.random.default_rng(3)
    axes = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    places = (generator.normal(size=(10, 3)) * [5.0, 3.0, extent]) @ axes + [100.0, -20.0, 7.0]
    return np.vstack([np.hstack([places, np.ones((10, 3))]), np.full((1, 6), np.nan)])


@pytest.mark.parametrize(("extent", "offset", "flat"), [(0.0, 0, 1), (1e-3, 0, 0), (0.0, 1, 0)])
def test_stations_in_a_plane_see_mirrored_places_alike(extent, offset, flat):
    assert one_sided(rules_of_spheres(3, offset), 11, stations(extent).ravel(), np.zeros(MOMENTS)) == flat


def system_with(n: int, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``system`` and ``data`` of one block whose rows have derivatives by ``columns`` (rows, k)."""
    system = np.zeros(at.HEADER + at.BLOCK, dtype=np.int64)
    system[at.COORDINATES], system[at.BLOCKS], system[at.BLOCKS_AT] = n, 1, at.HEADER
    system[at.HEADER + at.BLOCK_TANGENTS] = system[at.HEADER + at.BLOCK_COLUMNS] = columns.shape[1]
    data = np.zeros(at.DATA_HEAD + at.DATA_BLOCK, dtype=np.int64)
    data[at.DATA_HEAD + at.DATA_ROWS] = len(columns)
    return system, data


@pytest.mark.parametrize("rows", [3, 6, 9, 12])
@pytest.mark.parametrize("seed", range(6))
def test_connected_is_what_the_graph_of_the_equations_is(rows, seed):
    n = 6
    columns = np.random.default_rng(seed).integers(-1, n, size=(rows, 2))  # -1: a coordinate that stays
    edges = columns[(columns >= 0).all(axis=1)]
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    parts, _ = connected_components(graph, directed=False)
    system, data = system_with(n, columns)
    assert connected(system, data, columns.ravel(), np.zeros(n, dtype=np.int64)) == (parts == 1)


def test_many_unknowns_are_none_of_it():
    n = MANY + 1
    columns = np.stack([np.zeros(n - 1, dtype=np.int64), np.arange(1, n)], axis=1)
    system, data = system_with(n, columns)
    assert connected(system, data, columns.ravel(), np.zeros(n, dtype=np.int64)) == 0
