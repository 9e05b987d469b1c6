"""Points beside a start without a derivative, by the seed of the solve; middles of ranges in which nothing changes."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
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


ROWS = [(k, x, y + 0.1 * k * (x % 2)) for k in range(3) for x, y in enumerate((1.0, 3.1, 4.9, 7.5))]


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize(("form", "power"), [("(abs (* b x))", 1), ("(^ (* b x) 2)", 2)])
def test_a_middle_of_a_range_in_which_nothing_changes_is_left(form, power, many):
    """y = a + (b x)^n is a straight line over x^n for any b of either sign: NumPy has the cost of its least squares."""
    rows = ROWS if many else ROWS[:4]
    table = " ".join(f"({k} {x} {y})" for k, x, y in rows)
    text = f"""(problem still (data d (table (k x y) {table}))
      (unknowns (a :in (-10 10)) (b :in (-10 10))) (observe d (= y (+ a {form})) :sigma 0.2)
      {"(for-each d.k)" if many else ""})"""
    found = mbm.loads(text).solve().result.solves
    assert len(found) == (3 if many else 1)
    for number, solve in enumerate(found):
        x, y = np.array([row[1:] for row in ROWS if row[0] == number]).T
        slope, offset = np.polyfit(x**power, y, 1)
        assert solve.status == "converged"
        a, b = (float(each.value) for each in solve.estimates)
        assert (a, abs(b) ** power) == pytest.approx((offset, slope), rel=1e-6)  # the tolerance of the solve


def test_an_unknown_that_changes_nothing_anywhere_stays_in_the_middle():
    text = "(problem idle (unknowns (a :in (-4 0)) (b :in (2 4))) (observe (= 3 (+ a (max (sin b) 5))) :sigma 1))"
    (solve,) = mbm.loads(text).solve().result.solves
    assert float(solve.estimates[1].value) == 3.0
