"""Images of curves: a bent rail square to the axis of the camera, and a road that begins behind it."""

from __future__ import annotations

import numpy as np
import shapely

from mbm.report.view.near_curves import curve_photographs
from tests.report.view.pictured import of_text

FOCAL, CENTRE, DEPTH, SIZE = 100.0, np.array([50.0, 40.0]), 2.0, 0.5
RAIL = np.array([[-1.0, 0.2], [0.3, -0.1], [0.8, 0.9]])
BESIDE = np.array([[-0.8, 0.2], [-0.5, 0.0], [-0.1, 0.03], [0.2, -0.1], [0.5, 0.2], [0.6, 0.6], [0.8, 1.0]])
"""The last one lies beyond the end."""


def problem(axes="opencv", curve="(project cam (trans PLACE (polyline (CORNERS))))", points=None, more=""):
    """Points near the rail in two photographs."""
    points = CENTRE + FOCAL * SIZE / DEPTH * BESIDE if points is None else points
    rows = " ".join(f'("{"a" if i < 3 else "b"}" {p!r} {q!r})' for i, (p, q) in enumerate(points.tolist()))
    place, corner = (f"[0 0 {DEPTH}]", "[{} {} 0]") if axes == "opencv" else (f"[{DEPTH} 0 0]", "[0 {} {}]")
    corners = " ".join(corner.format(f"(* r {x})", f"(* r {y})") for x, y in RAIL.tolist())
    return f"""(problem p
      (data marks (table (photo u v) {rows}))
      (camera cam :focal {FOCAL} :center (50 40) :axes {axes})
      (unknowns (r :init 0.45))
      (define (rail {curve.replace("PLACE", place).replace("CORNERS", corners)}))
      (observe marks (= 0 (curve-distance rail [u v])) :sigma 1 {more}))"""


def photographs(text):
    found = of_text(text)
    image = CENTRE + FOCAL / DEPTH * float(found.solution.numbers[0]) * RAIL
    return list(curve_photographs(found.problem, found.solution, found.seen)), image


def test_predicted_are_the_nearest_places_of_the_curve():
    photos, image = photographs(problem())
    assert [(photo.name, len(photo.measured)) for photo in photos] == [("a", 3), ("b", 4)]
    rail = shapely.LineString(image)
    for photo in photos:
        assert (photo.down, photo.left, photo.labels) == (True, False, ("u", "v"))
        nearest = [rail.interpolate(rail.project(shapely.Point(p))).coords[0] for p in photo.measured]
        np.testing.assert_allclose(photo.predicted, nearest, atol=1e-5)
        drawn = np.concatenate([line.points for line in photo.lines])
        assert shapely.distance(shapely.points(drawn), rail).max() < 1e-9
        for corner in image:
            assert np.linalg.norm(drawn - corner, axis=1).min() < 1e-9
    np.testing.assert_allclose(photos[-1].predicted[-1], image[-1], atol=1e-5)


def test_coordinates_of_the_paper_grow_upwards():
    photos, _ = photographs(problem(axes="paper"))
    assert {(photo.down, photo.left, photo.labels) for photo in photos} == {(False, True, ("X", "Y"))}


def test_outliers_are_told():
    points = CENTRE + FOCAL * SIZE / DEPTH * BESIDE
    points[1] -= [0.0, 9.0]
    photos, _ = photographs(problem(points=points, more=":loss tukey"))
    outlier = np.concatenate([photo.outlier for photo in photos])
    assert np.flatnonzero(outlier).tolist() == [1]


def test_what_lies_behind_the_camera_is_not_drawn():
    """A straight road that runs from behind the camera away from it, a metre below and half a metre to the right."""
    along = np.array([3.0, 5.0, 9.0, 20.0])
    points = CENTRE + FOCAL * np.stack([0.5 / along, 1 / along], axis=1)
    road = "(project cam (polyline ([r 1 -5] [r 1 30])))"
    (first, *_), _ = photographs(problem(curve=road, points=points))
    (line,) = first.lines
    assert np.isfinite(line.points).all()
    assert (line.points > CENTRE).all()


def test_curves_of_a_plane_are_no_image():
    assert photographs(problem(curve="(trans [50 40] (polyline ([-20 5] [(* 40 r) 8])))"))[0] == []
