"""Bodies in which nothing is unknown: the programs of their sheets have no numbers as inputs."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbm
from tests.kernels.outlines.scenes import ANGLES, FOCAL, MEASURES, MODELS, PLACE, SHAPES, SIZE, measured

POINTS = ((300.0, 200.0), (340.0, 290.0))
PLACES = {
    "placed": (f"trans [{' '.join(map(str, PLACE))}]", (0, 0, 0)),
    "turned": (f"transform (pose3 (euler {' '.join(map(str, ANGLES))}) [{' '.join(map(str, PLACE))}])", ANGLES),
}


MOVED = [(shape, "turned") for shape in SHAPES] + [(s, "placed") for s in ("box", "l-block", "cylinder", "torus")]
"""What is only placed is a case of what is turned; a body of faces, of parts, with rims and without show it."""


@pytest.mark.parametrize(("shape", "place"), MOVED)
def test_they_measure_as_if_they_were_unknown(shape, place):
    """`test_outlines` compares the same bodies with closed forms; here only the unknown ``z`` of one row may move."""
    move, angles = PLACES[place]
    body = re.sub(r"\ba\b", str(SIZE), SHAPES[shape])
    silhouette = f"(silhouette cam ({move} {body}))"
    rows = "".join(f"(observe {m} (let ((S {silhouette})) {MEASURES[m]}) :sigma 1)" for m in MEASURES)
    table = " ".join(f"({u} {v})" for u, v in POINTS)
    found = mbm.loads(f"""{MODELS}
    (problem p
      (data points (table (u v) {table}))
      (camera cam :focal ({FOCAL} 810) :center (320 240))
      (unknowns (z :init 0))
      {rows}
      (observe points (- (contour-distance {silhouette} [u v]) z) :sigma 1))""").compile()
    expected = measured(shape, points=POINTS, angles=angles)
    values = found.residuals(np.zeros(1))
    # the outline may begin elsewhere: sums of 1e5 px² in another order
    np.testing.assert_allclose(values, np.concatenate(list(expected.values())), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.jacobian(np.zeros(1))[:, 0], [0.0] * (len(values) - 2) + [-1.0] * 2)


def test_one_beside_what_is_unknown():
    """The box is seen right of the fixed cylinder: its nearest face ends at (q + 0.1) / 1.9 of the focal length."""
    problem = """
    (defmodel both (q)
      (or (trans (-30cm 0 2m) (cylinder 5cm 20cm)) (trans (q 0 2m) (box 20cm 20cm 20cm))))
    (problem s
      (camera cam :focal 800)
      (unknowns (q :init 0.1m))
      (observe (= 400 ((extreme (silhouette cam (both q)) :right) 1)) :sigma 1))"""
    assert abs(mbm.loads(problem).solve()["q"].value - (400 / 800 * 1.9 - 0.1)) < 1e-9
