"""Constrained minima on random data: by kernels and as a whole, by both methods, against Kuhn and Tucker.

Slopes come from complex steps through formulas written here: they are exact to rounding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbm.estimation.minimise.constrained import solve
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native.system import system_of
from mbm.problem.kinds import ConstraintMethod
from mbm.solver import description as of

STARTS = {"a": 0.5, "b": 0.5, "q": 0.3, "w": 0.3}
TRUE = {"a": 0.6, "b": 0.4, "q": 0.5, "w": 0.45}


def growth(p, x):
    return np.exp(p[0] * x + p[1])


def parabola(p, x):
    return p[0] * x + p[1] + p[2] * x * x


def decay(p, x):
    return p[0] * np.exp(-p[1] * x) + p[2] * x + p[3]


GROWTH = ("ab", "(exp (+ (* a x) b))", growth)
PARABOLA = ("abq", "(+ (* a x) b (* q x x))", parabola)
DECAY = ("abqw", "(+ (* a (exp (* -1 b x))) (* q x) w)", decay)

KINDS = {
    "a linear equation": (GROWTH, "(= (+ a b) 0.6)", lambda p: [p[0] + p[1] - 0.6]),
    "a product": (GROWTH, "(= (* a b) 0.05)", lambda p: [p[0] * p[1] - 0.05]),
    "a circle": (GROWTH, "(= (+ (* a a) (* b b)) 0.3)", lambda p: [p[0] ** 2 + p[1] ** 2 - 0.3]),
    "all linear": (PARABOLA, "(= (+ a b q) 0.6)", lambda p: [p[0] + p[1] + p[2] - 0.6]),
    "an equation between linear residuals": (PARABOLA, "(= (* a b) 0.3)", lambda p: [p[0] * p[1] - 0.3]),
    "an inequality": (GROWTH, "(<= (* a b) 0.03)", lambda p: [p[0] * p[1] - 0.03]),
    "some hold and some do not": (
        PARABOLA,
        "(<= (* a b) 0.3) (>= q 0.1) (<= b 5)",
        lambda p: [p[0] * p[1] - 0.3, 0.1 - p[2], p[1] - 5],
    ),
    "both": (
        DECAY,
        "(= (* a b) (+ 0.5 q)) (<= (+ (* q q) (* w w)) 0.4) (<= a 3)",
        lambda p: [p[0] * p[1] - 0.5 - p[2], p[2] ** 2 + p[3] ** 2 - 0.4, p[0] - 3],
    ),
    "two equations": (
        DECAY,
        "(= (* a b) (+ 0.5 q)) (= (+ (* q q) (* w w)) 0.4)",
        lambda p: [p[0] * p[1] - 0.5 - p[2], p[2] ** 2 + p[3] ** 2 - 0.4],
    ),
}


def slopes(function, point):
    """Derivatives (values, n) by complex steps."""
    steps = 1e-30j * np.eye(len(point))
    return np.array([np.imag(function(point + step)) / 1e-30 for step in steps]).T


def drawn(kind, seed):
    """A problem with random rows, and what its residuals and its constraints are."""
    (names, text, model), stated, constraints = KINDS[kind]
    generator = np.random.default_rng(seed)
    x = np.sort(generator.uniform(0.1, 1.5, int(generator.integers(5, 25))))
    sigma = float(generator.choice([0.01, 0.05, 0.3]))
    y = model(np.array([TRUE[name] for name in names]), x) + sigma * generator.standard_normal(len(x))
    unknowns = " ".join(f"({name} :init {STARTS[name]})" for name in names)
    observed = f"(observe t (= y {text}) :sigma {sigma})"
    problem = f"(problem p (data t external) (unknowns {unknowns}) {observed} (constraints {stated}))"
    return problem, {"x": x, "y": y}, lambda p: (model(p, x) - y) / sigma, lambda p: np.array(constraints(p))


def error(point, residuals, constraints, equality):
    """How far a point is from the minimum, by the step to it, in standard deviations on the surface of what holds.

    The Hessian of the Lagrange function comes from differences of exact slopes.
    """
    values = constraints(point)
    holds = equality | (values > -1e-9)
    normals = slopes(constraints, point)[holds]
    n = len(point)
    along = np.linalg.svd(normals)[2][len(normals) :].T if len(normals) else np.eye(n)

    def gradient(at):
        return slopes(residuals, at).T @ residuals(at)

    multipliers = np.linalg.lstsq(normals.T, -gradient(point), rcond=None)[0]

    def lagrange(at):
        return gradient(at) + slopes(constraints, at)[holds].T @ multipliers

    width = 1e-5
    hessian = np.array([(lagrange(point + e) - lagrange(point - e)) / (2 * width) for e in width * np.eye(n)])
    whole = np.block([[hessian, normals.T], [normals, np.zeros((len(normals),) * 2)]])
    step = np.linalg.solve(whole, -np.concatenate([lagrange(point), values[holds]]))[:n]
    jacobian = slopes(residuals, point)
    inner = np.linalg.inv(along.T @ jacobian.T @ jacobian @ along) if along.shape[1] else np.zeros((0, 0))
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", along, inner, along))
    return np.max(np.abs(step) / np.maximum(sigma, 1e-4 * np.abs(point))), values, multipliers


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_random_data(kind, seed, both, monkeypatch):
    text, rows, residuals, constraints = drawn(kind, seed)
    equations, start, settings, _, own = both.of(text, t=rows)[-1]
    assert own is not None
    ends = system_of(equations, settings).one(start)
    assert ends.states[0, of.REASON] in (of.SMALL_OFFSET, of.ROUNDING)
    far, values, multipliers = error(ends.numbers[0], residuals, constraints, equations.equality)
    # A last step of 1e-10 is what the tolerance leaves; the differences of the Hessian change the next by little.
    assert far < 1e-9
    violated = np.where(equations.equality, np.abs(values), values)
    assert violated.max() < 1e-12
    assert (multipliers[~(equations.equality[equations.equality | (values > -1e-9)])] > -1e-9).all()
    monkeypatch.setattr(solve, "kernel_constrained_minimum", lambda *_: None)
    for method in ConstraintMethod:
        general = minimise(equations, start, replace(settings, constraints=method), place=None)
        there, _, _ = error(general.point, residuals, constraints, equations.equality)
        assert there < 1e-9


def test_an_inequality_that_only_the_penalties_meet_is_let_go(both):
    """By hand: the first round ends at a = b = 0.775, beyond both inequalities; the minimum touches the first alone."""
    text = "(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 a) (= 1 b) :sigma 1) "
    text += "(constraints (<= (+ a b) 1.5) (<= a 0.76)))"
    equations, start, settings, general, native = both.of(text)[-1]
    assert native is not None
    np.testing.assert_allclose(native.point, [0.75, 0.75], rtol=0, atol=1e-12)
    np.testing.assert_allclose(general.point, [0.75, 0.75], rtol=0, atol=1e-9)
    assert native.constraints.forcing.tolist() == [True, False]
    np.testing.assert_allclose(native.constraints.multipliers, [0.25, 0.0], rtol=0, atol=1e-12)
    assert system_of(equations, settings).one(start).states[0, of.ROUNDS] == 1


def test_an_inequality_that_steps_run_into_is_taken_up(both):
    """The penalties end the first round inside the second inequality; on the first one alone the steps leave it."""
    text = "(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 a) (= 1 b) :sigma 1) "
    text += "(constraints (<= (+ a b) 1.5) (>= a 0.76)))"
    equations, start, settings, general, native = both.of(text)[-1]
    assert native is not None
    np.testing.assert_allclose(native.point, [0.76, 0.74], rtol=0, atol=1e-12)
    np.testing.assert_allclose(general.point, [0.76, 0.74], rtol=0, atol=1e-9)
    assert native.constraints.forcing.tolist() == [True, True]
    assert system_of(equations, settings).one(start).states[0, of.ROUNDS] == 1
