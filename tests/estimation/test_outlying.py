"""A row that alone makes unknown noise large is named; long tails and noise as stated are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

import mbm

CODE = "outlying-row"
X = np.linspace(0.0, 1.0, 12)
NORMAL = np.random.default_rng(4).normal(size=(12, 12))
U = np.linspace(0.5, 1.5, 12)
LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {}) {})"


def said(noise: str, more: str = "", **columns: np.ndarray) -> list[list[str]]:
    solves = mbm.loads(LINE.format(noise, more)).solve(data={"d": columns}).solves
    return [[each.message for each in solve.diagnostics if each.code.name == CODE] for solve in solves]


def without(x: np.ndarray, y: np.ndarray, u: np.ndarray, row: int) -> tuple[float, float, float]:
    """By a fit to the other rows: t of the row left out, its chance among all, and how much it widens the noise."""
    design = np.column_stack([np.ones_like(x), x]) / u[:, None]
    read, kept = y / u, np.arange(len(x)) != row
    (few, _, _, _), (all_rows, _, _, _) = (
        np.linalg.lstsq(design[kept], read[kept], rcond=None),
        np.linalg.lstsq(design, read, rcond=None),
    )
    dof = len(x) - 3
    s = np.sqrt(np.square(read[kept] - design[kept] @ few).sum() / dof)
    whole = np.sqrt(np.square(read - design @ all_rows).sum() / (dof + 1))
    spread = 1 + design[row] @ np.linalg.inv(design[kept].T @ design[kept]) @ design[row]
    away = abs(read[row] - design[row] @ few) / s / np.sqrt(spread)
    return away, len(x) * 2 * t.sf(away, dof), whole / s


@pytest.mark.parametrize("row", [0, 5])
def test_a_row_far_off_is_named_with_its_distance(row: int) -> None:
    y = 2 + X + U * NORMAL[0]
    y[row] += 12 * U[row]
    (message,) = said("(unknown u)", x=X, y=y, u=U)[0]
    away, chance, widened = without(X, y, U, row)
    assert message == (
        f"row {row + 1} of `d` is {away:.3g} standard deviations from what the other rows say (p = {chance:.1g} for "
        f"the farthest row), and alone makes the unknown noise {widened:.2g} times as large"
    )


def test_stated_noise_and_losses_have_their_own_words() -> None:
    y = 2 + X + NORMAL[0]
    y[5] += 12
    assert said("1", x=X, y=y) == [[]]
    assert said("unknown :loss cauchy", x=X, y=y) == [[]]
    assert len(said("unknown", x=X, y=y)[0]) == 1


def test_two_rows_far_off_are_long_tails() -> None:
    y = 2 + X + NORMAL[0]
    y[[3, 8]] += 40.0, -30.0
    assert said("unknown", x=X, y=y) == [[]]


def test_normal_noise_has_an_outlier_in_three_of_a_hundred_solves() -> None:
    """800 solves with 6 rows: 3 % ± 0.6 % (Bonferroni's bound is hardly more than what it bounds)."""
    y = 2 + X[:6] + np.random.default_rng(5).normal(size=(800, 6))
    run = np.repeat(np.arange(800.0), 6)
    found = said("unknown", "(for-each run)", x=np.tile(X[:6], 800), y=y.ravel(), run=run)
    assert 0.012 < np.mean([bool(each) for each in found]) < 0.05


def test_each_solve_of_many_says_what_it_says_alone() -> None:
    y = 2 + X + NORMAL
    y[::2, 3] += 15.0
    run = np.repeat(np.arange(12.0), 12)
    found = said("unknown", "(for-each run)", x=np.tile(X, 12), y=y.ravel(), run=run)
    alone = [said("unknown", x=X, y=each)[0] for each in y]
    assert [len(each) for each in found] == [len(each) for each in alone]
    assert [each[0].split(" is ")[1] for each in found if each] == [each[0].split(" is ")[1] for each in alone if each]
    assert sum(map(len, found)) == 6


def test_readings_without_noise() -> None:
    assert said("unknown", x=X, y=2 + X) == [[]]


def test_where_the_other_rows_agree_exactly_no_infinite_distance_is_named() -> None:
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x)))))"
    columns = {"x": [1, 1, 1, 2, 2, 3], "y": [2, 2, 2, 4.1, 4.1, 6]}  # but for the last, all on y = 2.1 x - 0.1
    diagnostics = mbm.loads(text).solve(data={"d": columns}).first.diagnostics
    (message,) = [each.message for each in diagnostics if each.code.name == CODE]
    assert message == "without row 6 of `d` all residuals are zero: the unknown noise is told by it alone"
