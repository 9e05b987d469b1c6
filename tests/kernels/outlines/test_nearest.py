"""Which of many chords is nearest to a point, against shapely's distances; feet on polynomials, against their roots."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.polynomial import Polynomial

from mbm.kernels.outlines.distances import _nearest, _on_polynomials, _polynomials


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


def test_points_that_are_nowhere_leave_the_others_alone():
    turn = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ways = np.roll(ring, -1, axis=0) - ring
    points = np.array([[np.nan, 0.0], *(1.3 * (ring + ways / 2)), [np.inf, np.nan]])
    assert _nearest(points, ring, ways)[1:-1].tolist() == list(range(300))
    assert _nearest(np.tile(points[1], (3, 1)), ring, ways).tolist() == [0, 0, 0]


def test_feet_on_polynomials():
    """Spans that turn by about half a rad, from values and derivatives at three places; the foot is a root."""
    rng = np.random.default_rng(5)
    power = np.array([40.0, 40.0, 5.0, 1.0, 0.2, 0.05])
    made = [[Polynomial(power * rng.uniform(-1, 1, 6)) for _ in range(2)] for _ in range(30)]
    nodes = np.array([-1.0, 0.0, 1.0])
    images = np.array([[each[k](nodes) for each in made] for k in range(2)]).swapaxes(1, 2)
    slopes = np.array([[each[k].deriv()(nodes) for each in made] for k in range(2)]).swapaxes(1, 2)
    places = rng.uniform(-0.9, 0.9, len(made))
    points = np.array([[each[k](place) for each, place in zip(made, places, strict=True)] for k in range(2)])
    points += rng.normal(size=points.shape)
    found = _on_polynomials(points, _polynomials(images, slopes), places + rng.uniform(-0.05, 0.05, len(made)))
    for point, (x, y), foot in zip(points.T, made, found, strict=True):
        roots = ((x - point[0]) * x.deriv() + (y - point[1]) * y.deriv()).roots()
        expected = roots.real[np.abs(roots.imag) < 1e-9]
        assert np.abs(expected - foot).min() < 1e-7  # four of Newton's steps from a twentieth
