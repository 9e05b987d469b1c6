"""A limit that holds the estimates says so where the data contradict it, by the χ² or F test of the fit without it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, f

import mbm

X = np.arange(6.0)
Y = np.array([0.1, 2.0, 4.1, 5.9, 8.05, 9.9])
LINE = """(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {sigma})
  (constraints {limits}) {clause})"""
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


def messages(sigma, limits, data=None, clause=""):
    result = mbm.loads(LINE.format(sigma=sigma, limits=limits, clause=clause)).solve(
        data={"d": data or {"x": X, "y": Y}}
    )
    return [[d.message for d in s.diagnostics if d.code.name == "active-constraint"] for s in result.solves]


@pytest.mark.parametrize("limit", ["(<= b 1)", "(uniform b 0 1)", "(<= (* b 1000) 1000)"])
def test_an_unknown_noise_that_a_limit_swells(limit):
    """The noise takes up what the limit forces upon the rows, and no other message would tell."""
    held, free = squares(None, 1.0), squares(None, None)
    chance = f.sf((held - free) / (free / 4), 1, 4)
    ((said,),) = messages("unknown", limit)
    assert said.endswith(f"the sum of squares is {held:.3g}, and without it {free:.3g} (p = {chance:.1g})")


def test_a_stated_noise():
    held, free = squares(None, 1.85) / 0.01, squares(None, None) / 0.01
    ((said,),) = messages("0.1", "(<= b 1.85)")
    assert said.endswith(
        f"the sum of squares is {held:.3g}, and without it {free:.3g} (p = {chi2.sf(held - free, 1):.1g})"
    )


def test_each_of_two_limits():
    """Without either alone: the other goes on holding."""
    (found,) = messages("0.1", "(<= a 1.5) (<= b 1)")
    for said, without in zip(found, (squares(None, 1.0), squares(1.5, None)), strict=True):
        assert f"is {100 * squares(1.5, 1.0):.3g}, {BROKEN} {100 * without:.3g} (" in said


@pytest.mark.parametrize("sigma", ["0.1", "unknown"])
def test_limits_that_hold(sigma):
    """100 lines whose slope is at the limit: half are held, and none is contradicted."""
    rng = np.random.default_rng(3)
    data = {
        "x": np.tile(X, 100),
        "y": np.tile(2 * X, 100) + 0.1 * rng.normal(size=600),
        "k": np.repeat(np.arange(100), 6),
    }
    found = messages(sigma, "(<= b 2)", data, "(for-each k)")
    assert 35 < sum(map(len, found)) < 65
    assert not [said for each in found for said in each if BROKEN in said]


def test_one_of_many_solves():
    data = {"x": np.tile(X, 20), "y": np.tile(2 * X, 20) + np.tile(Y - 2 * X, 20), "k": np.repeat(np.arange(20), 6)}
    data["y"] -= 1.5 * data["x"] * (data["k"] != 7)
    found = messages("unknown", "(<= b 1)", data, "(for-each k)")
    assert [k for k, said in enumerate(found) if said] == [7]
    assert found[7] == messages("unknown", "(<= b 1)")[0]
