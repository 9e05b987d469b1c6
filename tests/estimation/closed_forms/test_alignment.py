"""Umeyama's closed form against known motions, the printed determinant rule, and complex least squares."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.estimation.starts.closed_forms.similarity import aligned, turned
from tests.estimation.closed_forms.numerics_cases import ROTATIONS, Floats, cloud

EXACT = 1e-12
"""Some hundred operations in double precision on numbers of the size of one."""


@pytest.mark.parametrize("R", ROTATIONS)
@pytest.mark.parametrize("c", [0.2, 1.0, 7.0])
def test_a_similarity_of_space_is_found_exactly(R: Floats, c: float) -> None:
    x = cloud(6, 1)
    t = np.array([3.0, -2.0, 0.5])
    scale, rotation, shift = aligned(x, c * x @ R.T + t, scale=True)
    assert scale == pytest.approx(c, rel=EXACT)
    np.testing.assert_allclose(rotation, R, atol=EXACT)
    np.testing.assert_allclose(shift, t, atol=10 * EXACT)


def test_mirrored_points_give_a_rotation_and_the_best_one() -> None:
    """Umeyama's own example (1991, p. 379): the rotation is the reflection's nearest, c = 0.721."""
    x = np.array([[0.0, 0], [1, 0], [0, 2]])
    y = np.array([[0.0, 0], [-1, 0], [0, 2]])
    c, R, t = aligned(x, y, scale=True)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert c == pytest.approx(0.721, abs=5e-4)
    np.testing.assert_allclose(R, [[0.832, 0.555], [-0.555, 0.832]], atol=5e-4)
    np.testing.assert_allclose(t, [-0.8, 0.4], atol=5e-4)


def test_in_the_plane_it_is_complex_linear_least_squares() -> None:
    """y = a x + b over complex numbers has the same minimum; solved by `lstsq`."""
    generator = np.random.default_rng(2)
    x, y = generator.normal(size=(2, 15, 2))
    w = generator.uniform(0.2, 3.0, size=15)
    matrix = np.stack([x @ [1, 1j], np.ones(15)], axis=1)
    (a, b), *_ = np.linalg.lstsq(matrix * np.sqrt(w)[:, None], (y @ [1, 1j]) * np.sqrt(w), rcond=None)
    c, R, t = aligned(x, y, w, scale=True)
    assert c * (R[0, 0] + 1j * R[1, 0]) == pytest.approx(a, abs=EXACT)
    assert t @ [1, 1j] == pytest.approx(b, abs=EXACT)


def test_points_on_a_line_of_space_do_not_determine_a_rotation() -> None:
    x = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    c, R, t = aligned(x, x, scale=False)
    assert np.isnan(c)
    assert np.isnan(R).all()
    assert np.isnan(t).all()
    assert np.isnan(turned(x, x)).all()


def test_equal_points_do_not_determine_anything() -> None:
    assert np.isnan(aligned(np.ones((3, 2)), np.ones((3, 2)), scale=True)[0])


def test_many_problems_at_once_are_each_as_alone() -> None:
    x, y = np.random.default_rng(3).normal(size=(2, 5, 4, 3))
    together = aligned(x, y, scale=True)
    for i in range(5):
        for whole, alone in zip(together, aligned(x[i], y[i], scale=True), strict=True):
            np.testing.assert_allclose(whole[i], alone, atol=EXACT)


@pytest.mark.parametrize("R", ROTATIONS)
def test_directions_alone_give_a_rotation(R: Floats) -> None:
    x = cloud(3, 4)
    np.testing.assert_allclose(turned(x, x @ R.T), R, atol=EXACT)
