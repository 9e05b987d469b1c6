"""Rigs, stereo, hand and eye without starts, on corners that an independent simulator photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.api.files import check, explain
from mbm.estimation.search import leading
from tests.estimation.closed_forms.rigs import (
    Camera,
    Corners,
    Floats,
    Motion,
    board,
    composed,
    held,
    inverted,
    keyed,
    numbers,
    photographed,
    turn,
)

EXACT = 1e-6
"""Without noise the truth comes back, but for what the stopping rule leaves."""

LEFT, RIGHT = Camera(), Camera(focal=(700.0, 705.0), centre=(310.0, 250.0))
SIDE: Motion = (turn([0.02, 0.15, 0.01]), np.array([-0.12, 0.003, 0.01]))
NONE: Motion = (np.eye(3), np.zeros(3))

STEREO = """(problem stereo (data photos external :key photo) (data left external) (data right external)
  (camera l :focal (fx fy) :center (cx cy)) (camera r :focal (gx gy) :center (dx dy))
  (unknowns (fx) (fy) (cx) (cy) (gx) (gy) (dx) (dy) (B (pose 3)) (T (pose 3) :per photos))
  (observe left (= [u v] (project l (transform {left} [x y z]))) :sigma 0.2)
  (observe right (= [u v] (project r (transform {right} [x y z]))) :sigma 0.2) {more})"""

RIG = """(problem rig (data photos external :key photo) (data cams external :key cam) (data d external)
  (camera c :per cams :focal ((fx cam) (fy cam)) :center ((cx cam) (cy cam)))
  (unknowns (fx :per cams) (fy :per cams) (cx :per cams) (cy :per cams)
    (B (pose 3) :per cams) (T (pose 3) :per photos))
  (observe first d (= [u v] (project (c cam) (transform (T photo) [x y z]))) :sigma 0.2 :when (= cam 0))
  (observe others d (= [u v] (project (c cam) (transform (compose (B cam) (T photo)) [x y z]))) :sigma 0.2
    :when (> cam 0)))"""

ONE_CLAUSE = """(problem rig (data photos external :key photo) (data cams external :key cam) (data d external)
  (camera c :per cams :focal ((fx cam) (fy cam)) :center ((cx cam) (cy cam)))
  (unknowns (fx :per cams) (fy :per cams) (cx :per cams) (cy :per cams)
    (B (pose 3) :per cams :fixed (= cam 0) {at}) (T (pose 3) :per photos))
  (observe d (= [u v] (project (c cam) (transform (compose (B cam) (T photo)) [x y z]))) :sigma 0.2))"""

POSE = "(pose3 (quaternion {0}w {0}i {0}j {0}k) [{0}x {0}y {0}z])"


def stereo_data(noise: float, count: int = 6) -> dict[str, dict[str, Floats]]:
    generator = np.random.default_rng(1)
    seen = {0: range(count), 1: range(count)}
    left, right = photographed([LEFT, RIGHT], [NONE, SIDE], held(generator, count), seen, noise, generator)
    return {"photos": keyed("photo", count), "left": left.columns(), "right": right.columns()}


def together(tables: list[Corners]) -> dict[str, Floats]:
    """The tables of several cameras as one, with the column `cam`."""
    columns = [table.columns() | {"cam": np.full(len(table.rows), float(k))} for k, table in enumerate(tables)]
    return {name: np.concatenate([each[name] for each in columns]) for name in columns[0]}


def value(solved: mbm.Solved, name: str) -> Floats:
    return np.asarray(solved[name].value)


@pytest.mark.parametrize(
    ("left", "right", "inverse"),
    [
        ("(T photo)", "(compose B (T photo))", False),
        ("(inverse (T photo))", "(inverse (compose (T photo) B))", True),
        ("(T photo)", "(between (inverse B) (T photo))", False),
    ],
)
def test_stereo_in_any_order(left: str, right: str, inverse: bool) -> None:
    text = STEREO.format(left=left, right=right, more="")
    found = mbm.loads(text).solve(data=stereo_data(0.0))
    np.testing.assert_allclose(value(found, "B"), numbers(inverted(SIDE) if inverse else SIDE), atol=EXACT)
    got = [float(value(found, name)) for name in ("fx", "fy", "cx", "cy", "gx", "gy", "dx", "dy")]
    np.testing.assert_allclose(got, [*LEFT.focal, *LEFT.centre, *RIGHT.focal, *RIGHT.centre], rtol=EXACT)


def test_a_board_whose_corners_were_measured_somewhere_in_space() -> None:
    """To a tenth of a millimetre: no plane holds them exactly, and no start needs more."""
    data = stereo_data(0.2)
    for table in (data["left"], data["right"]):
        corners = np.stack([table[axis] for axis in "xyz"], axis=1) @ turn([0.7, -0.4, 0.3]).T + [3.0, -1.0, 2.0]
        table |= dict(zip("xyz", np.round(corners, 4).T, strict=True))
    found = mbm.loads(STEREO.format(left="(T photo)", right="(compose B (T photo))", more="")).solve(data=data)
    assert found.status == "ok"
    sigmas = np.asarray(found["B"].sigma)[-3:]
    np.testing.assert_allclose(value(found, "B")[-3:], SIDE[1], atol=5 * float(sigmas.max()))


def test_three_noisy_photographs_are_enough() -> None:
    """The cost is that of the right minimum: within five deviations of a χ² with as many degrees of freedom."""
    text = STEREO.format(left="(T photo)", right="(compose B (T photo))", more="")
    found = mbm.loads(text).solve(data=stereo_data(0.2, count=3))
    dof = 2 * 2 * 3 * len(board()) - 8 - 6 * 4
    assert found.first.dof == dof
    assert abs(found.first.cost - dof) < 5 * np.sqrt(2 * dof)


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_a_tenth_of_wrong_corners_beside_a_robust_solve(seed: int) -> None:
    """What the starts agree with counts beside what graduated fits to all corners lead to, which end anywhere."""
    data = stereo_data(0.2)
    generator = np.random.default_rng(seed)
    for table in ("left", "right"):
        wrong = generator.random(len(data[table]["u"])) < 0.1
        data[table]["u"] = data[table]["u"] + wrong * generator.uniform(20, 100, size=len(wrong))
    text = STEREO.format(left="(T photo)", right="(compose B (T photo))", more="(solve :robust (gnc))")
    found = mbm.loads(text).solve(data=data)
    # a thousandth of the rig's size, several times what 0.2 px leave of it
    np.testing.assert_allclose(value(found, "B"), numbers(SIDE), atol=5e-3)


def test_a_rig_in_which_no_photograph_sees_all_cameras() -> None:
    """Cameras 2 and 3 share photographs with the one before only: poses go from camera to camera."""
    cameras = [Camera(focal=(800.0 - 50 * k, 790.0 - 40 * k), centre=(320.0 + 5 * k, 240.0)) for k in range(4)]
    rig = [(turn([0.01 * k, 0.12 * k, 0.02 * k]), np.array([-0.1 * k, 0.01 * k, 0.02 * k])) for k in range(4)]
    generator = np.random.default_rng(2)
    seen = {0: range(6), 1: range(3, 9), 2: range(6, 12), 3: range(9, 14)}
    tables = photographed(cameras, rig, held(generator, 14), seen, 0.0, generator)
    data = {"photos": keyed("photo", 14), "cams": keyed("cam", 4), "d": together(tables)}
    found = mbm.loads(RIG).solve(data=data)
    np.testing.assert_allclose(value(found, "fx"), [camera.focal[0] for camera in cameras], rtol=EXACT)
    np.testing.assert_allclose(value(found, "B")[1:], [numbers(motion) for motion in rig[1:]], atol=EXACT)


def test_cameras_that_are_placed_one_from_another() -> None:
    """Each is seen from the one before: products of one to four unknown poses, and no photograph by all cameras."""
    cameras = [Camera(focal=(800.0 - 50 * k, 790.0 - 40 * k), centre=(320.0 + 5 * k, 240.0)) for k in range(4)]
    steps = [(turn([0.01 * k, 0.12, 0.02]), np.array([-0.1, 0.01 * k, 0.02])) for k in range(1, 4)]
    rig = [composed(*reversed(steps[:k])) for k in range(4)]
    generator = np.random.default_rng(2)
    seen = {0: range(5), 1: range(3, 8), 2: range(6, 11), 3: range(8, 12)}
    tables = photographed(cameras, rig, held(generator, 12), seen, 0.0, generator)
    way = [" ".join(f"B{j}" for j in range(k, 0, -1)) for k in range(4)]
    clauses = "".join(
        f"""(data d{k} external) (camera c{k} :focal (f{k} g{k}) :center (a{k} b{k}))
        (observe d{k} (= [u v] (project c{k} (transform (compose {way[k]} (T photo)) [x y z]))) :sigma 0.2)"""
        for k in range(4)
    )
    flat = " ".join(f"({letter}{k})" for k in range(4) for letter in "fgab")
    text = f"""(problem rig (data photos external :key photo) {clauses}
      (unknowns {flat} (B1 (pose 3)) (B2 (pose 3)) (B3 (pose 3)) (T (pose 3) :per photos)))"""
    data = {"photos": keyed("photo", 12)} | {f"d{k}": table.columns() for k, table in enumerate(tables)}
    found = mbm.loads(text).solve(data=data)
    for k, step in enumerate(steps):
        np.testing.assert_allclose(value(found, f"B{k + 1}"), numbers(step), atol=EXACT)


@pytest.mark.parametrize("place", [NONE, (turn([0.1, -0.3, 0.2]), np.array([0.4, -0.2, 0.1]))])
def test_a_rig_with_one_camera_held(place: Motion) -> None:
    """One clause serves all cameras; that of camera 0 is held at the identity, or where it is said to be."""
    cameras = [Camera(focal=(800.0 - 50 * k, 790.0 - 40 * k), centre=(320.0 + 5 * k, 240.0)) for k in range(3)]
    rig = [(turn([0.01 * k, 0.12 * k, 0.02 * k]), np.array([-0.1 * k, 0.01 * k, 0.02 * k])) for k in range(3)]
    generator = np.random.default_rng(3)
    tables = photographed(cameras, rig, held(generator, 6), {k: range(6) for k in range(3)}, 0.0, generator)
    data = {"photos": keyed("photo", 6), "cams": keyed("cam", 3), "d": together(tables)}
    w, i, j, k, *shift = numbers(place)
    at = "" if place is NONE else f":at (pose3 (quaternion {w} {i} {j} {k}) [{' '.join(map(str, shift))}])"
    found = mbm.loads(ONE_CLAUSE.format(at=at)).solve(data=data)
    np.testing.assert_allclose(value(found, "fx"), [camera.focal[0] for camera in cameras], rtol=EXACT)
    wanted = [numbers(composed(motion, place)) for motion in rig]
    np.testing.assert_allclose(value(found, "B"), wanted, atol=EXACT)


def named(prefix: str, motion: Motion) -> dict[str, float]:
    return dict(zip([prefix + letter for letter in "wijkxyz"], numbers(motion), strict=True))


def test_a_camera_on_a_hand_before_a_board_somewhere() -> None:
    """``X A⁻¹ W``: the camera, where it sits on the hand and where the board lies, from known poses of the hand."""
    X, W = (turn([0.1, -0.2, 1.5]), np.array([0.03, -0.05, 0.06])), (turn([0.3, 0.1, -0.4]), np.array([0.5, 0.1, 0.05]))
    views = held(np.random.default_rng(4), 8)
    hands = [named("a", composed(W, inverted(seen), X)) for seen in views]
    corners = Corners(keys=tuple(hands[0]))
    for hand, (R, t) in zip(hands, views, strict=True):
        corners.add(list(hand.values()), board(), LEFT.seen(board() @ R.T + t))
    # the hand's columns are called as those of the corners are not
    columns = dict(zip((*hands[0], "px", "py", "pz", "u", "v"), np.array(corners.rows).T, strict=True))
    text = f"""(problem h (data d external) (camera c :focal (fx fy) :center (cx cy))
      (unknowns (fx) (fy) (cx) (cy) (X (pose 3)) (W (pose 3)))
      (observe d (= [u v] (project c (transform (compose X (inverse {POSE.format("a")}) W) [px py pz]))) :sigma 0.2))"""
    found = mbm.loads(text).solve(data={"d": columns})
    np.testing.assert_allclose(value(found, "X"), numbers(X), atol=EXACT)
    np.testing.assert_allclose(value(found, "W"), numbers(W), atol=EXACT)
    assert float(value(found, "fx")) == pytest.approx(LEFT.focal[0], rel=EXACT)


@pytest.mark.parametrize("equation", ["(= (compose A X) (compose Z B))", "(= B (compose (inverse Z) A X))"])
def test_two_chains_of_known_motions(equation: str) -> None:
    generator = np.random.default_rng(6)
    X, Z = (turn([0.4, 2.0, -0.7]), np.array([0.1, -0.05, 0.2])), (turn([0.4, 0.2, 0.7]), np.array([0.4, -0.5, 0.2]))
    rows = []
    for _ in range(8):
        A = (turn(generator.uniform(-1, 1, size=3)), generator.uniform(-0.5, 0.5, size=3))
        rows.append(named("a", A) | named("b", composed(inverted(Z), A, X)))
    text = f"""(problem h (data d external) (define (A {POSE.format("a")}) (B {POSE.format("b")}))
      (unknowns (X (pose 3)) (Z (pose 3))) (observe d {equation} :sigma 0.001) (solve :method hand-eye))"""
    found = mbm.loads(text).solve(data={"d": {name: np.array([row[name] for row in rows]) for name in rows[0]}})
    np.testing.assert_allclose(value(found, "X"), numbers(X), atol=EXACT)
    np.testing.assert_allclose(value(found, "Z"), numbers(Z), atol=EXACT)


AXIS = np.array([0.36, 0.48, 0.8])


@pytest.mark.parametrize("turning", [1.0, 0.0], ids=["turning", "at-rest"])
@pytest.mark.parametrize("ways", [0.0, 1.0], ids=["in-place", "moving"])
def test_known_motions_that_turn_about_one_axis_or_none(turning: float, ways: float) -> None:
    """A turntable, a stage, both: what they leave free makes no difference, any way that fits is a start."""
    generator = np.random.default_rng(7)
    X, Z = (turn([0.4, 2.0, -0.7]), np.array([0.1, -0.05, 0.2])), (turn([0.4, 0.2, 0.7]), np.array([0.4, -0.5, 0.2]))
    rows = []
    for angle in turning * generator.uniform(-3.0, 3.0, size=6):
        A = (turn(angle * AXIS), ways * generator.uniform(-0.5, 0.5, size=3))
        rows.append(named("a", A) | named("b", composed(X, A, Z)))
    text = f"""(problem h (data d external) (unknowns (X (pose 3)) (Z (pose 3)))
      (observe d (= {POSE.format("b")} (compose X {POSE.format("a")} Z)) :sigma 1) (solve :method hand-eye))"""
    data = {"d": {name: np.array([row[name] for row in rows]) for name in rows[0]}}
    if not turning and not ways:  # one pose, six times: nothing tells where it is divided
        with pytest.raises(mbm.MbmError, match="no-closed-form"):
            mbm.loads(text).solve(data=data)
        return
    assert mbm.loads(text).solve(data=data).cost == pytest.approx(0.0, abs=EXACT**2)


def test_what_stays_without_a_start_is_named_with_the_start_that_would_do(tmp_path: Path) -> None:
    """Marks on a line: no closed form gives the camera, and five rotations are too many to guess."""
    marks = "".join(f"({photo} {x} {300 + 20 * x} {200 + 3 * photo})" for photo in range(5) for x in range(6))
    file = tmp_path / "line.mbm"
    file.write_text(f"""(problem line (data d (table (photo x u v) {marks})) (camera c :focal (f f) :center (320 240))
      (unknowns (f) (T (pose 3) :per d.photo))
      (observe d (= [u v] (project c (transform (T photo) [x 0 0])))))""")
    errors = [each for each in check(file) if each.code.name == "missing-start"]
    assert "`T` has no start, and none can be found" in [each.message for each in errors]
    assert "has no start" in explain(file)
    with pytest.raises(mbm.MbmError, match="missing-start"):
        mbm.load(file).solve()


def test_points_of_a_reconstruction_are_taken_for_no_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each point beside its camera's numbers was one; thousands of them took minutes, before any step."""
    from mbm.estimation.starts.closed_forms import planar_calibration

    asked: list[object] = []
    monkeypatch.setattr(planar_calibration, "_seen", lambda *given: asked.append(given))
    generator = np.random.default_rng(5)
    points = generator.uniform(-1.0, 1.0, size=(12, 3))
    rows, poses = [], []
    for k in range(3):
        R, t = turn([0.0, 0.3 * k, 0.1]), np.array([0.1 * k, 0.0, 6.0])
        images = LEFT.seen(points @ R.T + t)
        rows += [(float(k), float(j), *image) for j, image in enumerate(images)]
        poses.append([float(k), *numbers((R, t)), 790.0])
    cameras = dict(zip(("cam", "w", "i", "j", "k", "tx", "ty", "tz", "guess"), np.array(poses).T, strict=True))
    marks = dict(zip(("mark", "px", "py", "pz"), np.column_stack([np.arange(12.0), points + 0.01]).T, strict=True))
    seen = dict(zip(("cam", "mark", "u", "v"), np.array(rows).T, strict=True))
    text = """(problem bundle (data cams external :key cam) (data marks external :key mark) (data seen external)
      (camera c :per cams :focal ((f cam) (f cam)) :center (320 240))
      (unknowns (f :per cams :init guess) (X (vector 3) :per marks :init [px py pz])
        (T (pose 3) :per cams :init (pose3 (quaternion w i j k) [tx ty tz])))
      (observe seen (= [u v] (project (c cam) (transform (T cam) (X mark)))) :sigma 0.2) (solve :gauge free))"""
    mbm.loads(text).solve(data={"cams": cameras, "marks": marks, "seen": seen})
    assert asked == []


@pytest.mark.parametrize(
    "stated",
    ["(fx :init 500) (fy :init 500) (cx) (cy)", "(fx :init 500) (fy) (cx) (cy)", "(fx) (fy) (cx :init 300) (cy)"],
)
def test_starts_of_some_numbers_of_a_camera_do_no_harm(stated: str) -> None:
    """The others follow as they do without these, which lead to the same camera."""
    data = stereo_data(0.0)
    text = f"""(problem one (data photos external :key photo) (data left external)
      (camera c :focal (fx fy) :center (cx cy))
      (unknowns {stated} (T (pose 3) :per photos))
      (observe left (= [u v] (project c (transform (T photo) [x y z]))) :sigma 0.2))"""
    found = mbm.loads(text).solve(data={"photos": data["photos"], "left": data["left"]})
    got = [float(value(found, name)) for name in ("fx", "fy", "cx", "cy")]
    np.testing.assert_allclose(got, [*LEFT.focal, *LEFT.centre], rtol=EXACT)


def test_the_start_that_is_asked_for_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a ratio of focal lengths, in no closed form, all else follows; were it not drawn, it alone is named."""
    monkeypatch.setattr(leading, "MOST_LED", 0)
    data = stereo_data(0.0)
    given = {"photos": data["photos"], "left": data["left"]}
    text = """(problem one (data photos external :key photo) (data left external)
      (camera c :focal (f (* f ratio)) :center (cx cy))
      (unknowns (f) (ratio {start}) (cx) (cy) (T (pose 3) :per photos))
      (observe left (= [u v] (project c (transform (T photo) [x y z]))) :sigma 0.2))"""
    with pytest.raises(mbm.MbmError) as raised:
        mbm.loads(text.format(start="")).solve(data=given)
    assert [each.message for each in raised.value.diagnostics] == ["`ratio` has no start, and none can be found"]
    found = mbm.loads(text.format(start=":init 1")).solve(data=given)
    assert float(value(found, "ratio")) == pytest.approx(LEFT.focal[1] / LEFT.focal[0], rel=EXACT)
