"""The features of the library's models, as their doc strings number them."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.shapes.library import LIBRARY_NAMES, library_definition
from tests.shapes.bodies import is_closed, pieces, volume

RIM = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)], dtype=float)
UP = np.array([0, 0, 5.0])


def _vertexes(model, call: str, count: int) -> np.ndarray:
    return np.array([model.numbers(f"(vertex {call} {n})") for n in range(1, count + 1)])


CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], dtype=float)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        ("(rectangular 2 1)", [(2 * x, y, 0) for x, y in CORNERS]),
        ("(disk 2)", 2 * RIM),
        ("(box 2 4 6)", [(x, 2 * y, z) for z in (-3, 3) for x, y in CORNERS]),
        ("(cylinder 2 5)", [*(2 * RIM), *(2 * RIM + UP)]),
        ("(cone 2 5)", [*(2 * RIM), (0, 0, 5)]),
        ("(frustum 2 1 5)", [*(2 * RIM), *(RIM + UP)]),
        ("(sphere 2)", [*(2 * RIM), (0, 0, 2), (0, 0, -2)]),
        ("(prism 4 2 5)", [*(2 * RIM), *(2 * RIM + UP)]),
        ("(tube 2 1 5)", [*(2 * RIM), *(2 * RIM + UP), *RIM, *(RIM + UP)]),
        ("(ellipsoid 1 2 3)", [(1, 0, 0), (0, 2, 0), (-1, 0, 0), (0, -2, 0), (0, 0, 3), (0, 0, -3)]),
        ("(torus 5 1)", [*(6 * RIM), *(4 * RIM), *(5 * RIM + UP / 5), *(5 * RIM - UP / 5)]),
        ("(grid 3 2 1 5)", [(x, y, 0) for y in (0, 5) for x in (0, 1, 2)]),
    ],
)
def test_vertexes(opened, call, expected):
    np.testing.assert_allclose(_vertexes(opened(), call, len(expected)), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("call", "ends"),
    [
        ("(rectangular 2 1)", [(1, 2), (2, 3), (3, 4), (4, 1)]),
        ("(disk 2)", [(3, 1), (4, 2)]),
        (
            "(box 2 4 6)",
            [(1, 2), (2, 3), (3, 4), (4, 1), (5, 6), (6, 7), (7, 8), (8, 5), (1, 5), (2, 6), (3, 7), (4, 8)],
        ),
        ("(cylinder 2 5)", [(1, 5), (2, 6), (3, 7), (4, 8)]),
        ("(cone 2 5)", [(1, 5), (2, 5), (3, 5), (4, 5)]),
        ("(frustum 2 1 5)", [(1, 5), (2, 6), (3, 7), (4, 8)]),
        ("(sphere 2)", [(3, 1), (4, 2), (6, 5)]),
        ("(prism 3 2 5)", [(1, 2), (2, 3), (3, 1), (4, 5), (5, 6), (6, 4), (1, 4), (2, 5), (3, 6)]),
        ("(tube 2 1 5)", [(n, n + 4) for n in (1, 2, 3, 4, 9, 10, 11, 12)]),
        ("(ellipsoid 1 2 3)", [(3, 1), (4, 2), (6, 5)]),
        ("(grid 3 2 1 5)", [(1, 2), (2, 3), (4, 5), (5, 6), (1, 4), (2, 5), (3, 6)]),
    ],
)
def test_lines(opened, call, ends):
    model = opened()
    points = _vertexes(model, call, max(max(pair) for pair in ends))
    for n, (a, b) in enumerate(ends, 1):
        np.testing.assert_array_equal(model.numbers(f"(line {call} {n})"), points[[a - 1, b - 1]])
    assert model.fault(f"(line {call} {len(ends) + 1})").code.name == "unknown-feature"


@pytest.mark.parametrize(
    ("call", "normals"),
    [
        ("(rectangular 2 1)", [(0, 0, 1), (0, 0, -1)]),
        ("(disk 2)", [(0, 0, 1), (0, 0, -1)]),
        ("(box 2 4 6)", [(0, 0, -1), (0, 0, 1), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0)]),
        ("(cylinder 2 5)", [(0, 0, -1), (0, 0, 1)]),
        ("(cone 2 5)", [(0, 0, -1)]),
        ("(frustum 2 1 5)", [(0, 0, -1), (0, 0, 1)]),
        ("(tube 2 1 5)", [(0, 0, -1), (0, 0, 1)]),
        ("(grid 3 2 1 5)", [(0, 0, 1), (0, 0, 1)]),
        (
            "(prism 6 2 5)",
            [(0, 0, -1), (0, 0, 1), *((np.cos(a), np.sin(a), 0) for a in np.pi / 6 + np.pi / 3 * np.arange(6))],
        ),
    ],
)
def test_planes_are_counter_clockwise_from_outside(opened, call, normals):
    model = opened()
    for n, expected in enumerate(normals, 1):
        points = model.numbers(f"(plane {call} {n})")
        normal = np.cross(points[1] - points[0], points[2] - points[1])
        np.testing.assert_allclose(normal / np.linalg.norm(normal), expected, atol=1e-14)
        np.testing.assert_allclose((points - points[0]) @ normal, 0, atol=1e-13)  # all of them in the plane


@pytest.mark.parametrize(
    ("call", "points"),
    [
        ("(disk 2)", {"center": (0, 0, 0)}),
        ("(box 2 4 6)", {"center": (0, 0, 0)}),
        ("(cylinder 2 5)", {"base": (0, 0, 0), "top": (0, 0, 5)}),
        ("(cone 2 5)", {"base": (0, 0, 0), "apex": (0, 0, 5)}),
        ("(frustum 2 1 5)", {"base": (0, 0, 0), "top": (0, 0, 5)}),
        ("(prism 3 2 5)", {"base": (0, 0, 0), "top": (0, 0, 5)}),
        ("(sphere 2)", {"center": (0, 0, 0)}),
    ],
)
def test_named_points(opened, call, points):
    for name, expected in points.items():
        np.testing.assert_array_equal(opened().numbers(f'(feature {call} "{name}")'), expected)


@pytest.mark.parametrize("name", LIBRARY_NAMES)
def test_every_model_documents_its_features(name):
    assert "Vertex" in library_definition(name).doc


def test_arguments_are_numbers(opened):
    fault = opened().fault('(cylinder "wide" 1)')
    assert fault.code.name == "wrong-kind"
    assert fault.place.text == '"wide"'
    assert opened().fault("(cylinder 1)").code.name == "wrong-arity"


@pytest.mark.parametrize(
    ("call", "circles"),
    [
        ("(disk 2)", [(2, 0)]),
        ("(tube 2 1 5)", [(2, 0), (2, 5), (1, 0), (1, 5)]),
        ("(torus 5 1)", [(6, 0), (4, 0), (5, 1), (5, -1)]),
    ],
)
def test_curves_are_circles_from_x(opened, call, circles):
    for n, (radius, height) in enumerate(circles, 1):
        found = opened().numbers(f'(curve-point (feature {call} "curve/{n}") 1)')
        np.testing.assert_allclose(found, [radius * np.cos(1), radius * np.sin(1), height], rtol=1e-14)


def test_the_volume_of_an_extruded_grid(opened):
    """Its cells are faces side by side: between them are no sides, and the body is closed."""
    content = opened().value("(extrude (grid 4 3 0.5 2) 3)").content
    assert volume(content) == pytest.approx(1.5 * 4 * 3, rel=1e-14)
    (surface,) = pieces(content)
    assert is_closed(surface)
