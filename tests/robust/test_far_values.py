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
