"""Planes and lines through points, however their normal is written: recognised, exact, weighted; one plane is one."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import mbm
from tests.estimation.closed_forms.numerics_cases import Floats, cloud

EXACT = 1e-9
"""Data without noise of the size of one: rounding of a singular value decomposition, which squares nothing."""

NORMAL = np.array([2.0, -3.0, 6.0]) / 7
SPACE = cloud(9, 2) - np.outer(cloud(9, 2) @ NORMAL - 1.5, NORMAL)
ANGLE = 2.2
FLAT = np.outer(np.full(6, 0.7), [np.cos(ANGLE), np.sin(ANGLE)]) + np.outer(
    np.arange(6.0), [-np.sin(ANGLE), np.cos(ANGLE)]
)


def solved(text: str, points: Floats, **more: Floats) -> dict[str, Any]:
    """The only solve of a problem over the table `d` of points."""
    columns = dict(zip("xyz", points.T, strict=False))
    result = mbm.loads(f"(problem p (data d external) {text})").solve(data={"d": {**columns, **more}})
    return dict(json.loads(result.to_json())["solves"][0])


@pytest.mark.parametrize(
    "equation", ["(- (dot n [x y z]) d)", "(= (* 3 d) (* 3 (dot [x y z] n)))", "(= 0 (dot n (- [x y z] (* d n))))"]
)
def test_a_direction_and_a_distance(equation: str) -> None:
    """The third is quadratic in the normal, and the same on unit vectors only."""
    found = solved(f"(unknowns (d) (n direction)) (observe d {equation}) (solve :method plane)", SPACE)["estimates"]
    np.testing.assert_allclose(found["n"]["value"], NORMAL, atol=EXACT)
    assert found["d"]["value"] == pytest.approx(1.5, abs=EXACT)


@pytest.mark.parametrize(
    ("range_", "angle", "distance"), [("", ANGLE, 0.7), (":in (-90deg 90deg)", ANGLE - np.pi, -0.7)]
)
def test_a_line_by_the_angle_of_its_normal(range_: str, angle: float, distance: float) -> None:
    text = f"""(unknowns (a angle {range_}) (d)) (observe d (- (+ (* x (cos a)) (* y (sin a))) d))
      (solve :method plane)"""
    found = solved(text, FLAT)["estimates"]
    assert found["a"]["value"] == pytest.approx(angle, abs=EXACT)
    assert found["d"]["value"] == pytest.approx(distance, abs=EXACT)


def test_a_vector_whose_length_is_its_own_affair() -> None:
    text = """(unknowns (n (vector 3)) (d)) (observe d (- (/ (dot n [x y z]) (norm n)) d) :sigma 1)
      (constraints (= (norm n) 1))"""
    solve = solved(text, SPACE)
    np.testing.assert_allclose(solve["estimates"]["n"]["value"], NORMAL, atol=1e-7)  # the constraint is iterated
    assert not solve.get("alternatives")


def test_a_plane_through_the_origin() -> None:
    text = "(unknowns (n direction)) (observe d (= 0 (dot n [x y z]))) (solve :method plane)"
    found = solved(text, SPACE - 1.5 * NORMAL)["estimates"]["n"]["value"]
    np.testing.assert_allclose(found, NORMAL, atol=EXACT)


def test_weights_count() -> None:
    """The weighted scatter matrix's least eigenvector; its eigenvalue is the cost."""
    rng = np.random.default_rng(1)
    points, sigma = SPACE + 0.05 * rng.normal(size=SPACE.shape), rng.uniform(0.01, 0.2, len(SPACE))
    weight = sigma**-2
    apart = points - weight @ points / weight.sum()
    values, axes = np.linalg.eigh(apart.T @ (weight[:, None] * apart))
    text = "(unknowns (n direction) (d)) (observe d (- (dot n [x y z]) d) :sigma s) (solve :method plane)"
    solve = solved(text, points, s=sigma)
    assert abs(axes[:, 0] @ solve["estimates"]["n"]["value"]) == pytest.approx(1, abs=1e-12)
    assert solve["cost"] == pytest.approx(values[0], rel=1e-8)  # the smallest eigenvalue of a matrix of squares


def test_points_on_a_line_of_space_leave_the_plane_open() -> None:
    text = "(unknowns (n direction) (d)) (observe d (- (dot n [x y z]) d)) (solve :method plane)"
    with pytest.raises(mbm.MbmError, match="closed form"):
        solved(text, np.outer(np.arange(5.0), [1.0, 2.0, 3.0]))


@pytest.mark.parametrize("noise", [":sigma 0.05", ":errors ((x 0.05) (y 0.05) (z 0.05))"])
@pytest.mark.parametrize("starts", ["", "(solve :starts (random 20))"])
def test_the_other_side_is_no_other_solution(noise: str, starts: str) -> None:
    points = SPACE + 0.05 * np.random.default_rng(3).normal(size=SPACE.shape)
    solve = solved(f"(unknowns (n direction) (d)) (observe d (- (dot n [x y z]) d) {noise}) {starts}", points)
    assert solve["status"] == "converged"
    assert not solve.get("alternatives")


def test_a_place_reflected_with_its_direction_is_another_one() -> None:
    """A ray from p along n, of which only products are seen: (n, p) and (-n, -p) fit, and are not the same place."""
    n, p = NORMAL, np.array([0.5, 1.0, 2.0])
    products = {"u": np.outer(n, p).ravel(), "i": np.repeat([0.0, 1, 2], 3), "j": np.tile([0.0, 1, 2], 3)}
    pick = "(dot {} [(max 0 (- 1 (abs {})))  (max 0 (- 1 (abs (- {} 1)))) (max 0 (- 1 (abs (- {} 2))))])"
    left, right = (pick.format(name, k, k, k) for name, k in (("n", "i"), ("p", "j")))
    text = f"""(unknowns (n direction) (p (vector 3) :start (-3 3)))
      (observe d (= u (* {left} {right})) :sigma 0.01) (solve :starts (random 20))"""
    solve = solved(text, np.empty((9, 0)), **products)
    assert len(solve["alternatives"]) == 1
