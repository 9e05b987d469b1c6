"""Errors in measured columns: kernels that eliminate them lead to the minima of a search, which takes over."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.solve.estimate import assemble
from tests.estimation.native.test_agreement import agree, minima

ELLIPSE = """(unknowns (c (vector 2) :init [0 0]) (a positive :init 1.5) (b positive :init 1.2) (phi angle :init 0))
  (observe t (let ((q (rotate (rot2 (- phi)) (- [x y] c)))) (- (+ (^ (/ (q 1) a) 2) (^ (/ (q 2) b) 2)) 1))"""
CIRCLE = "(unknowns (c (vector 2) :init [0 0]) (r positive :init 1.5)) (observe t (= (hypot (- x (c 1)) (- y (c 2))) r)"
LINE = "(unknowns (m :init 1) (k :init 0)) (observe u (= y (+ k (* m x)))"

KINDS = {
    "an ellipse": f"{ELLIPSE} :errors ((x 0.02) (y 0.02)))",
    "sigmas of the rows": f"{ELLIPSE} :errors ((x s) (y 0.03)))",
    "some values exact": f"{LINE} :errors ((x e) (y 0.2)))",
    "exact where it is flat": f"{ELLIPSE} :errors ((x e) (y 0.03)))",
    "noise of its own": f"{CIRCLE} :errors ((x 0.02) (y s)) :sigma 0.02)",
    "noise of some": f"{CIRCLE} :errors ((x 0.02) (y s)) :sigma e)",
    "a loss": f"{CIRCLE} :errors ((x 0.02) (y s)) :loss (huber 1.3))",
    "a line": f"{LINE} :errors ((x 0.1) (y 0.2)))",
    "two exact equations": "(unknowns (m :init 1) (k :init 0)) (observe u (= y (+ k (* m x))) (= z (* m (cos x))) "
    ":errors ((x 0.1) (y 0.2) (z 0.1)))",
    "a covariance": "(unknowns (m :init 1) (k :init 0)) (observe u (= [y z] [(+ k (* m x)) (* m (cos x))]) "
    ":covariance [[0.04 0.01] [0.01 0.02]] :errors ((x 0.1) (y 0.2)))",
    "an information": "(unknowns (m :init 1) (k :init 0)) (observe u (= [y z] [(+ k (* m x)) (* m (cos x))]) "
    ":information [[40 10] [10 20]] :errors ((x 0.1) (y 0.2)))",
    "beside others": f"{LINE} :errors ((x 0.1) (y 0.2))) (observe u (= z (* m (cos w))) :sigma 0.1)",
    "beside an unknown noise": f"{LINE} :errors ((x 0.1) (y 0.2))) (observe u (= z (* m (cos w))) :sigma unknown)",
    "a prior and a bound": "(unknowns (m :init 0.5 :in [0 0.8]) (k :init 0)) (observe u (= y (+ k (* m x))) "
    ":errors ((x 0.1) (y 0.2))) (constraints (normal k 0.2 0.1))",
    "a constraint": f"{CIRCLE} :errors ((x 0.02) (y s))) (constraints (= (+ (c 1) (c 2)) 0.6))",
    "an inequality": f"{CIRCLE} :errors ((x 0.02) (y s))) (constraints (<= r 1.9))",
}


def tables(seed: int = 0, count: int = 30):
    """Points about a turned ellipse that is nearly a circle, and values about a line."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0, 2 * np.pi, count)
    u, v = 2.0 * np.cos(angle), 1.9 * np.sin(angle)
    x, y = 1.0 + u * np.cos(0.4) - v * np.sin(0.4), -0.5 + u * np.sin(0.4) + v * np.cos(0.4)
    rim = {"x": x + 0.02 * random.normal(size=count), "y": y + 0.02 * random.normal(size=count)}
    rim |= {"s": random.uniform(0.01, 0.04, count), "e": 0.02 * (np.abs(np.sin(angle + 0.4)) < 0.7)}
    x = np.linspace(0.0, 3.0, count)
    line = {"x": x + 0.1 * random.normal(size=count), "y": 0.2 + 0.9 * x + 0.2 * random.normal(size=count)}
    line |= {"w": x, "e": 0.1 * (np.arange(count) % 3 > 0)}
    line["z"] = 0.9 * np.cos(x) + 0.1 * random.normal(size=count)
    return {"t": rim, "u": line}


def problem(kind: str) -> str:
    used = "u" if "observe u" in kind else "t"
    return f"(problem p (data {used} external) {kind})"


def used(kind: str, data):
    return {name: table for name, table in data.items() if f"observe {name}" in kind}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", KINDS)
def test_kinds(kind, seed, both):
    for pair in minima(both.of(problem(KINDS[kind]), **used(KINDS[kind], tables(seed)))):
        agree(pair)


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_and_slopes_are_the_general_ones(kind):
    """Also beside the minimum, as long as each point is nearer to the curve than to where its normals meet."""
    data = used(KINDS[kind], tables())
    compiled = mbm.loads(problem(KINDS[kind])).compile(data=data, backend="native")
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    straight = equations.straightened()
    centre = np.concatenate([np.ravel(e.value) for e in compiled.solve().first.estimates])
    random = np.random.default_rng(2)
    for _ in range(5):
        there = centre * (1 + 0.03 * random.normal(size=len(centre)))
        expected, slopes = equations.residuals(there), equations.jacobian(there)
        # Feet are known to 1e-8 of a standard deviation, residuals to the square of that, slopes to 1e-8 at worst.
        size = max(np.abs(expected).max(), 1.0)
        np.testing.assert_allclose(straight.residuals(there), expected, atol=1e-10 * size)
        wide = 1e-7 * np.abs(slopes).max()
        np.testing.assert_allclose(straight.jacobian(there), slopes, rtol=1e-7, atol=wide)
        np.testing.assert_allclose(equations.residuals_at(there[None])[0], expected, atol=1e-10 * size)


def test_points_far_from_the_curve_are_left_to_the_search():
    data = used(ELLIPSE, tables())
    compiled = mbm.loads(problem(KINDS["an ellipse"])).compile(data=data, backend="native")
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    points = np.array([[1.0, -0.5, 2.0, 1.9, 0.4], [1.0, -0.5, 4.0, 4.0, 0.4], [2.5, 0.5, 1.0, 0.8, 0.1]])
    assert not np.isfinite(equations.straightened().residuals_at(points)).all()
    there = equations.residuals_at(points)
    assert np.isfinite(there).all()
    for point, residuals in zip(points, there, strict=True):
        np.testing.assert_allclose(residuals, equations.residuals(point), atol=1e-10 * np.abs(residuals).max())


def test_first_order_stays_first_order():
    data = used(ELLIPSE, tables())
    compiled = mbm.loads(problem(KINDS["an ellipse"])).compile(data=data, backend="native")
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    rough, points = equations.roughly_corrected(), np.array([[1.0, -0.5, 2.1, 2.0, 0.4]])
    assert rough.straightened() is None
    np.testing.assert_array_equal(rough.residuals_at(points)[0], rough.residuals(points[0]))
    # 0.1 outside the ellipse is 0.1²/(2·2) from the tangent, a tenth of a standard deviation
    assert np.abs(rough.residuals(points[0]) - equations.residuals(points[0])).max() > 0.05


SHARED = """(problem p (data places external :key id) (data steps external :with (a places from) :with (b places to))
  (unknowns (m :init 1)) (observe steps (= d (* m (- b.x a.x))) :errors ((a.x 0.1) (b.x 0.1)) :sigma 0.2))"""


def test_what_shares_values_is_handed_over(both):
    steps = {"from": [1.0, 2.0, 3.0], "to": [2.0, 3.0, 4.0], "d": [1.1, 0.9, 1.2]}
    places = {"id": [1.0, 2.0, 3.0, 4.0], "x": [0.0, 1.1, 1.9, 3.2]}
    pairs = both.of(SHARED, places=places, steps=steps)
    assert all(pair[4] is None for pair in minima(pairs))


def test_more_equations_than_uncertain_values_are_handed_over(both):
    kind = "(unknowns (m :init 1)) (observe u (= y (* m x)) (= z (* m (cos x))) :errors ((x 0.1)) :sigma 0.2)"
    assert all(pair[4] is None for pair in minima(both.of(problem(kind), **used(kind, tables()))))


@pytest.mark.parametrize("kind", ["an ellipse", "exact where it is flat", "a loss", "two exact equations"])
def test_answers_are_those_without_machine_code(kind):
    data = used(KINDS[kind], tables(3))
    native, general = (mbm.loads(problem(KINDS[kind])).solve(data=data, backend=b) for b in ("native", "casadi"))
    assert native.status is general.status
    for one, other in zip(native.first.estimates, general.first.estimates, strict=True):
        scale = np.maximum(other.sigma, 1e-4 * np.abs(other.value))
        np.testing.assert_array_less(np.abs(one.value - other.value), 1e-9 * scale)
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-8)
    assert [d.code for d in native.first.diagnostics] == [d.code for d in general.first.diagnostics]
