"""Positions from distances: general and flat stations, few and many, with an unknown offset."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.solver.spheres import places_of_ranges
from mbm.solver.workspace import MOST_PLACES, SCRATCH, Ranges

EXACT = 1e-9
"""Squares of distances lose half the digits of what is small beside them; the scenes are of the size of one to ten."""


def places(stations, lengths, extra, slopes, weights=None, **kind):
    """All that the closed form says (k, m), which runs as Python here."""
    count, d = stations.shape
    ranges = Ranges()
    ranges.d, ranges.offset, ranges.even, ranges.rows = d, kind.get("offset", 0), 0, count
    ranges.spheres = np.column_stack([stations, lengths, extra, slopes]).ravel()
    ranges.weights = np.ones(count) if weights is None else weights.copy()
    ranges.scratch, found = np.empty(SCRATCH), np.empty(MOST_PLACES * (d + ranges.offset))
    number = places_of_ranges(ranges, found)
    return found.reshape(MOST_PLACES, -1)[:number]


def positions(stations, squares, weights=None):
    """Places whose squared distances are measured."""
    zero = np.zeros(len(stations))
    return places(stations, zero, -squares, zero, weights)


def positions_and_offset(stations, lengths, slopes, extra):
    """Places and offsets."""
    found = places(stations, lengths, extra, slopes, offset=1)
    return found[:, :-1], found[:, -1]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [4, 5, 30])
def test_general_stations_give_one_position(dimension: int, count: int) -> None:
    generator = np.random.default_rng(count)
    stations = generator.uniform(-5, 5, size=(count, dimension))
    truth = generator.uniform(-5, 5, size=dimension)
    found = positions(stations, np.square(stations - truth).sum(axis=1))
    np.testing.assert_allclose(found[0], truth, atol=EXACT)


@pytest.mark.parametrize(("dimension", "count"), [(2, 2), (2, 7), (3, 3), (3, 48)])
def test_flat_stations_give_both_sides(dimension: int, count: int) -> None:
    """Two spheres' circle and a third; a ceiling of receivers; mirrored at the plane z = 2.7."""
    generator = np.random.default_rng(count)
    stations = generator.uniform(0, 3, size=(count, dimension))
    stations[:, -1] = 2.7
    truth = np.append(generator.uniform(0, 3, size=dimension - 1), 0.8)
    mirrored = np.append(truth[:-1], 2 * 2.7 - 0.8)
    found = positions(stations, np.square(stations - truth).sum(axis=1))
    both = found[np.argsort(found[:, -1])]
    np.testing.assert_allclose(both, [truth, mirrored], atol=EXACT)


def test_stations_on_a_line_of_space_leave_a_circle() -> None:
    stations = np.outer(np.arange(5.0), [1.0, 1.0, 0.0])
    assert not len(positions(stations, np.square(stations - [1.0, 2.0, 3.0]).sum(axis=1)))


def test_spheres_that_do_not_meet_give_the_nearest_place() -> None:
    """Two stations 4 m apart, each 1 m away: half way between them."""
    found = positions(np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(found, [[2.0, 0.0], [2.0, 0.0]], atol=EXACT)


def test_weights_count() -> None:
    """A wrong distance with hardly any weight does no harm: its share of the error is its weight's, 1e-12."""
    generator = np.random.default_rng(5)
    stations, truth = generator.uniform(-5, 5, size=(9, 3)), np.array([1.0, 2.0, 3.0])
    squares = np.square(stations - truth).sum(axis=1)
    squares[4] += 100.0
    weights = np.ones(9)
    weights[4] = 1e-12
    np.testing.assert_allclose(positions(stations, squares, weights)[0], truth, atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("more", [1, 2, 10])
def test_a_common_offset_is_found_with_the_position(dimension: int, more: int) -> None:
    """d + 1 rows leave a quadratic equation, whose two roots are both given."""
    generator = np.random.default_rng(more)
    stations = generator.uniform(-5, 5, size=(dimension + more, dimension))
    truth, offset = generator.uniform(-5, 5, size=dimension), 1.7
    distances = np.sqrt(np.square(stations - truth).sum(axis=1))
    zeros, slope = np.zeros(len(stations)), np.full(len(stations), -2.0)
    found, offsets = positions_and_offset(stations, distances + 2.0 * offset, slope, zeros)
    near = int(np.argmin(np.abs(found - truth).sum(axis=1)))
    np.testing.assert_allclose(found[near], truth, atol=EXACT)
    assert offsets[near] == pytest.approx(offset, abs=EXACT)


def test_a_circle_through_points_is_the_same_question() -> None:
    """Centre (3 -1), radius 2; the radius is the offset, every length is zero."""
    angles = np.array([0.1, 0.9, 2.0, 4.0])
    points = np.array([3.0, -1.0]) + 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found, radius = positions_and_offset(points, np.zeros(4), np.ones(4), np.zeros(4))
    np.testing.assert_allclose(found, [[3.0, -1.0]] * 2, atol=EXACT)
    np.testing.assert_allclose(np.abs(radius), 2.0, atol=EXACT)


@pytest.mark.parametrize("dimension", [2, 3])
def test_both_sides_of_stations_nearly_in_a_plane_are_given_with_an_offset(dimension: int) -> None:
    """Differences barely tell the side: with noise their answer may be anywhere, one of the sides is near the truth."""
    generator = np.random.default_rng(dimension)
    stations = generator.uniform(-5, 5, size=(8, dimension))
    stations[:, -1] *= 0.01
    truth = np.append(generator.uniform(-5, 5, size=dimension - 1), 4.0)
    lengths = np.linalg.norm(stations - truth, axis=1) - 1.5 + 0.01 * generator.normal(size=8)
    found, offsets = positions_and_offset(stations, lengths, np.ones(8), np.zeros(8))
    assert len(found) == MOST_PLACES
    sides = np.abs(found[1:] - truth).max(axis=1)
    assert sides.min() < 0.2  # twenty times the noise, which the root of a difference of squares magnifies
    assert {bool(side) for side in found[1:, -1] > 0} == {True, False}
    np.testing.assert_allclose(offsets[1:][np.argmin(sides)], 1.5, atol=0.2)


def test_a_row_that_is_not_known_or_weighs_nothing_takes_no_part() -> None:
    generator = np.random.default_rng(2)
    stations, truth = generator.uniform(-5, 5, size=(7, 2)), np.array([1.0, 2.0])
    lengths = np.linalg.norm(stations - truth, axis=1)
    zero, weights = np.zeros(7), np.ones(7)
    wrong = lengths.copy()
    wrong[2], wrong[5], weights[5] = np.nan, 1e3, 0.0
    np.testing.assert_allclose(places(stations, wrong, zero, zero, weights), [truth], atol=EXACT)
    assert not len(places(stations, wrong, zero, zero, zero))
