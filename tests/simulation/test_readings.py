"""Simulated readings of stated distributions: their moments, and that limits and rounding are as stated."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import mbm

ROWS = 4000
X = np.linspace(1.0, 9.0, ROWS)
MEAN = 2 + 1.5 * X


def drawn(options: str, **columns: NDArray[np.float64]) -> NDArray[np.float64]:
    text = f"(problem p (data t external) (unknowns (a) (b)) (observe t (= y (+ a (* b x))) {options}))"
    data = {"t": {"x": X, "y": np.ones(ROWS), **columns}}
    found = mbm.loads(text).simulate(at={"a": 2, "b": 1.5}, data=data, seed=5)
    again = mbm.loads(text).simulate(at={"a": 2, "b": 1.5}, data=data, seed=5)
    assert np.array_equal(found["t"]["y"], again["t"]["y"])
    return np.asarray(found["t"]["y"])


VARIANCES = {
    ":distribution poisson": MEAN,
    ":distribution (binomial 30)": MEAN * (1 - MEAN / 30),
    ":distribution (student 8) :sigma 2": np.full(ROWS, 4 * 8 / 6),
    ":sigma (* 5% model)": np.square(0.05 * MEAN),
    ":sigma (sqrt model)": MEAN,
    ":sigma 1 :resolution 1": np.full(ROWS, 1 + 1 / 12),
}


@pytest.mark.parametrize("options", VARIANCES)
def test_moments(options: str) -> None:
    ratio = (drawn(options) - MEAN) / np.sqrt(VARIANCES[options])
    # five standard deviations of chance; a fourth moment of 4.5 (Student of 8) at most
    assert abs(ratio.mean()) < 5 / np.sqrt(ROWS)
    assert abs(np.square(ratio).mean() - 1) < 5 * np.sqrt(3.5 / ROWS)


@pytest.mark.parametrize("options", [":distribution poisson", ":distribution (binomial 30)", ":sigma 1 :resolution 1"])
def test_whole_numbers(options: str) -> None:
    readings = drawn(options)
    assert np.array_equal(readings, np.rint(readings))


def test_limits_stay_where_the_table_says_so() -> None:
    flag = (np.arange(ROWS) % 4 == 0).astype(float)
    readings = drawn(":sigma 1 :below (= low 1)", low=flag)
    assert (readings[flag == 1] == 1).all()
    assert (readings[flag == 0] != 1).all()
