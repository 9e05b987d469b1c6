"""Ranges that are wrong beyond all measure, and no start: consensus begins where the others tell the unknowns apart."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm

STATIONS = np.column_stack([1 + 0.3 * (np.arange(24) // 6), 0.7 + 0.4 * (np.arange(24) % 6), 2.7 + (np.arange(24) % 3)])
PLACE = np.array([1.7, 1.6, 0.9])
TEXT = (
    "(problem place (data ranges external) (unknowns (p (vector 3){start}))"
    " (observe ranges (= range (distance p [x y z])) {noise}){rule})"
)
BACKENDS = ("numpy", "native")
FAR = (1e9, 1e12, 1e300)


def ranges(far, wrong, scale=1.0):
    measured = np.linalg.norm(PLACE - STATIONS, axis=1) + 0.005 * np.random.default_rng(0).normal(size=24)
    measured[wrong] = far
    x, y, z = scale * STATIONS.T
    return {"ranges": {"x": x, "y": y, "z": z, "range": scale * measured}}


def solved(data, backend, *, rule="", noise="", start=""):
    if backend == "native":
        pytest.importorskip("llvmlite")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = TEXT.format(rule=rule, noise=noise, start=start)
        found = mbm.loads(text).compile(data=data, backend=backend).solve()
        return found.status, json.loads(found.to_json())["solves"][0]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("noise", [":sigma 5mm", ""])
@pytest.mark.parametrize("kind", ["lmeds", "msac"])
@pytest.mark.parametrize("far", FAR)
@pytest.mark.parametrize("wrong", [[0], [0, 1, 2, 3, 12]])
def test_a_range_that_is_far_off_is_left_out(backend, noise, kind, far, wrong):
    data = ranges(far, wrong)
    status, solve = solved(data, backend, rule=f" (solve :robust {kind})", noise=noise)
    good = np.setdiff1d(np.arange(24), wrong)

    def misfit(place):
        return np.linalg.norm(place - STATIONS[good], axis=1) - data["ranges"]["range"][good]

    assert status == "ok"
    found = solve["estimates"]["p"]["value"]
    if noise:
        # All good ranges lie within three stated deviations: least squares of these. 1e-6 m: the solver ends where a
        # step is 1e-8 and less of the deviations, which are 10 mm at most, scipy at 1e-8 of a metre.
        np.testing.assert_allclose(found, least_squares(misfit, PLACE).x, atol=1e-6)
    # How far off it is does not matter. 1e-8 m: both end where a step is 1e-8 of the deviations.
    _, nearer = solved(ranges(20.0, wrong), backend, rule=f" (solve :robust {kind})", noise=noise)
    np.testing.assert_allclose(found, nearer["estimates"]["p"]["value"], atol=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("far", FAR[:2])
def test_so_do_losses(backend, far):
    data = ranges(far, [0, 7])
    status, solve = solved(data, backend, noise=":sigma 5mm :loss tukey")
    _, given = solved(data, backend, noise=":sigma 5mm :loss tukey", start=" :init [1.75 1.75 1]")
    assert status == "ok"
    # Both end at one minimum, to 1e-8 of its deviations.
    np.testing.assert_allclose(solve["estimates"]["p"]["value"], given["estimates"]["p"]["value"], atol=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scale", [1e100, 1e150])
@pytest.mark.parametrize("rule", ["", " (solve :robust lmeds)", " (solve :robust gnc)"])
def test_large_units_warn_of_nothing(backend, scale, rule):
    """A picture in other units has the same answer, and no overflow on the way shows."""
    _, metres = solved(ranges(20.0, [3]), backend, rule=rule)
    _, large = solved(ranges(20.0, [3], scale), backend, rule=rule)
    own = np.array(large["estimates"]["p"]["value"]) / scale
    # The minima are those of the same residuals: 1e-7 m is 1e-5 of a deviation.
    np.testing.assert_allclose(own, metres["estimates"]["p"]["value"], atol=1e-7)


def rim(seed, far):
    """Twenty points on a circle about (3, 1) of radius 2, a quarter of them far to the right of it."""
    random = np.random.default_rng(seed)
    wrong = random.permutation(20)[:5]
    turned = random.uniform(0.0, 6.0, 20)
    x, y = np.array([[3.0], [1.0]]) + 2.0 * np.array([np.cos(turned), np.sin(turned)])
    x, y = x + random.normal(0.0, 0.1, 20), y + random.normal(0.0, 0.1, 20)
    x[wrong] = far * random.uniform(0.5, 1.0, 5)
    return {"points": {"x": x, "y": y}}, wrong


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("noise", [":sigma 0.1", ""])
@pytest.mark.parametrize("far", [100.0, 1e3])
@pytest.mark.parametrize("seed", [20, 21])
def test_a_circle_does_not_begin_where_wrong_points_lead(backend, seed, far, noise):
    """From thousands of radii away no few steps lead to the circle, though some arcs far off are told apart."""
    if backend == "native":
        pytest.importorskip("llvmlite")
    data, wrong = rim(seed, far)
    text = (
        "(problem rim (data points external) (unknowns (a) (b) (r positive))"
        f" (observe points (- (distance [x y] [a b]) r) {noise}) (solve :robust lmeds))"
    )
    found = mbm.loads(text).compile(data=data, backend=backend).solve()
    good = np.setdiff1d(np.arange(20), wrong)
    x, y = data["points"]["x"][good], data["points"]["y"][good]
    known = least_squares(lambda p: np.hypot(x - p[0], y - p[1]) - p[2], [3.0, 1.0, 2.0]).x
    assert found.status == "ok"
    # All good points lie within three stated deviations; scipy ends at 1e-8 of the unknowns, of a few units.
    np.testing.assert_allclose([float(found[name].value) for name in "abr"], known, atol=1e-6)


def test_nor_do_the_circles_of_a_batch():
    """Compiled code alone looks for the start of each."""
    pytest.importorskip("llvmlite")
    made = [rim(seed, 100.0) for seed in range(20, 60)]
    data = {name: np.concatenate([one["points"][name] for one, _ in made]) for name in "xy"}
    data["epoch"] = np.repeat(np.arange(len(made)), 20)
    text = (
        "(problem rims (data points external) (unknowns (a) (b) (r positive))"
        " (observe points (- (distance [x y] [a b]) r)) (for-each epoch) (solve :robust lmeds))"
    )
    found = mbm.loads(text).compile(data={"points": data}).solve()
    for solve in found.solves:
        # A circle of fifteen points with errors of 0.1: 0.3 is more than five deviations of its centre and radius.
        np.testing.assert_allclose([float(one.value) for one in solve.estimates], [3.0, 1.0, 2.0], atol=0.3)


def test_a_far_value_may_be_all_there_is_in_its_table():
    """Recognition of ranges leaves such rows out: then a table has none."""
    generator = np.random.default_rng(0)
    stations = generator.uniform(-10.0, 10.0, (8, 2))
    measured = np.hypot(*(stations - [1.0, 2.0]).T) + generator.normal(0.0, 0.01, 8)
    data = {
        "near": {"x": stations[:, 0], "y": stations[:, 1], "range": measured},
        "far": {"x": np.array([3.0]), "y": np.array([4.0]), "range": np.array([1e18])},
    }
    text = """
(problem place (data near external) (data far external) (unknowns (p (vector 2)))
  (observe own near (= range (norm (- p [x y]))) :sigma 0.01)
  (observe other far (= range (norm (- p [x y]))) :sigma 0.01)
  (solve :robust lmeds))
"""
    found = mbm.loads(text).solve(data=data).first
    assert found.status == "converged"
    # Five times the sigma of a place from eight ranges of 1 cm around it.
    np.testing.assert_allclose(found.estimates[0].value, [1.0, 2.0], atol=0.05)
