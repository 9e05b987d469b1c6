"""What is read off outlines, against closed forms, convex hulls, unions of polygons and fine meshes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.interpolate import CubicSpline
from scipy.special import ellipe

from tests.kernels.outlines.scenes import ANGLES, FOCAL, PLACE, SIZE, measured, rotation, seen

TURN = 2 * np.pi * np.arange(20_000) / 20_000
"""Of a circle that is drawn by so many chords, 2e-8 of the area is missing."""


def box(a: float, b: float, c: float) -> np.ndarray:
    return np.array([(x, y, z) for x in (-a, a) for y in (-b, b) for z in (-c, c)]) / 2


def circle(radius: float, z: float) -> np.ndarray:
    return np.stack([radius * np.cos(TURN), radius * np.sin(TURN), np.full(len(TURN), z)], axis=1)


HULLS = {
    "box": box(SIZE, 0.3, 0.2),
    "prism": np.array([(SIZE * np.cos(a), SIZE * np.sin(a), z) for a in np.arange(6) * np.pi / 3 for z in (0, 0.3)]),
    "disk": circle(SIZE, 0),
    "cylinder": np.concatenate([circle(SIZE, 0), circle(SIZE, 0.4)]),
    "cone": np.concatenate([circle(SIZE, 0), [(0, 0, 0.4)]]),
    "frustum": np.concatenate([circle(SIZE, 0), circle(0.1, 0.3)]),
    "bar": np.concatenate([circle(SIZE, 0), circle(SIZE, 0.3)]),
}


def agrees(found: dict[str, np.ndarray], region: shapely.Geometry, tolerance: float, *, upward: bool = False) -> None:
    """Against shapely's numbers of a polygon with its holes."""
    low_u, low_v, high_u, high_v = region.bounds
    size = max(high_u - low_u, high_v - low_v)
    np.testing.assert_allclose(found["area"], region.area, rtol=tolerance)
    np.testing.assert_allclose(found["perimeter"], region.length, rtol=tolerance)
    np.testing.assert_allclose(found["centroid"], region.centroid.coords[0], atol=tolerance * size)
    np.testing.assert_allclose(found["extent"], [high_u - low_u, high_v - low_v], rtol=tolerance)
    ends = [
        found["left"][0],
        found["right"][0],
        *(found[side][1] for side in ("top", "bottom")[:: -1 if upward else 1]),
    ]
    np.testing.assert_allclose(ends, [low_u, high_u, low_v, high_v], atol=tolerance * size)


@pytest.mark.parametrize("camera", ["pinhole", "orthographic", "paper"])
@pytest.mark.parametrize("shape", HULLS)
def test_convex_bodies(shape, camera):
    """The image of a convex body is the convex hull of the images of its edges."""
    region = shapely.MultiPoint(seen(HULLS[shape], camera)).convex_hull
    agrees(measured(shape, camera), region, 1e-7, upward=camera == "paper")


@pytest.mark.parametrize("shape", ["box", "frustum"])
def test_a_camera_that_looks_along_minus_z(shape):
    region = shapely.MultiPoint(seen(HULLS[shape], "opengl")).convex_hull
    agrees(measured(shape, "opengl"), region, 1e-7, upward=True)


@pytest.mark.parametrize("place", [(0.1, 0.25, 0.33), (0.1, 0.3, 0.6)])
@pytest.mark.parametrize("shape", ["cylinder", "frustum"])
def test_bodies_that_run_away(shape, place):
    """Its lines run up to seven times as fast where they are near as where they are far."""
    where = {"angles": (0.1, 0.15, 0.2), "place": place}
    region = shapely.MultiPoint(seen(HULLS[shape], **where)).convex_hull
    agrees(measured(shape, **where), region, 1e-7)


@pytest.mark.parametrize("camera", ["distorted", "fisheye"])
def test_bent_edges(camera):
    """Each face as a polygon of many points on its edges."""
    corners = box(SIZE, 0.3, 0.2)
    share = np.linspace(0, 1, 4000)[:, None]
    faces = []
    for axis in range(3):
        for side in (-1, 1):
            own = corners[np.sign(corners[:, axis]) == side][[0, 1, 3, 2]]
            edges = [a + share * (b - a) for a, b in zip(own, np.roll(own, -1, axis=0), strict=True)]
            faces.append(shapely.Polygon(seen(np.concatenate(edges), camera)))
    agrees(measured("box", camera), shapely.union_all(faces), 1e-7)


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid"])
def test_quadrics(shape):
    """The image of a quadric X'QX = 0 is the conic of P Q⁻¹ P' (Hartley and Zisserman 2004, result 8.9)."""
    axes = np.full(3, SIZE) if shape == "sphere" else np.array([SIZE, 0.3, 0.1])
    camera = np.diag([FOCAL, 810, 1]) + np.array([[0, 0, 320], [0, 0, 240], [0, 0, 0]])
    frame = camera @ np.column_stack([rotation(), PLACE])
    dual = frame @ np.diag([*axes**2, -1]) @ frame.T
    center = dual[:2, 2] / dual[2, 2]
    spread = np.outer(center, center) - dual[:2, :2] / dual[2, 2]
    minor, major = np.sqrt(np.linalg.eigvalsh(spread))
    found = measured(shape)
    np.testing.assert_allclose(found["area"], np.pi * major * minor, rtol=1e-10)
    np.testing.assert_allclose(found["perimeter"], 4 * major * ellipe(1 - (minor / major) ** 2), rtol=1e-10)
    np.testing.assert_allclose(found["centroid"], center, rtol=1e-10)
    reach = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(found["extent"], 2 * reach, rtol=1e-10)
    np.testing.assert_allclose(found["right"], center + spread[0] / reach[0], rtol=1e-10)
    np.testing.assert_allclose(found["bottom"], center + spread[1] / reach[1], rtol=1e-10)


def test_torus_from_afar():
    """Without perspective, both contours of a torus are parallel to the image of its circle (Steiner's formulas)."""
    scale, tube = FOCAL / 2, SIZE / 2
    major, minor = 0.4 * scale, 0.4 * scale * abs(rotation()[2, 2])
    length = 4 * major * ellipe(1 - (minor / major) ** 2)
    found = measured("torus", "orthographic", ("area", "perimeter"))
    np.testing.assert_allclose(found["area"], 2 * length * tube * scale, rtol=1e-10)
    np.testing.assert_allclose(found["perimeter"], 2 * length, rtol=1e-10)


@pytest.mark.parametrize(("angles", "holes"), [(ANGLES, 1), ((1.25, 0.0, 0.3), 1), ((1.5, 0.0, 0.4), 0)])
def test_torus(angles, holes):
    """With a hole, with one that the torus half hides, and with none; the mesh of n² cells is off by some 5/n²."""
    count = 72
    s = 2 * np.pi * np.arange(count + 1) / count
    a, b = np.meshgrid(s, s, indexing="ij")
    ring = 0.4 + SIZE / 2 * np.cos(b)
    image = seen(np.stack([ring * np.cos(a), ring * np.sin(a), SIZE / 2 * np.sin(b)], axis=-1), angles=angles)
    cells = np.stack([image[:-1, :-1], image[1:, :-1], image[1:, 1:], image[:-1, 1:]], axis=2)
    triangles = np.concatenate([cells.reshape(-1, 4, 2)[:, [0, 1, 2]], cells.reshape(-1, 4, 2)[:, [0, 2, 3]]])
    region = shapely.union_all(shapely.polygons(triangles), grid_size=1e-6)
    true_holes = [ring for ring in region.interiors if shapely.Polygon(ring).area > 1]  # rounding leaves gaps
    assert len(true_holes) == holes
    region = shapely.Polygon(region.exterior, true_holes)
    agrees(measured("torus", angles=angles), region, 1.5e-3)


def test_mug():
    """Its body is convex but for what is inside; its handle is what spheres cover whose centres run along a spline."""
    body = shapely.MultiPoint(seen(np.concatenate([circle(SIZE, 0), circle(SIZE, 0.3)]))).convex_hull
    knots = np.array([(SIZE, 0.08), (SIZE + 0.1, 0.06), (SIZE + 0.1, -0.06), (SIZE, -0.08)])
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    x, z = CubicSpline(way, knots, bc_type="natural")(np.linspace(0, way[-1], 400)).T
    around = np.stack([np.cos(TURN[::100]), np.sin(TURN[::100])], axis=1)
    spheres = []
    for center in np.stack([x, np.zeros_like(x), z + 0.15], axis=1) @ rotation().T + PLACE:
        distance = np.linalg.norm(center)
        ahead = center / distance
        side = np.linalg.svd(ahead[None])[2][1:]
        rim = np.sqrt(1 - (0.02 / distance) ** 2)  # where rays touch a sphere
        points = center - ahead * 0.02**2 / distance + 0.02 * rim * around @ side
        spheres.append(shapely.Polygon(seen(points, angles=(0, 0, 0), place=(0, 0, 0))))
    region = shapely.union_all([body, *spheres])
    assert len(region.interiors) == 1
    agrees(measured("mug"), region, 2e-4)


ENDS = {
    "arch": (np.radians([0, 200]), [([0.2], [-SIZE, SIZE]), ([0.4], [-SIZE, SIZE])]),
    "patch": (np.array([0.3, 2.2]), [([SIZE], [0, 0.4])]),
}
"""Angles about z between which smooth faces end, and the radii and heights of these."""


@pytest.mark.parametrize("angles", [(0.7, 0.4, 0.3), (0.3, 0.2, 4.0), (-1.2, 0.9, 2.0), (2.0, -0.5, 1.0)])
@pytest.mark.parametrize("shape", ENDS)
def test_smooth_faces_that_end(shape, angles):
    """The outermost of many points: 1e-3 rad beside an extreme of 0.4 m at 1.4 m, 1e-7 of its radius are missing."""
    (begin, end), faces = ENDS[shape]
    s = np.linspace(begin, end, 4001)
    points = [
        np.stack([radius * np.cos(s), radius * np.sin(s), np.full(len(s), z)], axis=1)
        for (radius,), heights in faces
        for z in heights
    ]
    image = seen(np.concatenate(points), angles=angles, place=(0.1, -0.05, 1.4))
    found = measured(
        shape, measures=("extent", "left", "right", "top", "bottom"), angles=angles, place=(0.1, -0.05, 1.4)
    )
    low, high = image.min(axis=0), image.max(axis=0)
    np.testing.assert_allclose(found["extent"], high - low, atol=1e-3)
    ends = [found["left"][0], found["right"][0], found["top"][1], found["bottom"][1]]
    np.testing.assert_allclose(ends, [low[0], high[0], low[1], high[1]], atol=1e-3)


@pytest.mark.parametrize(
    ("camera", "angles"), [("pinhole", ANGLES), ("distorted", ANGLES), ("paper", (2.0, -0.5, 1.0))]
)
def test_flat_ends_beside_smooth_sides(camera, angles):
    """Six faces as cells of a grid: of an arc of 200° by 400 chords 1e-5 of the radius are missing in the middle."""
    end, share = np.radians(200), np.linspace(0, 1, 401)
    a, b = np.meshgrid(share, share[::40], indexing="ij")
    faces = [(r, end * a, SIZE * (2 * b - 1)) for r in (0.2, 0.4)]
    faces += [(0.2 + 0.2 * b, end * a, z) for z in (-SIZE, SIZE)]
    faces += [(0.2 + 0.2 * a, angle, SIZE * (2 * b - 1)) for angle in (0, end)]
    triangles = []
    for radius, angle, z in faces:
        points = np.stack(np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), z + 0 * a), axis=-1)
        image = seen(points, camera, angles=angles)
        cells = np.stack([image[:-1, :-1], image[1:, :-1], image[1:, 1:], image[:-1, 1:]], axis=2).reshape(-1, 4, 2)
        triangles += [cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]]
    region = shapely.union_all(shapely.polygons(np.concatenate(triangles)), grid_size=1e-6)
    region = shapely.Polygon(region.exterior, [r for r in region.interiors if shapely.Polygon(r).area > 1])
    agrees(measured("arch", camera, angles=angles), region, 2e-5, upward=camera == "paper")


def faces_of(boxes) -> list[shapely.Polygon]:
    found = []
    for sides, place in boxes:
        corners = box(*sides) + place
        for axis in range(3):
            middle = np.mean(corners[:, axis])
            for low in (True, False):
                own = corners[(corners[:, axis] < middle) == low][[0, 1, 3, 2]]
                found.append(shapely.Polygon(seen(own)))
    return found


def test_concave_bodies():
    """A block of two boxes that share a face and the planes of others."""
    a = SIZE
    region = shapely.union_all(faces_of([((2 * a, a, a), (0.1, 0, 0)), ((a, a, a), (0, 0, a))]))
    assert region.area < region.convex_hull.area * 0.99
    agrees(measured("l-block"), region, 1e-9)
