"""Problems without a start, as people write them: the closed form is recognised and its answer is the truth."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm
from mbm.api.files import explain
from tests.estimation.closed_forms.numerics_cases import Floats, cloud, rotation

EXACT = 1e-8
"""Data without noise: what is left is rounding, squared once in the closed form."""

STATIONS = cloud(8, 1) * 3
PLACE = np.array([1.0, 2.0, 0.5])
RANGES = np.sqrt(np.square(STATIONS - PLACE).sum(axis=1))
TURN, SHIFT = rotation((0.2, 1.0, -0.5), 1.2), np.array([0.1, -0.2, 6.0])


def solved(text: str, method: str, **columns: Floats) -> dict[str, object]:
    """The document's estimates of a problem over one table `d`, by the method alone."""
    problem = f"(problem p (data d external) {text} (solve :method {method}))"
    result = mbm.loads(problem).solve(data={"d": dict(columns)})
    return {name: each["value"] for name, each in json.loads(result.to_json())["solves"][0]["estimates"].items()}


def ranges(values: Floats = RANGES) -> dict[str, Floats]:
    return dict(zip("xyzr", (*STATIONS.T, values), strict=True))


@pytest.mark.parametrize(
    "equation",
    [
        "(= r (distance p [x y z]))",
        "(- r (norm (- [x y z] p)))",
        "(- (sqrt (+ (^ (- (p 1) x) 2) (^ (- (p 2) y) 2) (^ (- (p 3) z) 2))) r)",
        "(= (^ r 2) (dot (- p [x y z]) (- p [x y z])))",
        "(= (/ r 343) (/ (distance p [x y z]) 343))",
    ],
)
def test_ranges_however_they_are_written(equation: str) -> None:
    found = solved(f"(unknowns (p (vector 3))) (observe d {equation})", "multilateration", **ranges())
    np.testing.assert_allclose(found["p"], PLACE, atol=EXACT)


def test_ranges_with_a_known_coordinate_and_stations_far_away() -> None:
    """Coordinates of the size that maps have (UTM): nine digits before the point, four after it."""
    far = {"x": STATIONS[:, 0] + 4e5, "y": STATIONS[:, 1] + 5e6, "z": STATIONS[:, 2], "r": RANGES}
    text = "(unknowns (e) (n)) (observe d (= r (distance [e n 0.5] [x y z])))"
    found = solved(text, "multilateration", **far)
    np.testing.assert_allclose([found["e"], found["n"]], [4e5 + 1, 5e6 + 2], atol=1e-4)


RADIO = np.array([7.0, -9.0])
"""A place outside of those from which it is heard."""


@pytest.mark.parametrize("far", [0.0, 4e5])
@pytest.mark.parametrize(
    ("unknowns", "equation", "gain", "offset"),
    [
        ("(p (vector 2)) (gain) (offset)", "(= r (+ (* gain (distance [x y] p)) offset))", 1.07, 0.4),
        ("(offset) (gain positive) (p (vector 2))", "(= r (- (* gain (norm (- p [x y]))) offset))", 0.9, -0.6),
        ("(p (vector 2)) (gain)", "(= r (* gain (distance p [x y])))", 1.2, 0.0),
        ("(a) (gain) (b)", "(- (/ (* gain (hypot (- a x) (- b y))) 3) (/ r 3))", 1.1, 0.0),
    ],
)
def test_ranges_of_unknown_scale_to_an_unknown_place(unknowns, equation, gain, offset, far):
    places = cloud(14, 3)[:, :2] * 3
    r = gain * np.linalg.norm(places - RADIO, axis=1) + offset
    places = places + far
    text = f"(unknowns {unknowns}) (observe d {equation})"
    found = solved(text, "scaled-ranges", x=places[:, 0], y=places[:, 1], r=r)
    at = found["p"] if "p" in found else [found["a"], found["b"]]
    close = 1e-7 if far == 0 else 1e-4  # squares of lengths about a middle that has six digits before the point
    np.testing.assert_allclose(np.array(at) - far, RADIO, atol=close)
    assert found["gain"] == pytest.approx(gain, abs=close)


def test_pseudo_ranges() -> None:
    text = "(unknowns (p (vector 3)) (bias)) (observe d (= r (+ bias (distance p [x y z]))))"
    found = solved(text, "multilateration", **ranges(RANGES + 3.0))
    np.testing.assert_allclose(found["p"], PLACE, atol=EXACT)
    assert found["bias"] == pytest.approx(3.0, abs=EXACT)


@pytest.mark.parametrize(
    "equation", ["(- (distance c [x y]) b)", "(- (+ (^ (- x (c 1)) 2) (^ (- y (c 2)) 2)) (^ b 2))"]
)
def test_circles(equation: str) -> None:
    angles = np.arange(7.0)
    rim = {"x": 1 + 2 * np.cos(angles), "y": 3 + 2 * np.sin(angles)}
    found = solved(f"(unknowns (c (vector 2)) (b positive)) (observe d {equation})", "multilateration", **rim)
    np.testing.assert_allclose([*found["c"], found["b"]], [1, 3, 2], atol=EXACT)


def pairs(target: Floats, points: Floats) -> dict[str, Floats]:
    return dict(zip(("x", "y", "z", "u", "v", "w"), (*points.T, *target.T), strict=True))


@pytest.mark.parametrize(
    ("kind", "model", "scale"),
    [
        ("similarity", "(= [u v w] (transform T [x y z]))", 1.7),
        ("similarity", "(- (transform T [x y z]) [u v w])", 1.7),
        ("similarity", "(= [x y z] (transform (inverse T) [u v w]))", 1.7),
        ("pose", "(= [u v w] (transform T [x y z]))", 1.0),
    ],
)
def test_point_pairs(kind: str, model: str, scale: float) -> None:
    points = cloud(6, 2)
    data = pairs(scale * points @ TURN.T + SHIFT, points)
    found = solved(f"(unknowns (T ({kind} 3))) (observe d {model})", "umeyama", **data)["T"]
    np.testing.assert_allclose(found["matrix"], TURN, atol=EXACT)
    np.testing.assert_allclose(found["translation"], SHIFT, atol=EXACT)
    assert found.get("scale", 1.0) == pytest.approx(scale)


def test_directions_turned() -> None:
    points = cloud(4, 3)
    data = pairs(points @ TURN.T, points)
    found = solved("(unknowns (R (rotation 3))) (observe d (= [u v w] (rotate R [x y z])))", "umeyama", **data)["R"]
    np.testing.assert_allclose(found["matrix"], TURN, atol=EXACT)


@pytest.mark.parametrize(("angle", "range_"), [(2.5, ""), (3.3, ":in (170deg 200deg)"), (-3.0, "")])
def test_a_pose_of_the_plane_as_three_numbers(angle: float, range_: str) -> None:
    points = cloud(5, 4)[:, :2]
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    seen = (points - [1.0, 2.0]) @ R
    data = dict(zip("xyuv", (*points.T, *seen.T), strict=True))
    text = f"(unknowns (px) (py) (h angle {range_})) (observe d (= [u v] (rotate (rot2 (- h)) (- [x y] [px py]))))"
    found = solved(text, "umeyama", **data)
    reported = np.angle(np.exp(1j * angle))  # angles are reported in (-π, π]
    np.testing.assert_allclose([found["px"], found["py"], found["h"]], [1, 2, reported], atol=EXACT)


def distorted(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Brown's model with k = (-0.2 0.05), p = (0.001 0.002), k3 = 0.01, in pixels of the camera below."""
    r2 = x * x + y * y
    radial = 1 + r2 * (-0.2 + r2 * (0.05 + r2 * 0.01))
    u = x * radial + 2 * 0.001 * x * y + 0.002 * (r2 + 2 * x * x)
    v = y * radial + 0.001 * (r2 + 2 * y * y) + 2 * 0.002 * x * y
    return 820 * u + 320, 810 * v + 240


CAMERA = "(camera cam :focal (820 810) :center (320 240) :distortion (-0.2 0.05 0.001 0.002 0.01))"


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("inverse", [False, True])
def test_images_of_known_points_by_a_camera_with_distortion(flat: bool, inverse: bool) -> None:
    points = cloud(9, 5, flat=flat)
    seen = points @ TURN.T + SHIFT
    u, v = distorted(seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2])
    pose = "(inverse T)" if inverse else "T"
    text = f"{CAMERA} (unknowns (T (pose 3))) (observe d (= [u v] (project cam (transform {pose} [x y z]))))"
    found = solved(text, "pose-from-points", **dict(zip("xyzuv", (*points.T, u, v), strict=True)))["T"]
    np.testing.assert_allclose(found["matrix"], TURN.T if inverse else TURN, atol=1e-7)
    np.testing.assert_allclose(found["translation"], -TURN.T @ SHIFT if inverse else SHIFT, atol=1e-6)


def test_euler_angles_and_a_position_before_the_camera_of_the_paper() -> None:
    """Rz(ψ) Ry(θ) Rx(φ), x forward; the numbers are recovered, not only the pose."""
    truth = {"phi": 0.3, "theta": -0.4, "psi": 2.0, "xg": 5.0, "yg": 0.2, "zg": -0.3}
    R = rotation((0, 0, 1), 2.0) @ rotation((0, 1, 0), -0.4) @ rotation((1, 0, 0), 0.3)
    points = cloud(7, 6)
    seen = points @ R.T + [5.0, 0.2, -0.3]
    data = dict(zip("xyzuv", (*points.T, 800 * seen[:, 1] / seen[:, 0], 780 * seen[:, 2] / seen[:, 0]), strict=True))
    text = """(constants (k0 800) (k1 780))
      (unknowns (phi angle) (theta angle) (psi angle) (xg) (yg) (zg))
      (observe d (= [u v] (perse (trans [xg yg zg] (rotate [phi theta psi] [x y z])))))"""
    found = solved(text, "pose-from-points", **data)
    np.testing.assert_allclose([found[n] for n in truth], list(truth.values()), atol=1e-7)


def test_a_rotation_vector_and_a_position() -> None:
    axis = np.array([0.2, 1.0, -0.5])
    vector = 1.2 * axis / np.linalg.norm(axis)
    points = cloud(7, 7)
    seen = points @ TURN.T + SHIFT
    u, v = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
    text = """(camera cam :focal (1 1) :center (0 0)) (unknowns (r (vector 3)) (t (vector 3)))
      (observe d (= [u v] (project cam (+ t (rotate (axis-angle r) [x y z])))))"""
    found = solved(text, "pose-from-points", **dict(zip("xyzuv", (*points.T, u, v), strict=True)))
    np.testing.assert_allclose([*found["r"], *found["t"]], [*vector, *SHIFT], atol=1e-7)


def test_a_point_seen_from_known_places() -> None:
    seen = np.arctan2(2.0 - STATIONS[:, 1], 1.0 - STATIONS[:, 0])
    text = "(unknowns (p (vector 2))) (observe d (= a (atan2 (- (p 2) y) (- (p 1) x))))"
    found = solved(text, "intersection", x=STATIONS[:, 0], y=STATIONS[:, 1], a=seen)
    np.testing.assert_allclose(found["p"], [1.0, 2.0], atol=EXACT)


def test_each_member_of_a_family_has_its_own_answer() -> None:
    tags = np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 2.0]])
    distances = [np.sqrt(np.square(STATIONS - tag).sum(axis=1)) for tag in tags]
    columns = {n: np.tile(c, 2) for n, c in zip("xyz", STATIONS.T, strict=True)}
    columns |= {"r": np.concatenate(distances), "tag": np.repeat([1.0, 2.0], 8)}
    text = "(unknowns (p (vector 3) :per d.tag)) (observe d (= r (distance (p tag) [x y z])))"
    np.testing.assert_allclose(solved(text, "multilateration", **columns)["p"], tags, atol=EXACT)


def test_rows_that_are_left_out_take_no_part() -> None:
    wrong = RANGES.copy()
    wrong[3] += 5.0
    text = "(unknowns (p (vector 3))) (observe d (= r (distance p [x y z])) :when (not (= row 4)))"
    np.testing.assert_allclose(solved(text, "closed-form", **ranges(wrong))["p"], PLACE, atol=EXACT)


@pytest.mark.parametrize("method", ["closed-form", "umeyama"])
def test_other_equations_are_said_to_have_no_closed_form(method: str) -> None:
    text = "(unknowns (a) (b)) (observe d (= y (* b (sin (* a x)))))"
    with pytest.raises(mbm.MbmError) as caught:
        solved(text, method, x=np.arange(5.0), y=np.sin(np.arange(5.0)))
    assert [d.code.name for d in caught.value.diagnostics] == ["no-closed-form"]


def test_slopes_whose_squares_are_beyond_numbers_are_no_motion(tmp_path):
    """The kind of equation is looked for in a power of 1000: it was an internal fault of the eigenvalues."""
    path = tmp_path / "p.mbm"
    path.write_text("""(problem p (data d (table (id y) (1 2.5) (2 3.75) (3 4.5) (1 6.5) (2 8.25)))
      (unknowns (a :init 1) (b :init 2) (u1 :init 1) (u2 (vector 3) :init [1 2 3]))
      (observe d (if (and (< a a) (not (< a a))) (= 1 (norm (+ (+ u2 [a a a]) [a a a])))
                     (= y (^ (abs (asinh id)) (+ (+ a a) (+ a 1e3))))) :sigma 1))""")
    assert "Marquardt" in explain(path)
