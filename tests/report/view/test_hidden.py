"""Hidden lines: pieces of lines behind faces, against pieces that are known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.report.view.hidden import Faces
from mbm.report.view.solids import round_body
from mbm.report.view.viewpoint import View, outlines

CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((1, 1), (0, 1), (0, 0), (1, 0))], dtype=float)
SIDES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def pieces(faces: Faces, *points: tuple[float, ...]) -> list[tuple[bool, list[list[float]]]]:
    """Whether hidden, and the two ends in the picture."""
    found = faces.stretches(np.array(points, dtype=float))
    return [(s.hidden, np.round(s.points[[0, -1], :2], 9).tolist()) for s in found]


def square(z: float, half: float = 1.0) -> np.ndarray:
    return np.array([[half, half, z], [-half, half, z], [-half, -half, z], [half, -half, z]])


@pytest.mark.parametrize(("azimuth", "elevation", "far"), [(28, 24, 2), (135, 40, 3), (-100, 20, 0), (28, -24, 6)])
def test_three_edges_of_a_cube_are_hidden_those_at_the_far_corner(azimuth: float, elevation: float, far: int) -> None:
    view = View.at(azimuth, elevation)
    seen = view.of(CUBE)
    assert int(np.argmin(seen[:, 2])) == far  # the corner that is farthest from the viewer
    faces = Faces([seen[list(side)] for side in SIDES], [])
    edges = {tuple(sorted((a, b))) for side in SIDES for a, b in zip(side, (*side[1:], side[0]), strict=True)}
    assert len(edges) == 12
    for edge in edges:
        assert {s.hidden for s in faces.stretches(seen[list(edge)])} == {far in edge}


def test_a_line_behind_a_square_is_cut_where_it_passes_behind() -> None:
    faces = Faces([square(0.0)], [])
    assert pieces(faces, (-3, 0.5, -1), (3, 0.5, -1)) == [
        (False, [[-3, 0.5], [-1, 0.5]]),
        (True, [[-1, 0.5], [1, 0.5]]),
        (False, [[1, 0.5], [3, 0.5]]),
    ]
    assert pieces(faces, (-3, 0.5, 1), (3, 0.5, 1)) == [(False, [[-3, 0.5], [3, 0.5]])]


def test_a_line_through_a_square_is_cut_where_it_pierces_it() -> None:
    found = pieces(Faces([square(0.0)], []), (-0.5, 0, 1), (0.5, 0, -3))
    assert found == [(False, [[-0.5, 0], [-0.25, 0]]), (True, [[-0.25, 0], [0.5, 0]])]


def test_lines_in_a_face_are_not_hidden_by_it() -> None:
    tilted = square(0.0) @ np.array([[1, 0, 0], [0, 1, 0], [0.3, -0.2, 1]]).T
    faces = Faces([tilted], [])
    for a, b in ((0, 1), (1, 2), (0, 2)):
        assert [s.hidden for s in faces.stretches(tilted[[a, b]])] == [False]


def test_the_notch_of_a_polygon_hides_nothing() -> None:
    """An L: its missing quarter is x, y > 0."""
    corners = [(-1, -1), (1, -1), (1, 0), (0, 0), (0, 1), (-1, 1)]
    faces = Faces([np.array([[x, y, 0.0] for x, y in corners])], [])
    assert faces.hides(np.array([[0.5, 0.5, -1], [-0.5, 0.5, -1], [0.5, -0.5, -1]], float)).tolist() == [
        False,
        True,
        True,
    ]


def test_every_point_lies_in_one_of_the_faces_that_tile_a_square() -> None:
    """Points on the common sides too: the parity rule leaves no gap and no double."""
    grid = np.stack(
        [*np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5), indexing="ij"), np.zeros((5, 5))], axis=2
    )
    faces = Faces([], [grid])
    points = np.stack(
        [*np.meshgrid(np.linspace(-0.9, 0.9, 37), np.linspace(-0.9, 0.9, 37)), np.full((37, 37), -9.0)], 2
    )
    assert faces.hides(points.reshape(-1, 3)).all()
    assert not faces.hides(points.reshape(-1, 3) + np.array([2.5, 0, 0])).any()


def test_edge_on_faces_and_no_faces_hide_nothing() -> None:
    upright = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], dtype=float)
    for faces in (Faces([upright], []), Faces([], [])):
        assert pieces(faces, (0, 0, -1), (1, 0, -1)) == [(False, [[0, 0], [1, 0]])]


@pytest.mark.parametrize("elevation", [0.0, 24.0, 70.0])
def test_the_outline_of_a_sphere_is_a_circle_of_its_radius(elevation: float) -> None:
    body = round_body("sphere", {"r": 2.0})
    assert body is not None
    lines = outlines(View.at(28, elevation).of(body.patches[0]))
    radii = np.concatenate([np.hypot(line[:, 0], line[:, 1]) for line in lines])
    # facets of 5°: between their corners the surface lies deeper by at most 1 − cos 2.5° of the radius, twice
    assert np.abs(radii / 2 - 1).max() < 2e-3


def test_the_outline_of_a_cylinder_is_two_generators_square_to_the_view() -> None:
    body = round_body("cylinder", {"r": 1.0, "h": 3.0})
    assert body is not None
    view = View.at(0.0, 30.0)
    lines = [line for patch in body.patches for line in outlines(view.of(patch))]
    assert len(lines) == 2
    # generators are linear between grid angles of 5°; the normal is square to the view there to a facet's middle
    assert sorted(round(float(line[:, 0].mean()), 2) for line in lines) == [-1.0, 1.0]


@pytest.mark.parametrize("name", ["disk", "cylinder", "cone", "frustum", "tube", "sphere", "ellipsoid", "torus"])
def test_round_bodies_reach_as_far_as_their_vertexes(name: str) -> None:
    sizes = {"disk": (2,), "cone": (2, 3), "cylinder": (2, 3), "frustum": (2, 1, 3), "tube": (2, 1, 3), "sphere": (2,)}
    sizes |= {"ellipsoid": (2, 3, 4), "torus": (3, 1)}
    highest = {"disk": (2, 2, 0), "sphere": (2, 2, 2), "ellipsoid": (2, 3, 4), "torus": (4, 4, 1)}
    body = round_body(name, {str(k): float(v) for k, v in enumerate(sizes[name])})
    assert body is not None
    points = np.concatenate([patch.reshape(-1, 3) for patch in body.patches])
    np.testing.assert_allclose(points.max(axis=0), highest.get(name, (2, 2, 3)), rtol=1e-12, atol=1e-12)
