"""Outlines of objects in images that were rendered here, with the edges known, and pixels as a table."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

import mbm
from mbm.data.readers import READERS
from problems.reference.photographs import exposed, small_pixels
from tests.images.rendering import noisy, save

WIDTH, HEIGHT, SAMPLES, BLUR = 320, 240, 4, 0.7
U, V = small_pixels(WIDTH, HEIGHT, SAMPLES)
DARK, BRIGHT = 60.0, 180.0


def disk(u, v, radius):
    """How much of each small pixel is within a circle."""
    return np.clip((radius - np.hypot(U - u, V - v)) * SAMPLES + 0.5, 0, 1)


def polygon(*corners):
    """How much of each small pixel is within a convex polygon whose corners go clockwise, as seen with y down."""
    inside = np.ones_like(U)
    for (x, y), (p, q) in zip(corners, corners[1:] + corners[:1], strict=True):
        way = np.array([p - x, q - y]) / np.hypot(p - x, q - y)
        inside = np.minimum(inside, np.clip((way[0] * (V - y) - way[1] * (U - x)) * SAMPLES + 0.5, 0, 1))
    return inside


def image(part, *, inside=BRIGHT, outside=DARK):
    """The pixels of an object that takes this part of each small one."""
    return exposed(outside + (inside - outside) * part, SAMPLES, BLUR)


def read(*paths, **more):
    found = READERS["contour"].read(
        {path.stem: path for path in paths}, "part*.png", {"holes": "true", "every": 4.0, **more}
    )
    return {column.name: column.numbers if column.texts is None else column.texts for column in found.columns}


def of(folder, picture, seed=0, noise=2.0, **more):
    path = folder / "part.png"
    save(path, noisy(picture, np.random.default_rng(seed), noise))
    return read(path, **more)


@pytest.mark.parametrize(("radius", "noise"), [(60.0, 2.0), (60.0, 6.0), (60.0, 12.0), (12.0, 2.0)])
def test_errors_of_a_circle_are_as_large_as_is_stated(radius, noise, tmp_path):
    """χ² of distances from the true circle, over 1,000 points and more; their errors are independent and unbiased."""
    random = np.random.default_rng(3)
    wanted, ratios = 1000, []
    while sum(map(len, ratios)) < wanted:
        centre = np.array([160, 120]) + random.uniform(-3, 3, 2)
        table = of(tmp_path, image(disk(*centre, radius)), seed=random.integers(1000), noise=noise)
        away = np.hypot(table["u"] - centre[0], table["v"] - centre[1]) - radius
        ratios.append(away / table["sigma"])
    z = np.concatenate(ratios)
    # s² of a strip has 33 degrees of freedom, so that E[1/s²] adds 0.065 to χ²; 0.18 is four deviations of chance.
    assert abs((z**2).mean() - 1.065) < 0.18
    assert abs(z.mean()) < 0.15  # chance: 4/√1000; blur moves the edge of the small circle by 1.5 standard deviations
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 0.13  # 4/√1000


def test_points_go_clockwise_about_an_object_at_equal_distances(tmp_path):
    table = of(tmp_path, image(disk(150, 110, 50)))
    angles = np.unwrap(np.arctan2(table["v"] - 110, table["u"] - 150))
    assert (np.diff(angles) > 0).all()  # y down: clockwise as seen
    assert angles[0] == pytest.approx(-np.pi / 2, abs=0.1)  # from the top
    assert np.diff(angles) * 50 == pytest.approx(2 * np.pi * 50 / len(angles), abs=0.5)
    assert table["n"].tolist() == list(range(1, 1 + len(angles)))
    assert set(table["photo"]) == {"part"}


@pytest.mark.parametrize("every", [2.0, 4.0, 10.0])
def test_every_says_how_far_points_are_apart(every, tmp_path):
    table = of(tmp_path, image(disk(150, 110, 50)), every=every)
    # Measured along the pixels of the object, whose middles are half a pixel inside of its edge.
    assert len(table["n"]) == pytest.approx(2 * np.pi * 50 / every, rel=0.02, abs=1)


def test_corners_are_left_out_and_straight_edges_measured(tmp_path):
    """An oblong turned by 20°: each point lies on one of four lines; the numbers of those at corners are missing."""
    c, s = np.cos(0.35), np.sin(0.35)
    corners = [(160 + c * x - s * y, 120 + s * x + c * y) for x, y in ((-70, -40), (70, -40), (70, 40), (-70, 40))]
    table = of(tmp_path, image(polygon(*corners)))
    x, y = c * (table["u"] - 160) + s * (table["v"] - 120), c * (table["v"] - 120) - s * (table["u"] - 160)
    away = np.stack([np.abs(x) - 70, np.abs(y) - 40])
    nearest = np.take_along_axis(away, np.abs(away).argmin(axis=0)[None], axis=0)[0]
    z = nearest / table["sigma"]
    assert np.abs(z).max() < 5  # of a hundred points, some with few degrees of freedom
    assert abs((z**2).mean() - 1.065) < 4 * np.sqrt(2 / len(z))
    assert table["n"].max() > len(z)  # numbers are missing
    assert len(z) > 0.85 * 440 / 4
    distance = np.hypot(table["u"][:, None] - [p for p, _ in corners], table["v"][:, None] - [q for _, q in corners])
    assert distance.min() > 1  # the blur rounds off a corner; no point stands on the rounding


@pytest.mark.parametrize("noise", [2.0, 4.0, 8.0])
def test_points_on_blunt_corners_are_as_uncertain_as_these_make_them(noise, tmp_path):
    """Nine corners of 40°, which a strip may take for a bend: there an edge is up to 0.35 px from where it seems."""
    random = np.random.default_rng(5)
    beside, away = [], []
    for seed in range(6):
        around = random.uniform(0, 2 * np.pi) + np.arange(9) * 2 * np.pi / 9
        centre = np.array([160, 120]) + random.uniform(-2, 2, 2)
        corners = centre + 90 * np.stack([np.cos(around), np.sin(around)], axis=1)
        table = of(tmp_path, image(polygon(*map(tuple, corners))), seed=seed, noise=noise)
        points = np.column_stack([table["u"], table["v"]]) - centre
        normals = np.stack([np.cos(around + np.pi / 9), np.sin(around + np.pi / 9)], axis=1)
        z = ((points @ normals.T).max(axis=1) - 90 * np.cos(np.pi / 9)) / table["sigma"]
        near = np.linalg.norm(points[:, None] + centre - corners, axis=2).min(axis=1) < 2.0
        beside.extend(z[near])
        away.extend(z[~near])
    assert len(beside) > 30
    assert np.mean(np.square(beside)) < 1.5  # what is stated is the most that a corner does
    assert np.abs(beside).max() < 5
    assert abs(np.mean(np.square(away)) - 1.065) < 4 * np.sqrt(2 / len(away))


def test_the_ends_of_a_thin_ellipse_are_measured(tmp_path):
    """Where an edge turns within two points, its bend is not that of its neighbours': strips have to tell it."""
    long, thin, turn = 70.0, 22.0, 0.4
    c, s = np.cos(turn), np.sin(turn)
    x, y = c * (U - 160) + s * (V - 120), c * (V - 120) - s * (U - 160)
    q, w = (x / long) ** 2 + (y / thin) ** 2, np.hypot(x / long**2, y / thin**2)
    away = np.sqrt(q) * (1 - np.sqrt(q)) / np.maximum(w, 1e-9)  # its square is 1e-3 px at a small pixel from the edge
    picture = image(np.clip(away * SAMPLES + 0.5, 0, 1))
    around = np.linspace(0, 2 * np.pi, 20_001)
    ends, sides = [], []
    for seed in range(5):
        table = of(tmp_path, picture, seed=seed)
        p, q = table["u"] - 160, table["v"] - 120
        x, y = c * p + s * q, c * q - s * p
        squares = (x[:, None] - long * np.cos(around)) ** 2 + (y[:, None] - thin * np.sin(around)) ** 2
        outside = (x / long) ** 2 + (y / thin) ** 2 > 1
        z = np.sqrt(squares.min(axis=1)) * np.where(outside, 1, -1) / table["sigma"]
        ends.extend(z[np.abs(x) > 0.85 * long])
        sides.extend(z[np.abs(x) <= 0.85 * long])
    for z, least in ((np.array(ends), 60), (np.array(sides), 180)):
        assert len(z) > least
        assert abs((z**2).mean() - 1.065) < 4 * np.sqrt(2 / len(z))
        assert abs(z.mean()) < 4 / np.sqrt(len(z))


def test_edges_between_near_corners_are_straight(tmp_path):
    """A hole of 14 × 50 px: beside the corners neighbours tell a bend that the edges do not have."""
    c, s = np.cos(0.35), np.sin(0.35)
    hole = [(160 + c * x - s * y, 120 + s * x + c * y) for x, y in ((-25, -7), (25, -7), (25, 7), (-25, 7))]
    picture = image(disk(160, 120, 80) - polygon(*hole))
    found = []
    for seed in range(5):
        table = of(tmp_path, picture, seed=seed)
        p, q = (table[name][table["contour"] == 2] - middle for name, middle in (("u", 160), ("v", 120)))
        beyond = np.abs([c * p + s * q, c * q - s * p]) - np.array([[25], [7]])
        side, other = beyond.max(axis=0), beyond.min(axis=0)
        found.extend((side / table["sigma"][table["contour"] == 2])[(other < -3.5) & (other > -12)])
    z = np.array(found)
    assert len(z) > 50
    assert abs((z**2).mean() - 1.065) < 4 * np.sqrt(2 / len(z))


def test_holes_are_contours_of_their_own(tmp_path):
    ring = disk(160, 120, 80) - disk(165, 118, 40)
    table = of(tmp_path, image(ring, inside=DARK, outside=BRIGHT))
    assert set(table["contour"]) == {1, 2}
    inner = table["contour"] == 2
    assert np.hypot(table["u"] - 165, table["v"] - 118)[inner] == pytest.approx(40, abs=0.15)
    assert np.hypot(table["u"] - 160, table["v"] - 120)[~inner] == pytest.approx(80, abs=0.15)
    angles = np.unwrap(np.arctan2(table["v"] - 118, table["u"] - 165)[inner])
    assert (np.diff(angles) < 0).all()  # the object is on the right, here as outside
    assert (np.diff(table["n"]) > 0).all()
    whole = of(tmp_path, image(ring, inside=DARK, outside=BRIGHT), holes="false")
    assert set(whole["contour"]) == {1}
    assert len(whole["n"]) == (~inner).sum()


def test_both_sides_of_a_thin_hole_are_told_apart(tmp_path):
    """Strips of the usual reach show both sides of a slot of 4 px: the outside tells that they do not fit."""
    slot = polygon((100, 118), (220, 118), (220, 122), (100, 122))
    table = of(tmp_path, image(disk(160, 120, 80) - slot))
    inner = (table["contour"] == 2) & (np.abs(table["u"] - 160) < 54)
    assert inner.sum() > 0.9 * 2 * 108 / 4
    assert np.abs(np.abs(table["v"][inner] - 120) - 2).max() < 0.1  # σ are about 0.02


@pytest.mark.parametrize("side", [None, "bright"])
def test_an_object_is_seen_by_its_difference_to_a_background(side, tmp_path):
    """The scene has stripes as bright as the object, which no threshold parts from it."""
    scene = np.where(np.arange(HEIGHT)[:, None] // 20 % 2 == 0, 60.0, 150.0) * np.ones(WIDTH)
    random = np.random.default_rng(2)
    part = exposed(disk(170, 130, 55), SAMPLES, BLUR)
    save(tmp_path / "empty.png", noisy(scene, random, 2))
    save(tmp_path / "part.png", noisy(scene + part * (210 - scene), random, 2))
    more = {"background": (tmp_path / "empty.png").as_posix(), **({} if side is None else {"object": side})}
    table = read(tmp_path / "part.png", **more)
    away = np.hypot(table["u"] - 170, table["v"] - 130) - 55
    between = np.abs((table["v"] + 10.5) % 20 - 10) > 7  # the border of a stripe beside an edge looks like the edge
    z = away[between] / table["sigma"][between]
    assert abs((z**2).mean() - 1.065) < 4 * np.sqrt(2 / len(z))
    assert np.abs(away).max() < 0.6
    assert len(away) > 0.7 * 2 * np.pi * 55 / 4  # strips over the border of a stripe show something else


def test_the_side_and_the_threshold_may_be_said(tmp_path):
    """A dark disk with a bright one on it: the bright one is meant, or all that is darker than a value."""
    both = exposed(150 - 90 * disk(160, 120, 80) + 170 * disk(160, 120, 30), SAMPLES, BLUR)
    bright = of(tmp_path, both, threshold=190.0, object="bright")
    assert np.hypot(bright["u"] - 160, bright["v"] - 120) == pytest.approx(30, abs=0.2)
    dark = of(tmp_path, both, threshold=100.0, object="dark")
    assert np.hypot(dark["u"] - 160, dark["v"] - 120)[dark["contour"] == 1] == pytest.approx(80, abs=0.2)


def test_a_large_image_is_searched_small_and_measured_large(tmp_path):
    """4,000 × 3,000 pixels are halved twice to look for the object."""
    v, u = np.mgrid[:3000, :4000].astype(np.float32)
    part = 0.5 - 0.5 * np.tanh((np.hypot(u - 2101.3, v - 1480.6) - 900.25) / 1.2)  # an edge even about its middle
    table = of(tmp_path, 60 + 120 * part)
    away = np.hypot(table["u"] - 2101.3, table["v"] - 1480.6) - 900.25
    assert np.abs(away / table["sigma"]).max() < 6
    assert len(away) == round(2 * np.pi * 900.25 / 4)


def test_a_circle_is_fitted_to_an_outline(tmp_path):
    centre = (158.3, 121.7)
    save(tmp_path / "part.png", noisy(image(disk(*centre, 60)), np.random.default_rng(1), 3))
    save(tmp_path / "blank.png", noisy(np.full((HEIGHT, WIDTH), 90.0), np.random.default_rng(1), 3))
    text = """(problem p (data edge (contour "*.png")) (unknowns (c (vector 2) :init [150 110]) (r :init 50))
      (observe edge (- (distance [u v] c) r) :sigma sigma))"""
    solved = mbm.loads(text, base=tmp_path).solve()
    truth = {"c": centre, "r": 60.0}
    for name, value in truth.items():
        assert (np.abs(solved[name].value - value) < 4 * solved[name].sigma).all()
    document = solved.document()
    (warning,) = document["diagnostics"]
    assert warning["code"] == "object-left-out"
    assert "in 1 of 2 images, which give no rows: blank (nothing of 30 pixels or more stands out)" in warning["message"]
    rows = {entry["path"].rpartition("/")[2]: entry["rows"] for entry in document["inputs"]}
    assert rows == {"blank.png": 0, "part.png": solved.first.dof + 3}


def test_the_background_is_an_input_with_its_digest(tmp_path):
    save(tmp_path / "empty.png", np.full((HEIGHT, WIDTH), 60, np.uint8))
    save(tmp_path / "part.png", np.rint(image(disk(160, 120, 50))).astype(np.uint8))
    text = """(problem p (data edge (contour "part.png" :background "empty.png"))
      (unknowns (a)) (observe edge (= u a) :sigma unknown))"""
    inputs = mbm.loads(text, base=tmp_path).solve().document()["inputs"]
    digests = {entry["path"].rpartition("/")[2]: entry["sha256"] for entry in inputs}
    assert digests == {n: hashlib.sha256((tmp_path / n).read_bytes()).hexdigest() for n in ("part.png", "empty.png")}


def test_pixels_of_an_image_are_a_table(tmp_path):
    save(tmp_path / "a.png", np.array([[1, 2, 3], [4, 5, 250]], np.uint8))
    save(tmp_path / "b.pgm", np.array([[9]], np.uint8))
    found = READERS["image"].read({"a": tmp_path / "a.png", "b": tmp_path / "b.pgm"}, "*", {})
    columns = {column.name: column.numbers if column.texts is None else column.texts for column in found.columns}
    assert columns["photo"] == (*"aaaaaa", "b")
    assert columns["shot"] == (*["a.png"] * 6, "b.pgm")  # of the pattern `*`
    assert columns["u"].tolist() == [0, 1, 2, 0, 1, 2, 0]
    assert columns["v"].tolist() == [0, 0, 0, 1, 1, 1, 0]
    assert columns["grey"].tolist() == [1, 2, 3, 4, 5, 250, 9]


def test_a_spot_is_fitted_to_pixels(tmp_path):
    v, u = np.mgrid[:20, :24].astype(float)
    spot = 20 + 150 * np.exp(-((u - 11.3) ** 2 + (v - 9.6) ** 2) / (2 * 2.2**2))
    save(tmp_path / "spot.png", noisy(spot, np.random.default_rng(4), 2))
    text = """(problem p (data pixel (image "spot.png"))
      (unknowns (c (vector 2) :init [12 9]) (s :init 3) (a :init 100) (b :init 0))
      (observe pixel (= grey (+ b (* a (exp (/ (- (+ (^ (- u (c 1)) 2) (^ (- v (c 2)) 2))) (* 2 s s)))))) :sigma 2))"""
    solved = mbm.loads(text, base=tmp_path).solve()
    for name, value in {"c": (11.3, 9.6), "s": 2.2, "a": 150, "b": 20}.items():
        assert (np.abs(solved[name].value - value) < 4 * solved[name].sigma).all(), name
    # 480 pixels; rounding to whole values adds 1/12 to the variance 4.
    assert abs(solved.first.cost / solved.first.dof - 1.02) < 4 * np.sqrt(2 / 475)
