"""A limit that holds the estimates says so where the data contradict it, by the χ² or F test of the fit without it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, f

import mbm

X = np.arange(6.0)
Y = np.array([0.1, 2.0, 4.1, 5.9, 8.05, 9.9])
LINE = """(problem p (data d external) (unknowns (a{a}) (b{b})) (observe d (= y (+ a (* b x))) :sigma {sigma})
  {limits} {clause})"""
BROKEN = "and without it"


def squares(*held):
    """The least sum of squares of the line, with the numbers ``held`` (a, b) where they are not None."""
    columns = [column for column, value in zip((np.ones(6), X), held, strict=True) if value is None]
    rest = Y - sum(value * column for column, value in zip((np.ones(6), X), held, strict=True) if value is not None)
    if not columns:
        return float(rest @ rest)
    basis = np.stack(columns, axis=1)
    left = rest - basis @ np.linalg.lstsq(basis, rest, rcond=None)[0]
    return float(left @ left)


def messages(sigma, limits, data=None, clause="", a="", b=""):
    stated = limits and f"(constraints {limits})"
    text = LINE.format(sigma=sigma, limits=stated, clause=clause, a=a, b=b)
    result = mbm.loads(text).solve(data={"d": data or {"x": X, "y": Y}})
    codes = ("near-bound", "active-constraint")
    return [[d.message for d in s.diagnostics if d.code.name in codes] for s in result.solves]


LIMITS = ["(<= b 1)", "(uniform b 0 1)", "(<= (* b 1000) 1000)", ":in (0 1)"]
"""Constraints, and an option of the unknown."""


def of_slope(limit):
    return {"limits": "", "b": " " + limit} if limit.startswith(":") else {"limits": limit}


@pytest.mark.parametrize("limit", LIMITS)
def test_an_unknown_noise_that_a_limit_swells(limit):
    """The noise takes up what the limit forces upon the rows, and no other message would tell."""
    held, free = squares(None, 1.0), squares(None, None)
    chance = f.sf((held - free) / (free / 4), 1, 4)
    ((said,),) = messages("unknown", **of_slope(limit))
    assert said.endswith(f"the sum of squares is {held:.3g}, and without it {free:.3g} (p = {chance:.1g})")


def test_a_stated_noise():
    held, free = squares(None, 1.85) / 0.01, squares(None, None) / 0.01
    ((said,),) = messages("0.1", "(<= b 1.85)")
    assert said.endswith(
        f"the sum of squares is {held:.3g}, and without it {free:.3g} (p = {chi2.sf(held - free, 1):.1g})"
    )


@pytest.mark.parametrize(
    "limits",
    [
        {"limits": "(<= a 1.5) (<= b 1)"},
        {"limits": "", "a": " :in (-9 1.5)", "b": " :in (-9 1)"},
        {"limits": "(<= b 1)", "a": " :in (-9 1.5)"},
    ],
)
def test_each_of_two_limits(limits):
    """Without either alone: the other goes on holding."""
    (found,) = messages("0.1", **limits)
    for said, without in zip(found, (squares(None, 1.0), squares(1.5, None)), strict=True):
        assert f"is {100 * squares(1.5, 1.0):.3g}, {BROKEN} {100 * without:.3g} (" in said


def test_a_positive_unknown():
    """Offsets are stated to be positive, and the data say −1.5: without the bound the line is that of least squares."""
    y = Y - 1.5
    ((said,),) = messages("0.1", "", {"x": X, "y": y}, a=" positive")
    free = 100 * squares(None, None)
    held = 100 * float(np.square(y - X * (X @ y) / (X @ X)).sum())
    assert said.startswith("`a` is driven to zero, where `positive` ends, which the data contradict: the sum of")
    assert f"is {held:.3g}, {BROKEN} {free:.3g} (" in said


@pytest.mark.parametrize("limit", ["(<= b 2)", ":in (0 2)"])
@pytest.mark.parametrize("sigma", ["0.1", "unknown"])
def test_limits_that_hold(sigma, limit):
    """100 lines whose slope is at the limit: half are held, and none is contradicted."""
    rng = np.random.default_rng(3)
    data = {
        "x": np.tile(X, 100),
        "y": np.tile(2 * X, 100) + 0.1 * rng.normal(size=600),
        "k": np.repeat(np.arange(100), 6),
    }
    found = messages(sigma, data=data, clause="(for-each k)", **of_slope(limit))
    assert 35 < sum(map(len, found)) < 65
    assert not [said for each in found for said in each if BROKEN in said]


@pytest.mark.parametrize("limit", ["(<= b 1)", ":in (0 1)"])
def test_one_of_many_solves(limit):
    data = {"x": np.tile(X, 20), "y": np.tile(2 * X, 20) + np.tile(Y - 2 * X, 20), "k": np.repeat(np.arange(20), 6)}
    data["y"] -= 1.5 * data["x"] * (data["k"] != 7)
    found = messages("unknown", data=data, clause="(for-each k)", **of_slope(limit))
    assert [k for k, said in enumerate(found) if said] == [7]
    assert found[7] == messages("unknown", **of_slope(limit))[0]


def test_of_a_model_that_is_not_linear_the_fall_is_one_to_first_order():
    """At w = 0.7 the tangent does not reach the minimum near w = 1, where the sum of squares is about 1."""
    text = """(problem wave (data d
        (table (x y) (0 0.02) (1 0.84) (2 0.91) (3 0.14) (4 -0.76) (5 -0.96) (6 -0.28) (7 0.66)))
      (unknowns (w :in (0.2 0.7) :init 0.6) (a :init 1)) (observe d (= y (* a (sin (* w x)))) :sigma 0.02))"""
    (said,) = (d.message for d in mbm.loads(text).solve().first.diagnostics if d.code.name == "near-bound")
    assert "and without it, to first order, " in said
