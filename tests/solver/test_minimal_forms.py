"""Closed forms from as few rows as determine everything: the configuration that made the rows is among the answers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from mbm.solver.manifolds import quaternion_of_matrix
from mbm.solver.minimal_pose import poses_from_three, real_roots
from mbm.solver.minimal_spheres import places_from_spheres

SEEDS = st.integers(0, 2**32 - 1)


def spheres(stations, lengths, extra=0.0, slope=0.0):
    rows = len(stations)
    return np.column_stack([stations, lengths, np.full(rows, extra), np.full(rows, slope)])


def places(rows, offset=0, even=0):
    m, d = len(rows), rows.shape[1] - 3
    found = np.zeros(2 * m)
    scratch = np.zeros(m * (m + 4))
    count = places_from_spheres(d, offset, even, rows.ravel(), found, np.zeros(m, dtype=np.int64), scratch)
    return found.reshape(2, m)[:count]


def away(found, truth):
    return min((np.abs(each - truth).max() for each in found), default=np.inf)


@given(seed=SEEDS, d=st.sampled_from([2, 3]), offset=st.booleans(), flat=st.booleans())
def test_the_place_that_made_the_ranges_is_found(seed, d, offset, flat):
    generator = np.random.default_rng(seed)
    stations = generator.uniform(-3, 3, (d + offset, d))
    if flat and d == 3:
        stations[:, 2] = 2.7
    place, bias = generator.uniform(-4, 4, d), generator.uniform(0.1, 1.0)
    lengths = np.linalg.norm(stations - place, axis=1) - bias * offset
    found = places(spheres(stations, lengths, slope=1.0), offset=int(offset))
    centred = stations[1:] - stations[0]
    # A thin triangle of stations, or a nearly double solution, loses digits: as many as the condition has, twice over.
    values = np.linalg.svd(centred, compute_uv=False)
    thin = values[-1 if not (flat and d == 3) else min(d, len(values)) - 1] / values[0]
    for each in found:
        mine = np.linalg.norm(stations - each[:d], axis=1) - (each[d] if offset else 0.0)
        if offset and (lengths + each[d] < 0).any():
            continue  # squared equations also hold with a negative distance
        np.testing.assert_allclose(np.abs(mine), np.abs(lengths), atol=1e-5 / max(thin, 1e-6) ** 2)
    if thin > 0.05:
        assert away(found, np.append(place, bias) if offset else place) < 1e-4


def test_spheres_that_do_not_quite_meet_give_the_nearest_place_twice():
    stations = np.array([[0.0, 0.0], [2.0, 0.0]])
    first, second = places(spheres(stations, [0.9, 0.9]))
    np.testing.assert_allclose(first, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second, first)


def test_an_even_offset_is_positive_and_stations_on_a_line_give_none():
    centre, radius = np.array([1.0, -2.0]), 3.0
    angles = np.array([0.1, 2.0, 4.0])
    rim = centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    found = places(spheres(rim, np.zeros(3), slope=-1.0), offset=1, even=1)
    assert away(found, np.append(centre, radius)) < 1e-9
    line = np.column_stack([np.arange(3.0), np.zeros(3), np.zeros(3)])
    assert len(places(spheres(line, np.ones(3)))) == 0


def seen(points, bearings):
    found = np.zeros(48)
    count = poses_from_three(points.ravel(), bearings.ravel(), found, np.zeros(48))
    return found.reshape(4, 12)[:count]


@given(seed=SEEDS)
def test_the_pose_that_made_the_sights_is_found(seed):
    generator = np.random.default_rng(seed)
    points = generator.uniform(-1, 1, (3, 3))
    R = Rotation.random(random_state=int(generator.integers(2**31))).as_matrix()
    t = np.array([*generator.uniform(-0.5, 0.5, 2), generator.uniform(2, 8)])
    placed = points @ R.T + t
    bearings = placed / np.linalg.norm(placed, axis=1)[:, None]
    found = seen(points, bearings)
    for each in found:
        turn, shift = each[:9].reshape(3, 3), each[9:]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        back = points @ turn.T + shift
        # The laws of cosines hold to 1e-6 of the longest side; a flat triangle turns that into an angle.
        np.testing.assert_allclose(back / np.linalg.norm(back, axis=1)[:, None], bearings, atol=1e-2)
    area = np.linalg.norm(np.cross(points[1] - points[0], points[2] - points[0]))
    double = min((np.abs(a - b).max() for i, a in enumerate(found) for b in found[:i]), default=1.0)
    if area > 0.3 and double > 1e-2 and t[2] > 3:
        assert away(found, np.append(R.ravel(), t)) < 1e-3


@pytest.mark.parametrize("place", [(0.3, 3.0), (-0.8, 4.0), (2.0, 2.5), (-3.0, 5.0)])
def test_sights_that_mirror_each_other_give_the_pose_too(place):
    """An isosceles triangle from a point of its plane of symmetry: the sides to its feet are equal, and may vanish."""
    points = np.array([[-1.0, 0, 0], [0, 1.5, 0], [1, 0, 0]])
    shift = np.array([0.0, *place])
    placed = points + shift
    found = seen(points, placed / np.linalg.norm(placed, axis=1)[:, None])
    # where the law for a side vanishes, half of the digits are left
    assert away(found, np.append(np.eye(3).ravel(), shift)) < 1e-6


def test_points_on_a_line_give_no_pose():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    placed = points + np.array([0, 0, 5.0])
    assert len(seen(points, placed / np.linalg.norm(placed, axis=1)[:, None])) == 0


@given(seed=SEEDS)
def test_quaternions_are_those_of_the_rotation(seed):
    rotation = Rotation.random(random_state=seed % 2**32)
    found = np.zeros(4)
    quaternion_of_matrix(rotation.as_matrix().ravel(), found)
    expected = rotation.as_quat(scalar_first=True)
    np.testing.assert_allclose(found, expected * np.sign(expected[0] or 1.0), atol=1e-12)


@given(roots=st.lists(st.floats(-5, 5), min_size=4, max_size=4), leading=st.floats(0.1, 10))
def test_real_roots_are_found(roots, leading):
    spread = sorted(roots)
    if min(np.diff(spread)) < 0.05:
        return
    found = np.zeros(4)
    assert real_roots(leading * np.poly(spread), found) == 4
    # Roots 0.05 apart within ±5 are conditioned up to 1e7.
    np.testing.assert_allclose(np.sort(found), spread, atol=1e-7)


def test_complex_roots_are_none_and_double_ones_count():
    found = np.zeros(4)
    assert real_roots(np.poly([1j, -1j, 2j, -2j]).real, found) == 0
    assert real_roots(np.poly([1.0, 1.0, -3.0, 2.0]), found) == 4
    np.testing.assert_allclose(np.sort(found), [-3, 1, 1, 2], atol=1e-5)  # half the digits of a double root
    assert real_roots(np.poly([3.0, -2.0, 1j, -1j]).real, found) == 2
    np.testing.assert_allclose(np.sort(found[:2]), [-2, 3], atol=1e-12)
