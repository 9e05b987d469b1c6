"""Readings at a limit that nobody states are doubted; equal readings that digits make are not."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

import mbm
from mbm.estimation.trust.coarse import at_edge, by_chance, grid

CODE = "readings-at-edge"
MEAN = "(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma {}) {})"
LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {}) {})"
RNG = np.random.default_rng(1)
BLANKS = 0.02 + 0.1 * RNG.normal(size=(12, 8))
X = np.linspace(0.0, 10.0, 15)
LOADED = 1 + X + 0.3 * RNG.normal(size=15)


def said(text: str, noise: str = "unknown", more: str = "", **columns: np.ndarray) -> list[list[str]]:
    solves = mbm.loads(text.format(noise, more)).solve(data={"d": columns}).solves
    return [[each.message for each in solve.diagnostics if each.code.name == CODE] for solve in solves]


def test_negative_readings_that_are_shown_as_zero() -> None:
    y = np.maximum(BLANKS[0], 0.0)
    (message,) = said(MEAN, y=y)[0]
    assert message.startswith(f"{(y == 0.0).sum()} of the 8 readings of `d` are exactly 0, the least of all")
    assert said(MEAN, "0.1", y=y) == [[message]]
    assert said(MEAN, y=-y)[0][0].startswith(f"{(y == 0.0).sum()} of the 8 readings of `d` are exactly 0, the largest")
    assert said(MEAN, y=BLANKS[0]) == [[]]


def test_a_scale_that_ends_and_a_limit_that_is_entered() -> None:
    y = np.minimum(LOADED, 9.5)
    (message,) = said(LINE, x=X, y=y)[0]
    assert message.startswith(f"{(y == 9.5).sum()} of the 15 readings of `d` are exactly 9.5, the largest of all")
    assert said(LINE, x=X, y=LOADED) == [[]]


def test_one_zero_is_enough_where_others_might_be_zero() -> None:
    blanks = np.array([0.0, 0.0413, 0.0721, 0.1093, 0.0278, 0.0655])
    assert len(said(MEAN, y=blanks)[0]) == 1
    assert said(MEAN, y=blanks + 1.0) == [[]]
    far = np.append(0.0, LOADED[1:])
    assert said(LINE, x=X, y=far) == [[]]


def test_limits_that_are_stated() -> None:
    y = np.maximum(BLANKS[0], 0.0)
    assert said(MEAN, "0.1 :below (= y 0)", y=y) == [[]]


def test_readings_of_few_figures() -> None:
    assert said(MEAN, y=np.round(np.maximum(BLANKS[0], 0.0), 1)) == [[]]
    assert said(MEAN, y=np.round(BLANKS[0], 1)) == [[]]
    assert said(MEAN, y=np.round(10 * np.abs(BLANKS[0]))) == [[]]


def test_values_that_stand_for_groups_of_rows() -> None:
    """The distance of each of three planes stands beside each of its points: no limit, though the least is repeated."""
    nominal = np.repeat([1.2143, 1.7361, 2.4087], 8)
    assert said(LINE, x=nominal + 0.1 * RNG.normal(size=24), y=nominal) == [[]]
    both = np.clip(LOADED, 3.2, 9.5)  # a scale that ends on both sides is told, whichever end has more readings
    assert len(said(LINE, x=X, y=both)[0]) == 1


def test_readings_without_noise() -> None:
    assert said(LINE, x=X, y=X) == [[]]
    assert said("(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma 1))", y=np.zeros(6)) == [[]]


def test_zeros_beside_readings_of_the_same_instrument() -> None:
    """Five of six blanks are 0: how fine readings are is told by those of the sample."""
    text = """(problem p (data b external) (data d external) (unknowns (z) (s))
      (observe b (= y z) :sigma (unknown 1 :as e)) (observe d (= y (+ z s)) :sigma (unknown 1 :as e)))"""
    tables = {"b": {"y": [0, 0, 0, 0, 0, 0.0815]}, "d": {"y": [0.1004, 0.2731, 0.2972, 0.0643]}}
    (solve,) = mbm.loads(text).solve(data=tables).solves
    assert [each.code.name for each in solve.diagnostics if each.code.name == CODE] == [CODE]


def test_each_solve_of_many_says_what_it_says_alone() -> None:
    y = np.where(np.arange(12)[:, None] % 2, np.maximum(BLANKS, 0.0), BLANKS)
    run = np.repeat(np.arange(12.0), 8)
    found = said(MEAN, more="(for-each run)", run=run, y=y.ravel())
    assert found == [said(MEAN, y=each)[0] for each in y]
    assert sum(map(len, found)) == 6


@pytest.mark.parametrize("depth", [-1.5, 0.1, 0.7])
def test_how_far_values_are_below_a_limit(depth: float) -> None:
    """The estimate of n readings of one value moves by the mean of the normal distribution cut off at the limit."""
    y = np.full((1, 9), 0.3)
    y[0, :4] = 0.0
    basis = np.full((1, 9, 1), 1 / 3)
    for share, suspect in ((0.9, True), (1.1, False)):
        shift = 4 / 3 * (depth - truncnorm.mean(-np.inf, depth))
        scale = share * shift / 0.1
        found = at_edge(y, np.full((1, 9), -depth), np.ones((1, 9)), basis / scale, 1.0)
        assert (found[0][0], bool(found[1][0])) == (0.0, suspect)


def test_chance_is_a_bound_of_what_simulated_readings_show() -> None:
    """Readings in steps of 0.05, with noise of 0.5: the least of eight is there three times by chance."""
    y = np.round(np.random.default_rng(3).normal(size=(200_000, 8)) * 10) / 20
    counts = (y == y.min(axis=1, keepdims=True)).sum(axis=1)
    for count in (2, 3):
        bound = by_chance(count, 8, np.arange(1.0, 9.0) / 20, 0.5)
        assert (counts == count).mean() < bound
        assert bound == pytest.approx(comb(8, count) * (0.05 * norm.pdf(0, scale=0.5)) ** (count - 1), rel=1e-9)


def test_the_largest_step_of_which_all_are_multiples() -> None:
    """Decimal readings have rounding errors of 1e-16; real numbers have no step but the least that is told."""
    digits = np.array([0.07, 0.21, 0.35, 0.4, 0.93])
    assert grid(digits) == pytest.approx(0.01, rel=1e-9)
    assert grid(3.1 * digits[:3]) == pytest.approx(3.1 * 0.07, rel=1e-9)
    assert grid(np.random.default_rng(2).random(6)) < 1e-4
