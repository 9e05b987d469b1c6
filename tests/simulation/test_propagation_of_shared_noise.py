"""Trials of problems whose rows share noise, against generalised least squares by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

X = np.arange(6.0)
Y = np.array([1.02, 3.1, 4.9, 7.0, 9.1, 10.9])
DAYS = np.array([1, 1, 1, 2, 2, 2])
ROWS = " ".join(f"({x:g} {y} {day})" for x, y, day in zip(X, Y, DAYS, strict=True))
TRIALS = 600


def line(option: str) -> mbm.Problem:
    return mbm.loads(
        f"(problem p (data d (table (x y day) {ROWS})) (unknowns (a :init 1) (b :init 2))"
        f" (observe d (= y (+ a (* b x))) {option}) (derive (at-9 (+ a (* 9 b)))))"
    )


@pytest.mark.parametrize(
    ("option", "covariance"),
    [
        (":sigma 0.1 :common ((0.5 :per day))", 0.01 * np.eye(6) + 0.25 * (DAYS[:, None] == DAYS)),
        (":sigma 0.3 :correlation (ar1 0.8)", 0.09 * 0.8 ** np.abs(np.subtract.outer(X, X))),
    ],
)
def test_draws_have_the_covariance_of_all_rows(option: str, covariance: np.ndarray) -> None:
    """Standard deviations and a correlation within four of their own; independent rows would be off by a third."""
    found = line(option).propagate(TRIALS, seed=5)
    design = np.vander(X, 2, increasing=True)
    wanted = np.linalg.inv(design.T @ np.linalg.solve(covariance, design))
    for name, gradient in {"a": [1.0, 0.0], "b": [0.0, 1.0], "at-9": [1.0, 9.0]}.items():
        sigma = float(np.sqrt(gradient @ wanted @ gradient))
        assert float(found[name].sigma) == pytest.approx(sigma, rel=4 / np.sqrt(2 * TRIALS))
    correlation = np.corrcoef(found["a"].samples, found["b"].samples)[0, 1]
    expected = wanted[0, 1] / np.sqrt(wanted[0, 0] * wanted[1, 1])
    assert correlation == pytest.approx(expected, abs=4 * (1 - expected**2) / np.sqrt(TRIALS))


@pytest.mark.parametrize(
    ("option", "mend"),
    [
        (":correlation (ar1 unknown)", "state it with numbers"),
        (":sigma unknown :common ((0.5 :per day))", "`:sigma` with a number"),
    ],
)
def test_noise_that_is_shared_and_estimated_is_refused(option: str, mend: str) -> None:
    with pytest.raises(mbm.MbmError) as error:
        line(option).propagate(100)
    assert [each.code.name for each in error.value.diagnostics] == ["not-propagated"]
    assert mend in str(error.value.diagnostics[0].hint)
