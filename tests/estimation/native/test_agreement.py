"""Kernels lead to the minima of equations asked as a whole: all problems of ``problems/``, and kinds of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.equations.types import Reason
from tests.estimation.native.conftest import sigmas

PROBLEMS = Path(__file__).parents[3] / "problems"
FILES = sorted(PROBLEMS.glob("*/*.mbm"))
NAMES = [(file, name) for file in FILES for name in mbm.load(file).names]
TOGETHER = {"tags"}
"""The solves of ``for-each`` go in one batch and ask for no single minimum."""
STARTS = {"posture"}
"""So do several starts, of which the best is made exact by the same batch."""
FREE = {"bundle"}
"""A scene that may be moved has no one minimum to be sure of: the general path goes on from where kernels end."""
ELSEWHERE = {"boat", "hand", "mower", "mower-filter", "mower-smoother", "chain-intervals", "end-gauge"}
"""Sequences and bounded errors have solvers and tests of their own, in rooms of these names; or nothing is unknown."""


def minima(pairs):
    """The pairs that are fits to the end, of which there is one at least: a rough fit for a start may end anywhere."""
    found = [pair for pair in pairs if pair[2].tolerance <= 1e-6]
    assert found, "no fit was asked for to its end"
    return found


def agree(pair):
    equations, _, _, general, native = pair
    assert native is not None
    wide = sigmas(general)
    there, here = equations.coordinates(general.point), equations.coordinates(native.point)
    # Both end where the next step is below 1e-10 standard deviations, or at the rounding of the coordinates.
    size = 1e-9 * np.maximum(wide, 1e-4 * np.abs(there))
    np.testing.assert_array_less(np.abs(here - there), size + 1e-300)
    np.testing.assert_array_equal(native.at_bound, general.at_bound)
    # The covariance is a function of the point, whose error is far below the standard deviations.
    np.testing.assert_allclose(sigmas(native), wide, rtol=1e-8)
    rounding = 1e-12 * (general.cost + np.square(general.residuals).max(initial=0.0)) + 1e-20
    if general.constraints is not None:
        # Across a constraint the cost has a slope, and both meet it to 1e-12 units only.
        rounding += 1e-11 * (1 + general.cost)
    assert native.cost <= general.cost * (1 + 1e-12) + rounding
    assert native.reason.converged
    if general.constraints is not None:
        np.testing.assert_array_equal(native.constraints.forcing, general.constraints.forcing)
        wanted = general.constraints.multipliers
        # Multipliers are found to the weight times the violation that is left, 1e-12 units.
        np.testing.assert_allclose(native.constraints.multipliers, wanted, rtol=1e-5, atol=1e-5 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("file", "name"),
    [each for each in NAMES if each[1] not in TOGETHER | STARTS | FREE | ELSEWHERE],
    ids=lambda value: getattr(value, "stem", value),
)
def test_problems(file, name, both):
    mbm.load(file).named(name).solve(backend="native")
    for pair in minima(both.found):
        agree(pair)


@pytest.mark.parametrize(("file", "name"), [each for each in NAMES if each[1] in TOGETHER])
def test_problems_of_many_solves(file, name):
    native, general = (mbm.load(file).named(name).solve(backend=backend) for backend in ("native", "casadi"))
    assert len(native.solves) == len(general.solves) > 1
    for ours, theirs in zip(native.solves, general.solves, strict=True):
        assert (ours.key, ours.status) == (theirs.key, theirs.status)
        for one, other in zip(ours.estimates, theirs.estimates, strict=True):
            # Tolerances as those of a single minimum above.
            scale = np.maximum(other.sigma, 1e-4 * np.abs(other.value))
            np.testing.assert_array_less(np.abs(one.value - other.value), 1e-9 * scale)
            np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-8)


KINDS = {
    "bounds": "(unknowns (a :init 2 :in [0 3]) (b positive :init 2)) "
    "(observe t (= y (+ (* a x) (exp (* -1 b x)))) :sigma 0.1)",
    "a bound that holds": "(unknowns (a :init 2 :in [1.2 3]) (b :init 0)) (observe t (= y (+ (* a x) b)) :sigma 0.1)",
    "a loss": "(unknowns (a :init 2) (b :init 0)) (observe t (= y (+ (* a x) b)) :sigma 0.1 :loss (huber 1.3))",
    "another loss": "(unknowns (a :init 2) (b :init 1)) (observe t (= y (exp (+ (* a x) b))) :sigma 0.1 :loss cauchy)",
    "an unknown noise": "(unknowns (a :init 2) (b :init 1)) (observe t (= y (+ (exp (* a x)) b)) :sigma unknown)",
    "a direction": "(unknowns (d direction :init [1 2 2])) (observe t (= [x y z] d) :sigma 0.2)",
    "an equation": "(unknowns (a :init 2) (b :init 1)) (observe t (= y (exp (+ (* a x) b))) :sigma 0.1) "
    "(constraints (= (+ a b) 1))",
    "an inequality": "(unknowns (a :init 2) (b :init 1)) (observe t (= y (exp (+ (* a x) b))) :sigma 0.1) "
    "(constraints (<= (* a b) 0.1))",
}


def rows():
    generator = np.random.default_rng(3)
    x = np.linspace(0.1, 1.5, 23)
    y = 0.9 * x + 0.3 + 0.1 * generator.standard_normal(len(x))
    y[4] += 3.0
    return {"x": x, "y": y, "z": 0.1 * generator.standard_normal(len(x))}


@pytest.mark.parametrize("kind", KINDS)
def test_kinds(kind, both):
    for pair in minima(both.of(f"(problem p (data t external) {KINDS[kind]})", t=rows())):
        agree(pair)


def test_affine_equations_take_one_step(both):
    text = "(unknowns (a :init 2) (b :init 0)) (observe t (= y (+ (* a x) b)) :sigma 0.1)"
    (pair,) = both.of(f"(problem p (data t external) {text})", t=rows())
    agree(pair)
    assert pair[4].reason is pair[3].reason is Reason.ONE_STEP
    assert pair[4].iterations == 1


def test_of_what_is_not_determined_the_nearest_is_found(both):
    """The product is; along a · b = c the steps are perpendicular to the hyperbolas in the scaled metric."""
    text = "(unknowns (a :init 2) (b :init 1)) (observe t (= y (* a b x)) :sigma 0.1)"
    data = rows()
    slope = data["x"] @ data["y"] / (data["x"] @ data["x"])
    for pair in minima(both.of(f"(problem p (data t external) {text})", t=data)):
        for found in pair[3:]:
            assert found.reason.converged
            assert np.prod(found.point) == pytest.approx(slope, rel=1e-10)
        np.testing.assert_allclose(pair[4].point, pair[3].point, rtol=1e-9)


def test_a_start_without_a_value_is_said(both):
    text = "(unknowns (a :init -2)) (observe t (= y (* (sqrt a) x)) :sigma 0.1)"
    for pair in both.of(f"(problem p (data t external) {text})", t=rows()):
        assert {found.reason for found in pair[3:]} == {Reason.NOT_FINITE_AT_START}
        assert {found.bad_row for found in pair[3:]} == {0}


def test_trial_steps_to_where_there_is_no_value(both):
    """The Gauss-Newton step from far off leads to negative arguments of the root."""
    text = "(unknowns (a :init 400)) (observe t (= y (+ (sqrt a) (log (* a x)))) :sigma 0.1)"
    for pair in minima(both.of(f"(problem p (data t external) {text})", t=rows())):
        agree(pair)


@pytest.mark.parametrize("noise", [":covariance [[4 0] [0 1]]", ":covariance [[4 1] [1 1]]"])
@pytest.mark.parametrize("kind", ["covariance", "information"])
def test_noise_as_matrices(noise, kind, both):
    """Square roots of covariances are lower triangles, of information matrices upper ones; diagonal ones are both."""
    stated = noise.replace("covariance", kind)
    unknowns = "(unknowns (a :init 1) (b :init 0))"
    text = f"(problem p (data t external) {unknowns} (observe t (= [y z] [(exp a) (sin b)]) {stated}))"
    for pair in both.of(text, t=rows()):
        agree(pair)


def test_a_diagonal_matrix_before_one_that_is_not():
    """What is kept of the first data set must not whiten the second one."""
    text = """(problem p (data t external) (unknowns (a :init 1) (b :init 0))
      (observe t (= [y z] [(exp a) (sin b)]) :information [[4 w] [w 1]]))"""
    sets = [{**rows(), "w": np.full(23, value)} for value in (0.0, 1.5)]
    compiled = mbm.loads(text).compile(data={"t": sets[0]}, backend="native")
    compiled.solve()
    again = compiled.solve(data={"t": sets[1]})
    alone = mbm.loads(text).solve(data={"t": sets[1]}, backend="casadi")
    for name in "ab":
        assert again[name].value == pytest.approx(alone[name].value, rel=1e-10)
        assert again[name].sigma == pytest.approx(alone[name].sigma, rel=1e-8)
