"""Maps of pose graphs: places, edges, what is odometry, spreads; against the file and the estimates."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.map_panels import map_panels
from mbm.report.pictures import maps_of
from mbm.report.plots import draw
from tests.report.view.pictured import PROBLEMS, of_folder, of_text

pytest.importorskip("matplotlib")

TRACK = """(problem track
  (data nodes (table (id) (3) (1) (2)) :key id)
  (data marks (table (mark x y) ("a" 5 1)) :key mark)
  (data steps (table (from to d) (1 2 1) (2 3 1) (1 3 2.3)))
  (data sights (table (id mark dx dy) (1 "a" 5 1) (2 "a" 4 1) (3 "a" 3 1.2)))
  (unknowns (p (vector 2) :per nodes :init [id 0.1] :fixed (= id 1)) (m (vector 2) :per marks :init [x y]))
  (observe steps (= d (norm (- (p to) (p from)))) :sigma 0.1)
  (observe sights (= [dx dy] (- (m mark) (p id))) :sigma 0.2))"""


def test_the_map_of_a_loop_has_the_edges_of_its_file() -> None:
    found = of_folder("loop", "loop")
    (one,) = maps_of(found.problem, found.solution)
    lines = (PROBLEMS / "loop/yard.g2o").read_text().splitlines()
    edges = [tuple(map(int, line.split()[1:3])) for line in lines if line.startswith("EDGE_SE2")]
    assert sorted(map(tuple, one.edges.tolist())) == sorted(tuple(sorted(edge)) for edge in edges)
    assert one.next_to.tolist() == [abs(a - b) == 1 for a, b in one.edges.tolist()]
    answer = mbm.load(PROBLEMS / "loop/loop.mbm").solve()
    (poses,) = answer.result.solves[0].estimates
    np.testing.assert_array_equal(one.places, poses.value[:, 1:])  # angle, x, y
    sigmas = np.sqrt(np.array([np.diag(spread) for spread in one.spreads]))
    assert poses.sigma is not None
    np.testing.assert_allclose(sigmas[1:], poses.sigma[1:, 1:], rtol=1e-9)
    assert (sigmas[0] == 0).all()  # the first is fixed
    assert one.moving.all()


def test_residuals_of_edges_are_those_of_the_result() -> None:
    found = of_folder("loop", "loop")
    (one,) = maps_of(found.problem, found.solution)
    rows = mbm.load(PROBLEMS / "loop/loop.mbm").solve().residuals("steps")
    whitened = np.asarray(rows["whitened"]).reshape(-1, 3)
    np.testing.assert_allclose(np.sort(one.residuals), np.sort(np.sqrt((whitened**2).mean(axis=1))), rtol=1e-6)


def test_landmarks_are_no_poses_and_neighbours_follow_the_keys() -> None:
    found = of_text(TRACK)
    (one,) = maps_of(found.problem, found.solution)
    assert len(one.places) == 4
    assert not one.moving.any()
    assert len(one.edges) == 6
    assert not one.next_to.any()  # vectors have no odometry
    assert [panel.args[2] for panel in map_panels(one)] == ["map of p, m"]  # type: ignore[attr-defined]


def test_problems_without_joined_places_have_no_map() -> None:
    found = of_folder("calibration", "calibration")
    assert maps_of(found.problem, found.solution) == ()


def test_plot_begins_with_the_map() -> None:
    answer = mbm.load(PROBLEMS / "loop/loop.mbm").solve()
    titles = [axes.get_title() for axes in draw(answer.result).axes if axes.get_title()]
    assert titles[0] == "map of T"
    assert "residuals of steps" in titles


def test_a_map_of_space_is_drawn_from_above_and_aside() -> None:
    text = """(problem p
      (data nodes (table (id) (1) (2) (3)) :key id)
      (data steps (table (from to x) (1 2 1) (2 3 1) (1 3 2.1)))
      (unknowns (T (pose 3) :per nodes :init (pose3 (rot-x 0) [id 0 0]) :fixed (= id 1)))
      (observe steps (= (pose3 (rot-x 0) [x 0 0]) (between (T from) (T to))) :sigma 0.1))"""
    found = of_text(text)
    (one,) = maps_of(found.problem, found.solution)
    assert one.places.shape == (3, 3)
    assert one.next_to.tolist() == [True, True, False]
    panels = list(map_panels(one))
    assert [panel.args[2] for panel in panels] == ["T from above", "T in space"]  # type: ignore[attr-defined]
    right, up = panels[1].args[1]  # type: ignore[attr-defined]
    assert abs(float(right @ up)) < 1e-3  # rounded to four digits
    assert np.hypot(*right[:2]) == pytest.approx(1, abs=1e-3)
    assert np.linalg.norm(up) == pytest.approx(1, abs=1e-3)
