"""The desk of the first paper (Figs. 4, 5, 7, 10) in one image: as it is printed, and as it is meant."""

from __future__ import annotations

import numpy as np
import pytest

from tests.evidence.material import PROBLEMS, loaded, read_table

DESK = """
(rectangular (x y)
  (vertexes (1 (x y 0)) (2 ((- x) y 0)) (3 ((- x) (- y) 0)) (4 (x (- y) 0)))
  (lines (1 (1 2)) (2 (2 3)) (3 (3 4)) (4 (4 1)))
  (planes (1 (1 2 3 4)) (2 (1 4 3 2))))

(desk (x y r h &optional (dx 0.03) (dy 0.03))
  (declare (x2 (- %s dx)) (y2 (- %s dy))
           (array leg (leg1 leg2 leg3 leg4))
           (array legpos ((x2 y2 0) ((- x2) y2 0) ((- x2) (- y2) 0) (x2 (- y2) 0))))
  (board (trans (0 0 h) (rectangular x y)))
  (for (i 1 4)
    ((leg i) (trans (legpos i) (cylinder r h)))))

(problem desk
  (constants (k0 800) (k1 800) %s)
  (data corners (csv "corners.csv"))
  (unknowns (psi angle :init 0.2) (xg :init 2.5m) (yg :init 0m) %s)
  (observe corners
    (= [X Y] (perse (trans [xg yg -1.5m] (rotate [0 0 psi] (feature (desk x y 25mm h) path)))))
    :sigma 2)
  %s)
"""
LEGS = {"fixed": ("x", "y"), "literal": ("(/ x 2)", "(/ y 2)")}
KNOWN = "(x 0.6m) (y 0.35m) (h 0.7m)"
FREE = "(x :init 0.6m) (y :init 0.35m) (h :init 0.7m)"


def corners() -> dict[str, list[object]]:
    """The image of the desk as meant."""
    table = read_table(PROBLEMS / "desk" / "corners.csv")
    return {"path": table["path"], **{name: [float(cell) for cell in table[name]] for name in "XY"}}


def seen(half_x: float, half_y: float, at: tuple[float, float, float]) -> dict[str, list[object]]:
    """Noise-free image of the four board corners and the feet of legs 1 and 4, legs at (±half_x, ±half_y)."""
    psi, xg, yg = at
    board = [(sx * 0.6, sy * 0.35, 0.7) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    points = np.array([*board, (half_x, half_y, 0.0), (half_x, -half_y, 0.0)])
    turn = np.array([[np.cos(psi), -np.sin(psi), 0], [np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
    x, y, z = (points @ turn.T + [xg, yg, -1.5]).T
    paths = [*(f"board/vertex/{i}" for i in range(1, 5)), "leg1/origin", "leg4/origin"]
    return {"path": paths, "X": (800 * y / x).tolist(), "Y": (800 * z / x).tolist()}


# Legs as printed stand at half the (half) sides, less 3 cm; as meant, 3 cm in from the edges.
@pytest.mark.parametrize(("reading", "half"), [("fixed", (0.57, 0.32)), ("literal", (0.27, 0.145))])
def test_each_reading_recovers_the_pose_from_its_own_image(reading, half, tmp_path):
    pose = (0.4363, 3.1, 0.25)
    solved = loaded(tmp_path, DESK % (*LEGS[reading], KNOWN, "", ""), corners=seen(*half, pose)).solve()
    # Exact data: the estimates are the pose to rounding times the condition (below 10).
    np.testing.assert_allclose([float(solved[n].value) for n in ("psi", "xg", "yg")], pose, rtol=1e-12)
    assert solved.first.cost < 1e-20


def test_the_reading_as_printed_does_not_fit_the_desk_as_meant(tmp_path):
    solve = loaded(tmp_path, DESK % (*LEGS["literal"], KNOWN, "", ""), corners=corners()).solve().first
    # 9 degrees of freedom: a cost beyond 40 has a chance below 1e-5.
    assert solve.cost > 40
    assert solve.chi2_p < 1e-5
