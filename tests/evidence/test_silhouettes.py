"""Poses and sizes from outlines without correspondences: contour points and moments of simulated images."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.stats import chi2, kstest

import mbm
from tests.kernels.outlines.scenes import ANGLES, PLACE, SIZE, measured, rotation, seen
from tests.kernels.outlines.test_outlines import HULLS, faces_of

BODIES = {
    "box": ("(box a 0.3 0.2)", HULLS["box"], "c"),
    "prism": ("(prism 6 a 0.3)", HULLS["prism"], "c"),
    "cylinder": ("(cylinder a 0.4)", HULLS["cylinder"], "0"),
    "cone": ("(cone a 0.4)", HULLS["cone"], "0"),
    "frustum": ("(frustum a 0.1 0.3)", HULLS["frustum"], "0"),
}
PROBLEM = """
(defmodel l-block (a) (or (trans ((/ a 2) 0 0) (box (* 2 a) a a)) (trans (0 0 a) (box a a a))))
(problem p
  (data d external)
  (camera cam :focal (800 810) :center (320 240))
  (unknowns (g :init {}) (h :init {}) {} (x :init {}) (y :init {}) (z :init {}) (a :init {}))
  (observe d {} :sigma 0.3))
"""
CONTOUR = "(contour-distance (silhouette cam (transform (pose3 (euler g h {}) [x y z]) {})) [u v])"


def outline(region: shapely.Geometry, count: int) -> np.ndarray:
    return shapely.get_coordinates(
        shapely.line_interpolate_point(region.exterior, np.arange(count) / count, normalized=True)
    )


def problem(shape: str, third: str, start: np.ndarray, observed: str = "") -> mbm.Problem:
    """``third`` is the angle about the shape's axis: an unknown c, or 0 for what that does not turn."""
    own = f"(c :init {start[2]})" if third == "c" else ""
    numbers = [repr(float(value)) for value in start]
    return mbm.loads(
        PROBLEM.format(numbers[0], numbers[1], own, *numbers[3:], observed or CONTOUR.format(third, shape))
    )


def truth(third: str) -> dict[str, float]:
    """Where the axis points is that of `scenes`; of shapes that nothing tells about it, by two angles."""
    named = dict(zip("ghcxyza", (*ANGLES, *PLACE, SIZE), strict=True))
    if third != "c":
        axis = rotation()[:, 2]  # (sin h cos g, -sin g, cos g cos h)
        named |= {"g": -np.arcsin(axis[1]), "h": np.arctan2(axis[0], axis[2])}
    return named


OFFSET = np.array([0.06, -0.05, 0.04, 0.02, -0.015, 0.12, 0.01])


@pytest.mark.parametrize("name", BODIES)
def test_contour_points_without_noise(name):
    shape, corners, third = BODIES[name]
    points = outline(shapely.MultiPoint(seen(corners)).convex_hull, 60)
    expected = truth(third)
    found = problem(shape, third, np.array(list(expected.values())) + OFFSET).solve(
        data={"d": {"u": points[:, 0], "v": points[:, 1]}}
    )
    assert found.status == "ok"
    for unknown in set(expected) - (set() if third == "c" else {"c"}):
        assert abs(found[unknown].value - expected[unknown]) < 1e-6, unknown


def test_a_block_that_hides_itself():
    """Its one size and its distance are free together, which is said; everything else is found."""
    a = SIZE
    region = shapely.union_all(faces_of([((2 * a, a, a), (0.1, 0, 0)), ((a, a, a), (0, 0, a))]))
    points = outline(region, 80)
    expected = truth("c")
    found = problem("(l-block a)", "c", np.array(list(expected.values())) + OFFSET / 2).solve(
        data={"d": {"u": points[:, 0], "v": points[:, 1]}}
    )
    assert found.solves[0].status == "unobservable"
    for unknown in "ghc":
        assert abs(found[unknown].value - expected[unknown]) < 1e-6, unknown
    for unknown in "xyz":
        assert abs(found[unknown].value / found["a"].value - expected[unknown] / a) < 1e-5, unknown


def test_what_starts_beyond_kinks():
    """From two faces seen to three: edges enter the outline on the way, which is one of the exact fit's steps."""
    points = outline(shapely.MultiPoint(seen(HULLS["box"])).convex_hull, 60)
    expected = truth("c")
    start = np.array([0.05, 0.3, 0.15, 0.05, 0.0, 2.1, 0.22])
    found = problem("(box a 0.3 0.2)", "c", start).solve(data={"d": {"u": points[:, 0], "v": points[:, 1]}})
    assert found.status == "ok"
    for unknown, value in expected.items():
        assert abs(found[unknown].value - value) < 1e-6, unknown


def test_moments_and_extremes():
    """Numbers of a whole outline, as the 1989 system took them: as many as there are unknowns, and more."""
    measures = ("area", "centroid", "perimeter", "left", "right", "top", "bottom")
    whole = measured("box", measures=measures)
    clauses = "(let ((S (silhouette cam (transform (pose3 (euler g h c) [x y z]) (box a 0.3 0.2))))) {})".format(
        "(= [ar pe cu cv lu lv ru rv tu tv bu bv] [(area S) (perimeter S) ((centroid S) 1) ((centroid S) 2) "
        + " ".join(f"((extreme S :{side}) {k})" for side in ("left", "right", "top", "bottom") for k in (1, 2))
        + "])"
    )
    values = np.concatenate(
        [whole[name] for name in ("area", "perimeter", "centroid", "left", "right", "top", "bottom")]
    )
    names = ["ar", "pe", "cu", "cv", "lu", "lv", "ru", "rv", "tu", "tv", "bu", "bv"]
    columns = dict(zip(names, values[:, None], strict=True))
    expected = truth("c")
    found = problem("", "c", np.array(list(expected.values())) + OFFSET / 2, clauses).solve(data={"d": columns})
    assert found.status == "ok"
    for unknown, value in expected.items():
        assert abs(found[unknown].value - value) < 1e-6, unknown


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "cylinder", "cone"])
def test_errors_match_their_covariances(name):
    """χ² of all errors of 1,000 runs against the stated covariances lies within its 99 % bounds."""
    shape, corners, third = BODIES[name]
    exact = outline(shapely.MultiPoint(seen(corners)).convex_hull, 60)
    expected = truth(third)
    names = [n for n in expected if third == "c" or n != "c"]
    compiled = problem(shape, third, np.array(list(expected.values()))).compile(
        data={"d": {"u": exact[:, 0], "v": exact[:, 1]}}
    )
    generator = np.random.default_rng(8)
    squares = []
    for _ in range(1000):
        points = exact + 0.3 * generator.normal(size=exact.shape)
        found = compiled.solve(data={"d": {"u": points[:, 0], "v": points[:, 1]}})
        errors = np.array([float(found[n].value - expected[n]) for n in found.covariance.names])
        squares.append(errors @ np.linalg.solve(found.covariance.matrix, errors))
    low, high = chi2.ppf([0.005, 0.995], 1000 * len(names))
    assert low < sum(squares) < high
    assert kstest(squares, chi2(len(names)).cdf).pvalue > 1e-3


def test_what_lies_behind_the_camera():
    """A silhouette of what reaches behind the camera has no numbers: the solve says which row, and computes nothing."""
    start = np.array([*ANGLES, 0.0, 0.0, 0.1, SIZE])
    found = problem("(box a 0.3 0.2)", "c", start).solve(data={"d": {"u": [1.0, 2.0], "v": [1.0, 3.0]}})
    assert found.solves[0].status == "not-converged"
    assert [d.code.name for d in found.solves[0].diagnostics] == ["not-finite-at-start"]
