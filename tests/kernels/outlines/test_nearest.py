"""Which of many chords is nearest to a point, against shapely's distances."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from mbm.kernels.outlines.distances import _nearest


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("count", [5, 40, 700])
def test_nearest_chords(count, uneven):
    """Near the line, far away and within; with chords of one length, and of lengths from 1 to 10,000."""
    rng = np.random.default_rng(count)
    turn = np.sort(rng.beta(0.2, 0.2, count) if uneven else rng.random(count)) * 2 * np.pi
    ring = (100 + 40 * np.cos(5 * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ways = np.roll(ring, -1, axis=0) - ring
    shares = rng.random((400, 1))
    near = (ring + rng.normal(size=ring.shape))[rng.integers(0, count, 400)] + shares * 2
    points = np.concatenate([near, rng.uniform(-400, 400, (400, 2)), rng.normal(size=(100, 2))])
    chords = shapely.linestrings(np.stack([ring, ring + ways], axis=1))
    expected = shapely.distance(shapely.points(points)[:, None], chords[None]).min(axis=1)
    found = shapely.distance(shapely.points(points), chords[_nearest(points, ring, ways)])
    np.testing.assert_allclose(found, expected, atol=1e-10)
