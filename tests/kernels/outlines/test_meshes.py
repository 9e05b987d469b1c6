"""Silhouettes of meshes from files, against unions of their triangles and closed forms; thousands of faces are few."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from tests.kernels.outlines.scenes import FOCAL, PLACE, SIZE, compiled, measured, seen

WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Of central differences of eighth order."""


def ball(count: int, rough: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) and triangles (2 count (count - 1), 3) of a sphere in ``count`` bands, its radii ``rough``."""
    polar, around = np.linspace(0, np.pi, count + 1)[1:-1], 2 * np.pi * np.arange(count) / count
    a, b = np.meshgrid(polar, around, indexing="ij")
    way = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1).reshape(-1, 3)
    radii = SIZE * (1 + rough * np.random.default_rng(1).normal(size=(len(way), 1)))
    corners = np.concatenate([radii * way, [[0, 0, SIZE], [0, 0, -SIZE]]])
    grid = np.arange(len(way)).reshape(count - 1, count)
    after = np.roll(grid, -1, axis=1)
    top, bottom = np.full(count, len(way)), np.full(count, len(way) + 1)
    faces = [
        np.stack([top, grid[0], after[0]], axis=1),
        np.stack([grid[:-1], grid[1:], after[1:]], axis=-1).reshape(-1, 3),
        np.stack([grid[:-1], after[1:], after[:-1]], axis=-1).reshape(-1, 3),
        np.stack([bottom, after[-1], grid[-1]], axis=1),
    ]
    return corners, np.concatenate(faces)


def written(path, corners: np.ndarray, faces: np.ndarray) -> str:
    """The form of a mesh that stands in a file."""
    lines = ["v " + " ".join(map(repr, row)) for row in corners.tolist()]
    lines += ["f " + " ".join(map(str, row)) for row in (faces + 1).tolist()]
    path.write_text("\n".join(lines), "utf-8")
    return f'(mesh "{path.as_posix()}")'


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    """A form, and the corners of its triangles (n, 3, 3)."""
    corners, faces = ball(24, 0.05)
    return written(tmp_path_factory.mktemp("mesh") / "rough.obj", corners, faces), corners[faces]


@pytest.mark.parametrize(("camera", "parts"), [("pinhole", 1), ("orthographic", 1), ("paper", 1), ("distorted", 16)])
def test_against_the_union_of_all_triangles(rough, camera, parts):
    """Chords of a sixteenth of a bent edge of 30 px, which bends by less than 0.05 px, are off by 2e-4 px."""
    form, triangles = rough
    share = np.arange(parts)[:, None] / parts
    after = np.roll(triangles, -1, axis=1)
    rings = (triangles[:, :, None] + share * (after - triangles)[:, :, None]).reshape(len(triangles), -1, 3)
    region = shapely.union_all(shapely.polygons(seen(rings, camera)), grid_size=1e-7)
    tolerance = 1e-7 if parts == 1 else 1e-5
    found = measured(form, camera)
    low_u, low_v, high_u, high_v = region.bounds
    np.testing.assert_allclose(found["area"], region.area, rtol=tolerance)
    np.testing.assert_allclose(found["perimeter"], region.length, rtol=10 * tolerance)
    np.testing.assert_allclose(found["centroid"], region.centroid.coords[0], atol=tolerance * 100)
    np.testing.assert_allclose(found["extent"], [high_u - low_u, high_v - low_v], rtol=tolerance)


def test_faces_with_four_corners_that_are_no_plane(tmp_path):
    """They are two triangles, as others that read such files have them: of a face that is folded nothing is cut off."""
    corners, _ = ball(12, 0.1)
    grid = np.arange(11 * 12).reshape(11, 12)
    after = np.roll(grid, -1, axis=1)
    faces = np.stack([grid[:-1], grid[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    triangles = corners[np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])]
    region = shapely.union_all(shapely.polygons(seen(triangles, "pinhole")))
    found = measured(written(tmp_path / "quads.obj", corners, faces), measures=("area", "centroid"))
    np.testing.assert_allclose(found["area"], region.area, rtol=1e-9)
    np.testing.assert_allclose(found["centroid"], region.centroid.coords[0], atol=1e-6)


@pytest.mark.parametrize("camera", ["pinhole", "distorted"])
def test_derivatives_against_differences(rough, camera):
    points = np.random.default_rng(3).uniform([230, 150], [480, 380], (8, 2))
    found = compiled(rough[0], camera, points=points.tolist())
    sizes = np.array([1, 1, 1, 1, 1, 1, 0.2, 800, 1])
    way = np.random.default_rng(4).uniform(-1, 1, 9) * sizes
    step = 2e-6  # corners come and go on the outline: hardly any within such a step
    expected = sum(w * (found.residuals(i * step * way) - found.residuals(-i * step * way)) for i, w in WEIGHTS.items())
    jacobian = found.jacobian(np.zeros(9))
    wrong = np.abs(jacobian @ way - expected / step) / (np.abs(jacobian * sizes).max(axis=1) + 1e-9)
    assert wrong.max() < 1e-6  # 1e-13 of 2e4 px², by the step


def test_tens_of_thousands_of_faces(tmp_path):
    """The image of a sphere at (x, y, z): the ellipse of Wijewickrema et al. (2006); chords are off by 4 / count²."""
    form = written(tmp_path / "ball.obj", *ball(100, 0))
    found = measured(form, measures=("area", "centroid"))
    x, y, z = PLACE
    cone = z**2 - SIZE**2
    area = np.pi * FOCAL * 810 * SIZE**2 * np.sqrt(x**2 + y**2 + cone) / cone**1.5
    np.testing.assert_allclose(found["area"], area, rtol=2e-3)
    np.testing.assert_allclose(found["centroid"], [320 + FOCAL * x * z / cone, 240 + 810 * y * z / cone], atol=0.05)


def test_what_is_larger_and_farther_away_is_seen_alike(rough):
    form, _ = rough
    near = measured(form, measures=("area", "centroid"))
    far = measured(f"(scale 1000 {form})", measures=("area", "centroid"), place=tuple(1000 * x for x in PLACE))
    np.testing.assert_allclose(far["area"], near["area"], rtol=1e-9)
    np.testing.assert_allclose(far["centroid"], near["centroid"], rtol=1e-9)
