"""Outliers that nearly all lie on one side draw estimates under a loss: they are told, and symmetric ones are not."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 1 :loss {loss}))"
WALK = """(problem p (data d external) (states :over x (s :init 0 :sigma 10)) (dynamics (random-walk s :sigma 0.3))
  (observe d (= y s) :sigma 1 :loss {loss}) (solve :method {method}))"""
FILTERS = ["iterated-ekf", "(smoother)", "batch"]
COUNT = 200


def errors(seed, sides):
    """Normal errors, one in seven of them with 3 to 20 deviations more on some sides."""
    random = np.random.default_rng(seed)
    wrong = random.random(COUNT) < 1 / 7
    return random.normal(size=COUNT) + wrong * random.choice(sides, COUNT) * random.uniform(3, 20, COUNT)


def said(text, y):
    result = mbm.loads(text).solve(data={"d": {"x": np.arange(float(COUNT)), "y": y}})
    return [each.message for each in result.first.diagnostics if each.code.name == "one-sided-outliers"]


@pytest.mark.parametrize("text", [LINE, *(WALK.replace("{method}", each) for each in FILTERS)])
@pytest.mark.parametrize("side", [1, -1])
def test_outliers_on_one_side_are_told(text, side):
    """29 rows are expected to be wrong, and 11 of them beyond three deviations would do."""
    assert all(said(text.replace("{loss}", "huber"), errors(seed, [side])) for seed in (1, 2))


@pytest.mark.parametrize("text", [LINE, WALK.replace("{method}", "(smoother)")])
@pytest.mark.parametrize("loss", ["huber", "tukey"])
def test_outliers_on_both_sides_are_not(text, loss):
    """By chance once in 1,000."""
    assert not any(said(text.replace("{loss}", loss), errors(seed, [1, -1])) for seed in range(5))


def test_a_loss_that_leaves_them_out_is_not_drawn():
    assert not any(said(LINE.replace("{loss}", "tukey"), errors(seed, [1])) for seed in range(5))
