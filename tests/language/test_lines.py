"""Image lines and distances of features, against the geometry written out with NumPy."""

import numpy as np
import pytest

import mbm

ROUNDING = 1e-12


def residuals(*equations, extra=""):
    text = f"(problem p {extra} (unknowns (d :init 0)) (observe o (- d d) {' '.join(equations)} :sigma 1))"
    return mbm.loads(text).compile().residuals([0.0])[1:]


def alpha_rho(p, q):
    """Direction in [−π/2, π/2) and ρ = −X sin α + Y cos α."""
    alpha = np.arctan2(q[1] - p[1], q[0] - p[0])
    alpha = (alpha + np.pi / 2) % np.pi - np.pi / 2
    return alpha, -p[0] * np.sin(alpha) + p[1] * np.cos(alpha)


@pytest.mark.parametrize("q", [(3, 5), (-2, 1), (1, -4), (-3, -3), (1, 7), (9, 2)])
def test_a_line_through_two_points(q):
    p = (1, 2)
    alpha, rho = alpha_rho(np.array(p, float), np.array(q, float))
    found = residuals(f"(= (image-line {alpha:.17g} {rho:.17g}) (line-through [{p[0]} {p[1]}] [{q[0]} {q[1]}]))")
    np.testing.assert_allclose(found, [0, 0], atol=ROUNDING)
    swapped = residuals(f"(= (image-line {alpha:.17g} {rho:.17g}) (line-through [{q[0]} {q[1]}] [{p[0]} {p[1]}]))")
    np.testing.assert_allclose(swapped, [0, 0], atol=ROUNDING)


def test_turned_lines_are_the_same_line():
    found = residuals("(= (image-line 89deg 5) (image-line -89deg -6))")
    np.testing.assert_allclose(found, [np.radians(2), 1], atol=ROUNDING)
    found = residuals("(= (image-line 10deg 5) (image-line 200deg -7))")
    np.testing.assert_allclose(found, [np.radians(10), 2], atol=ROUNDING)


def test_distances_left_of_the_direction_are_positive():
    np.testing.assert_allclose(residuals("(vertex-on-line [0 2] (line-through [0 1] [5 1]))"), [1], atol=ROUNDING)
    np.testing.assert_allclose(residuals("(point-line-distance [3 3] (image-line 45deg 1))"), [-1], atol=ROUNDING)


BOX = "(box 2 4 6)"


def test_features_of_shapes():
    point = np.array([3.0, 4.0, 9.0])
    text = f"(- (point-plane-distance [3 4 9] (plane {BOX} NUMBER)) 0)"
    found = np.concatenate([residuals(text.replace("NUMBER", str(i))) for i in range(1, 7)])
    # Distances from the six planes x, y, z = ± half the sides, positive outside.
    wanted = [
        abs(point[k]) - h if s * point[k] > 0 else -(abs(point[k]) + h)
        for k, h in enumerate((1, 2, 3))
        for s in (1, -1)
    ]
    assert sorted(np.round(found, 9)) == pytest.approx(sorted(wanted), abs=1e-9)


def test_images_of_lines():
    camera = "(camera cam :focal 100 :center (10 20))"
    line = "(line (rectangular 1 2) 1)"  # from (1, 2, 0) to (-1, 2, 0)
    moved = f"(trans [0 0 4] {line})"
    alpha, rho = alpha_rho(np.array([10 + 25, 20 + 50.0]), np.array([10 - 25, 20 + 50.0]))
    found = residuals(f"(= (image-line {alpha} {rho}) (line-on-image cam {moved}))", extra=camera)
    np.testing.assert_allclose(found, [0, 0], atol=1e-9)
    found = residuals(f"(= (image-line {alpha} {rho}) (project cam {moved}))", extra=camera)
    np.testing.assert_allclose(found, [0, 0], atol=1e-9)
    found = residuals("(= [35 70] (vertex-on-image cam [1 2 4]))", extra=camera)
    np.testing.assert_allclose(found, [0, 0], atol=1e-9)


def test_distance_from_a_line_of_space():
    found = residuals("(point-line-distance [1 5 4] (line (rectangular 1 2) 1))")
    np.testing.assert_allclose(found, [5.0], atol=ROUNDING)  # hypot(5 - 2, 4)


@pytest.mark.parametrize(
    "form",
    [
        "(line-on-image cam [1 2 3])",
        "(vertex-on-line [1 2] [3 4])",
        "(= (image-line 1 2) [1 2])",
        "(point-plane-distance [1 2 3] (line (rectangular 1 2) 1))",
    ],
)
def test_other_things_are_refused(form):
    with pytest.raises(mbm.MbmError) as caught:
        residuals(form, extra="(camera cam)")
    assert caught.value.diagnostics[0].code.name in ("wrong-kind", "length-clash")


def test_a_line_is_seen_in_an_image_and_the_pose_comes_back():
    """Four edges of a rectangle seen as image lines determine where it is."""
    text = """(problem p (camera cam :focal 800 :axes paper)
      (data edges (table (n) (1) (2) (3) (4)))
      (unknowns (x :init 2.8) (y :init 0.15) (a angle :init 0.25))
      (observe edges
        (= (image-line A R)
           (line-on-image cam (trans [x y -0.5] (rotate [0 0 a] (line (rectangular 0.5 0.3) n)))))
        :sigma [1deg 1]))"""
    truth = {"x": 3.0, "y": 0.1, "a": 0.3}
    c, s = np.cos(truth["a"]), np.sin(truth["a"])
    corners = np.array([(0.5, 0.3), (-0.5, 0.3), (-0.5, -0.3), (0.5, -0.3)])
    world = corners @ np.array([[c, s], [-s, c]]) + [truth["x"], truth["y"]]
    image = 800 * np.column_stack([world[:, 1] / world[:, 0], -0.5 / world[:, 0]])
    rows = [alpha_rho(image[i], image[(i + 1) % 4]) for i in range(4)]
    table = " ".join(f"({i + 1} {a:.17g} {r:.17g})" for i, (a, r) in enumerate(rows))
    text = text.replace("(table (n) (1) (2) (3) (4))", f"(table (n A R) {table})")
    result = mbm.loads(text).solve()
    for name, value in truth.items():
        assert float(result[name].value) == pytest.approx(value, abs=1e-8)
