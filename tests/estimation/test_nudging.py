"""Points beside a start without a derivative: a random choice, which follows from the seed of the solve."""

from __future__ import annotations

import numpy as np

from mbm.estimation.starts.nudging import SHARES, beside
from tests.estimation.classics import Functions


def points(seed):
    plain = Functions(function=lambda x: x, gradient=lambda _: np.eye(3), start=(1.0, -2.0, 0.0))
    return np.array(list(beside(plain, np.array([1.0, -2.0, 0.0]), seed)))


def test_the_same_seed_gives_the_same_points_and_another_seed_others():
    np.testing.assert_array_equal(points(4), points(4))
    assert not np.isclose(points(4), points(5), rtol=1e-12).all(axis=1).any()


def test_every_coordinate_moves_by_half_to_all_of_the_share_of_its_size():
    moved = np.abs(points(4) - [1.0, -2.0, 0.0]) / [1.0, 2.0, 1.0]
    shares = np.repeat(SHARES, 2)[:, None]
    # The difference from a start of size 1 is rounded at 1e-16, which is 1e-10 of the smallest share.
    assert (moved >= 0.5 * shares * (1 - 1e-9)).all()
    assert (moved <= shares * (1 + 1e-9)).all()
