"""Stated starts of many solves against closed forms: the better minimum is the answer, as it is for one solve alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm

BODY = "(unknowns (p (vector 2) :init [4 -2]{prior})) (observe d (= r (distance p [sx sy])) :sigma {sigma})"
FEW, MANY = 5, 60
"""Solves that are made one by one, and those that are bound together."""


def drawn(count, wrong=0.0):
    """Ranges (count, 4) of stations that nearly stand in a line; a share of them is wrong by up to 3 m."""
    generator = np.random.default_rng(11)
    stations = np.empty((count, 4, 2))
    stations[..., 0], stations[..., 1] = np.linspace(0, 10, 4), generator.uniform(-0.2, 0.4, (count, 4))
    places = generator.uniform([2, 1.5], [8, 4], (count, 1, 2))
    ranges = np.linalg.norm(stations - places, axis=2) + 0.05 * generator.normal(size=(count, 4))
    ranges += np.where(generator.random((count, 4)) < wrong, generator.uniform(0, 3, (count, 4)), 0.0)
    return stations, ranges


def columns(stations, ranges):
    return {"sx": stations[..., 0].ravel(), "sy": stations[..., 1].ravel(), "r": ranges.ravel()}


def together(stations, ranges, sigma, prior=""):
    data = {"run": np.repeat(np.arange(len(ranges)), ranges.shape[1]), **columns(stations, ranges)}
    text = f"(problem p (data d (table (run sx sy r))) {BODY.format(sigma=sigma, prior=prior)} (for-each run))"
    return mbm.loads(text).compile(data={"d": data}).solve().solves


def one_by_one(stations, ranges, sigma, prior=""):
    text = f"(problem p (data d (table (sx sy r))) {BODY.format(sigma=sigma, prior=prior)})"
    alone = mbm.loads(text).compile(data={"d": columns(stations[:1], ranges[:1])})
    sets = ({"d": columns(s[None], r[None])} for s, r in zip(stations, ranges, strict=True))
    return [alone.solve(data=each).solves[0] for each in sets]


def costs(solves):
    return [solve.cost for solve in solves]


@pytest.mark.parametrize("count", [FEW, MANY])
def test_the_answer_is_the_lower_of_the_minima_on_both_sides(count):
    stations, ranges = drawn(count)
    sides = []
    for own, lengths in zip(stations, ranges, strict=True):
        ends = [
            least_squares(lambda p, s=own, r=lengths: (np.linalg.norm(s - p, axis=1) - r) / 0.05, (5.0, y), xtol=1e-12)
            for y in (3.0, -3.0)
        ]
        sides.append([2 * end.cost for end in ends])
    least = np.min(sides, axis=1)
    assert (np.argmin(sides, axis=1) == 0).sum() > count / 2  # a stated start leads to the other side
    np.testing.assert_allclose(costs(together(stations, ranges, "0.05")), least, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("sigma", "prior"), [("0.05", ""), ("unknown", ""), ("0.05", " :sigma 3")])
def test_many_solves_end_where_each_does_alone(sigma, prior):
    """Also where wrong ranges leave a fit that noise does not explain, and no answer of a closed form is lower."""
    stations, ranges = drawn(150, wrong=0.15)
    many, alone = together(stations, ranges, sigma, prior), one_by_one(stations, ranges, sigma, prior)
    np.testing.assert_allclose(costs(many), costs(alone), rtol=1e-6, atol=1e-9)
    assert [s.iterations for s in many] == [s.iterations for s in alone]  # those from closed forms in vain included
    assert [s.evaluations for s in many] == [s.evaluations for s in alone]
