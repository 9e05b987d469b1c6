"""A box from its faces: planes that are stated besides what the edges imply already must not hurt."""

from __future__ import annotations

import numpy as np
import pytest

from tests.evidence.material import loaded

CORNERS = np.array([(x, y, z) for z in (0, 3) for y in (0, 2) for x in (0, 4)], dtype=float)
NOISE = np.array(
    [
        [0.011, -0.006, 0.004], [-0.004, 0.009, 0.012], [0.007, 0.003, -0.010], [-0.012, -0.002, 0.006],
        [0.002, 0.013, -0.005], [0.008, -0.011, -0.003], [-0.009, 0.005, 0.001], [0.003, -0.001, 0.014],
    ]
)  # fmt: skip
PROBLEM = """
(problem box
  (data c (csv "c.csv") :key id :columns ((x x :unit m) (y y :unit m) (z z :unit m)))
  (unknowns (p (vector 3) :per c :init [x y z]))
  (observe c (= [x y z] (p id)) :sigma 1cm)
  (constraints %s)
  %s)
"""
EDGES = [(1, 2), (3, 4), (5, 6), (7, 8)], [(1, 3), (2, 4), (5, 7), (6, 8)], [(1, 5), (2, 6), (3, 7), (4, 8)]


def parallels() -> str:
    """All edges of one direction are equal: 27 equations of which 12 are independent."""
    lines = []
    for family in EDGES:
        (a, b), *others = family
        lines += [f"(= (- (p {b}) (p {a})) (- (p {d}) (p {c})))" for c, d in others]
    return " ".join(lines)


def planes() -> str:
    """Two opposite faces are planar: the parallel edges say so already, and the gradients depend on theirs."""
    corners = ((1, 2, 3, 4), (5, 6, 7, 8))
    rows = "(- (p {}) (p {})) (- (p {}) (p {})) (- (p {}) (p {}))"
    return " ".join(f"(= 0m^3 (det [{rows.format(b, a, c, a, d, a)}]))" for a, b, c, d in corners)


@pytest.mark.parametrize("method", ["penalty", "exact"])
@pytest.mark.parametrize("extra", ["", "planes"])
def test_box_is_the_orthogonal_projection(extra, method, tmp_path):
    measured = CORNERS + NOISE
    data = {"id": list(range(1, 9)), "x": measured[:, 0], "y": measured[:, 1], "z": measured[:, 2]}
    text = PROBLEM % (parallels() + (" " + planes() if extra else ""), f"(solve :constraints {method})")
    solved = loaded(tmp_path, text, c={k: list(v) for k, v in data.items()}).solve()
    # A parallelepiped is p0 + i·u + j·v + k·w: linear least squares by itself.
    design = np.array([[1, i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    best = design @ np.linalg.lstsq(design, measured, rcond=None)[0]
    np.testing.assert_allclose(solved["p"].value, best, rtol=0, atol=1e-8)
    assert solved.status == "ok"
    assert solved.first.cost == pytest.approx(float(np.sum((best - measured) ** 2)) / 1e-4, rel=1e-8)
    # 24 measured numbers, 12 of the parallelepiped; the planes are no further equations.
    assert solved.first.dof == 12
    hat = design @ np.linalg.solve(design.T @ design, design.T)
    np.testing.assert_allclose(solved["p"].sigma, 0.01 * np.sqrt(np.diag(hat))[:, None] * np.ones(3), rtol=1e-6)
