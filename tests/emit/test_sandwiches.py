"""Covariances with losses of generated solvers where the unknowns are nearly dependent."""

from __future__ import annotations

import csv
import shutil
import sys

import numpy as np
import pytest

from tests.emit.making import make, of_text, run, written

YEARS = np.arange(1990.0, 2021.0)
EXTENTS = np.fromstring(
    "3.76 3.55 3.42 3.25 3.08 3.02 2.98 2.89 2.75 2.70 2.72 2.76 2.67 2.83 2.85 2.96 3.08 3.22 3.41 3.61 3.74 4.03 "
    "4.16 4.46 4.76 5.00 5.27 5.59 5.97 6.37 6.70",
    sep=" ",
)
TEXT = f"""(problem apart
  (data d (table (y) (3) (3.00000005) (2.99999995) (3.00000002) (2.99999996)))
  (data e (table (t y) {" ".join(f"({t:g} {y:g})" for t, y in zip(YEARS, EXTENTS, strict=True))}))
  (unknowns (x :init 1) (z :init 1) (a0) (a1) (a2) (a3))
  (observe d (= y (+ x z)) :sigma 1e-7 :loss (huber 3))
  (observe b (= 5 x) :sigma 1)
  (observe e (= y (+ a0 (* a1 t) (* a2 (^ t 2)) (* a3 (^ t 3)))) :sigma 0.05 :loss (huber 1.345)))"""


def slope_deviation() -> float:
    """The standard deviation of a3 by Huber (1981), 7.6, of the polynomial about the middle of the years."""
    rows = np.polynomial.legendre.legvander((YEARS - 2005.0) / 15.0, 3) / 0.05
    weights = np.ones(len(rows))
    for _ in range(300):  # reweighted least squares settles to rounding
        root = np.sqrt(weights)
        found = np.linalg.lstsq(rows * root[:, None], EXTENTS / 0.05 * root, rcond=None)[0]
        residuals = EXTENTS / 0.05 - rows @ found
        weights = np.minimum(1.0, 1.345 / np.abs(residuals))
    n, p = rows.shape
    inside = (weights == 1.0).mean()
    corrected = 1.0 + p / n * (1.0 - inside) / inside
    spread = corrected**2 * np.sum((weights * residuals) ** 2) / (n - p) * n
    curvature = n * inside
    information = (rows * weights[:, None]).T @ rows / weights.sum()
    variance = spread / curvature**2 * np.linalg.inv(information)[3, 3]
    return float(np.sqrt(variance) * 2.5 / 15.0**3)  # the cubic Legendre polynomial begins with 5/2


@pytest.mark.parametrize("target", ["python", "c"])
def test_nearly_dependent_unknowns_have_the_deviations_of_independent_ones(target, tmp_path):
    """By hand: one row of deviation 1 alone tells x, and the mean of the others, 1e-7 apart, is that of x + z."""
    folder = written(of_text(TEXT, target), tmp_path)
    if target == "c":
        if shutil.which("cc") is None:
            pytest.skip("no C compiler (cc) is here")
        made = make(folder, "all", watched=False)
        assert made.returncode == 0, made.stdout + made.stderr
    command = ("./apart",) if target == "c" else (sys.executable, "apart.py")
    found = run(*command, "data/d.csv", "data/e.csv", folder=folder)
    assert found.returncode == 0, found.stderr
    rows = {row["name"]: float(row["sigma"]) for row in csv.DictReader(found.stdout.splitlines())}
    # rounding times the condition of the slopes: 1e7 of the pair, 1e10 of the powers of years
    assert (rows["x"], rows["z"]) == pytest.approx((1.0, 1.0), rel=1e-8)
    assert rows["a3"] == pytest.approx(slope_deviation(), rel=1e-4)
