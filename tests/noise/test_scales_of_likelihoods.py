"""Likelihoods whose scale is an unknown, against SciPy: they have more residuals than readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm, t

import mbm

X = np.arange(1.0, 7.0)
Y = np.array([5.2, 4.1, 3.3, 4.4, 8.0, 6.7])
CENSORED = np.array([0, 0, 0, 0, 1, 1])


def _below(residual: np.ndarray, scale: float) -> np.ndarray:
    return np.where(CENSORED == 1, norm.logcdf(residual, scale=scale), norm.logpdf(residual, scale=scale))


@pytest.mark.parametrize(
    ("noise", "law"),
    [
        (":sigma s :below (= lim 1)", _below),
        (":sigma s :distribution (student 4)", lambda residual, scale: t.logpdf(residual, 4, scale=scale)),
    ],
)
def test_the_maximum_of_a_likelihood_with_an_unknown_scale(
    noise: str, law: Callable[[np.ndarray, float], np.ndarray]
) -> None:
    text = f"""(problem p (data d external) (unknowns (a :init 5) (b :init 0) (s positive :init 1))
      (observe d (= y (+ a (* b x))) {noise}))"""
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": Y, "lim": CENSORED}})
    best = minimize(
        lambda p: -law(Y - p[0] - p[1] * X, np.exp(p[2])).sum(),
        [5.0, 0.0, 0.0],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 20000},
    )
    # 1e-4: Nelder and Mead's simplex ends at the square root of what the cost tells
    assert [found[name].value for name in "abs"] == pytest.approx([*best.x[:2], np.exp(best.x[2])], rel=1e-4)
