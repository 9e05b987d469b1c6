"""Gradients at many points in one call, against differences of the cost."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.search.basins import gradients_at
from mbm.estimation.solve.estimate import assemble

TEXT = """(problem p (data marks external) (data seen external) (unknowns (a angle :init 0.3) (T (pose 2)) (k :init 2))
  (observe marks (= [u v] (rotate (rot2 a) (transform T [(* k x) y]))) {noise})
  (observe seen (= z (* k (sin (* k t)))) :sigma 0.1))"""
NOISES = {
    "sigmas": ":sigma 0.2",
    "covariance": ":covariance [[0.04 0.01] [0.01 0.09]]",
    "information": ":information [[4 1] [1 9]]",
    "loss": ":sigma 0.2 :loss cauchy",
    "corrections": ":sigma 0.2 :errors ((x 0.1) (y 0.1))",
}


def equations_of(noise: str):
    random = np.random.default_rng(5)
    marks = dict(zip("xyuv", random.normal(size=(4, 6)), strict=True))
    seen = dict(zip("tz", random.normal(size=(2, 5)), strict=True))
    compiled = mbm.loads(TEXT.format(noise=noise)).compile(data={"marks": marks, "seen": seen})
    found = compiled.elaborated
    starts = {name: np.asarray(value) for name, value in found.starts.items()}
    return assemble(found.problem, compiled.kernels, found.tables, starts, compiled.cache)[0]


@pytest.mark.parametrize("varied", ["", "factors", "rows"])
@pytest.mark.parametrize("noise", NOISES)
def test_gradients_are_the_slopes_of_half_the_cost(noise, varied):
    """Central differences over 2h = 2e-5: their error, h²/6 times a third derivative of some 1e4, is below 1e-6 …

    … and rounding of a cost of some 1e3 adds 1e3 · 1e-16 / 1e-5 = 1e-8."""
    equations = equations_of(NOISES[noise])
    if varied == "factors":
        equations = equations.with_factors(np.linspace(0.5, 2.0, equations.whole))
    if varied == "rows":
        units = np.ones(equations.every_unit.max() + 1, dtype=bool)
        units[[1, 8]] = False
        equations = equations.kept(units)
    random, n, h = np.random.default_rng(6), equations.dimension, 1e-5
    points = np.stack([equations.retract(equations.numbers, 0.1 * random.normal(size=n)) for _ in range(3)])

    def cost(point, step):
        return np.square(equations.residuals(equations.retract(point, step))).sum()

    expected = [[(cost(p, e) - cost(p, -e)) / (4 * h) for e in h * np.eye(n)] for p in points]
    found = gradients_at(equations, points)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
