"""Outlines in images: the points of a circle that a sphere on the axis of the camera is seen as."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.report.view.images import image_rows
from mbm.report.view.near_curves import contour_photographs
from mbm.report.view.photographs import photographs, together
from tests.report.view.pictured import of_text

FOCAL, CENTRE, DEPTH, RADIUS = 100.0, (50.0, 40.0), 2.0, 0.5
ANGLES = np.linspace(0.1, 2 * np.pi, 24)


def seen_radius(radius):
    """The tangent cone of a sphere on the axis has the sine radius/depth."""
    return FOCAL * radius / np.sqrt(DEPTH**2 - radius**2)


def problem(axes="opencv", more="", distances=None):
    """Points a pixel outside and inside of the circle in turns, in two photographs."""
    away = np.where(np.arange(24) % 2, 1.0, -1.0) if distances is None else distances
    reach = seen_radius(RADIUS) + away
    u, v = CENTRE[0] + reach * np.cos(ANGLES), CENTRE[1] + reach * np.sin(ANGLES)
    points = enumerate(zip(u.tolist(), v.tolist(), strict=True))
    rows = " ".join(f'("{"a" if i < 9 else "b"}" {p!r} {q!r})' for i, (p, q) in points)
    place = f"[0 0 {DEPTH}]" if axes == "opencv" else f"[{DEPTH} 0 0]"
    return f"""(problem p
      (data edge (table (photo u v) {rows}))
      (camera cam :focal {FOCAL} :center (50 40) :axes {axes})
      (unknowns (r :init 0.4))
      (observe edge (= 0 (contour-distance (silhouette cam (trans {place} (sphere r))) [u v])) :sigma 0.1 {more}))"""


def test_predicted_are_the_nearest_points_of_the_outline():
    found = of_text(problem())
    photos = {photo.name: photo for photo in contour_photographs(found.problem, found.solution, found.seen)}
    assert sorted(photos) == ["a", "b"]
    assert sum(len(photo.measured) for photo in photos.values()) == 24
    radius = seen_radius(float(found.solution.numbers[0]))
    for photo in photos.values():
        assert (photo.down, photo.left, photo.labels) == (True, False, ("u", "v"))
        way = photo.measured - CENTRE
        nearest = CENTRE + radius * way / np.linalg.norm(way, axis=1, keepdims=True)
        np.testing.assert_allclose(photo.predicted, nearest, atol=1e-6)
        points = np.concatenate([line.points for line in photo.lines])
        np.testing.assert_allclose(np.linalg.norm(points - CENTRE, axis=1), radius, rtol=1e-6)
        turns = np.sort(np.arctan2(*(points - CENTRE).T))
        assert np.diff(turns).max() < 0.3  # all around


def test_coordinates_of_the_paper_grow_upwards():
    found = of_text(problem(axes="paper"))
    photo = next(iter(contour_photographs(found.problem, found.solution, found.seen)))
    assert (photo.down, photo.left, photo.labels) == (False, True, ("X", "Y"))


def test_outliers_and_rows_that_are_not_used_are_told():
    away = np.zeros(24)
    away[5] = 6.0
    found = of_text(problem(more=":loss tukey", distances=away))
    photos = tuple(contour_photographs(found.problem, found.solution, found.seen))
    told = np.concatenate([photo.outlier for photo in photos])
    assert told.sum() == 1
    far = np.concatenate([np.linalg.norm(photo.measured - photo.predicted, axis=1) for photo in photos])
    assert far[told] == pytest.approx(6.0, abs=0.1)


def test_points_and_outlines_of_one_photograph_are_one_picture():
    spots = f"""(data spots (table (u v) (50.5 40.2)))
      (observe spots (= [u v] (project cam (trans [0 0 {DEPTH}] [0 0 (* 0 r)]))) :sigma 1)"""
    text = problem().replace("(photo u v)", "(part u v)").replace("(camera cam", f"{spots} (camera cam")
    found = of_text(text)
    rows = tuple(image_rows(found.problem, found.solution, found.seen.seeings))
    contours = tuple(contour_photographs(found.problem, found.solution, found.seen))
    points = photographs(rows, found.solution, found.seen.library)
    (photo,) = together((*points, *contours))
    assert len(photo.measured) == len(photo.predicted) == len(photo.used) == 25
    assert photo.lines
