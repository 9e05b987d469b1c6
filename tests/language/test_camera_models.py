"""Cameras of every model in one problem, against forward models by OpenCV and by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.text.types import MbmError

cv2 = pytest.importorskip("cv2")

FOCAL, CENTER = (400.0, 420.0), (310.0, 250.0)
DISTORTION = {"pinhole": (-0.15, 0.04, 1e-3, -2e-3, 0.01), "fisheye": (0.02, -0.01, 3e-3, -1e-3)}
SCALES = {"weak-perspective": (90.0, 95.0), "orthographic": (60.0, 60.0)}
MODELS = (*DISTORTION, *SCALES)

TEXT = """
(problem everything
  (data cams external :key name)
  (data marks external :key mark)
  (data seen external :with (marks mark))
  (camera cam :per cams :model kind :focal (f name) :center (c name)
    :distortion (if (= kind "fisheye") [((d name) 1) ((d name) 2) ((d name) 3) ((d name) 4)] (d name)))
  (unknowns
    (T (pose 3) :per cams :init (pose3 (quaternion qw qx qy qz) [tx ty tz]) :fixed {placed})
    (f (vector 2) :per cams :init [fx fy] :fixed {calibrated})
    (c (vector 2) :per cams :init [cx cy] :fixed {calibrated})
    (d (vector 5) :per cams :init [d1 d2 d3 d4 d5]
       :fixed [{bent} {bent} {bent} {bent} (or {bent} (= kind "fisheye"))]))
  (observe seen (= [u v] (project (cam camera) (transform (T camera) [marks.x marks.y marks.z]))) :sigma 0.1px))
"""
BENT = '(or (= kind "orthographic") (= kind "weak-perspective"))'


def projected(model: str, points: np.ndarray) -> np.ndarray:
    """[u v] (n, 2) of points in the frame of the camera: z forward, x right, y down."""
    matrix = np.array([[FOCAL[0], 0, CENTER[0]], [0, FOCAL[1], CENTER[1]], [0, 0, 1]])
    if model == "pinhole":
        return cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(DISTORTION[model]))[0][:, 0]
    if model == "fisheye":
        zero = np.zeros((3, 1))
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, matrix, np.array(DISTORTION[model]))[0][:, 0]
    return points[:, :2] * SCALES[model] + CENTER


def world() -> tuple[np.ndarray, dict, dict[str, tuple[np.ndarray, np.ndarray]]]:
    generator = np.random.default_rng(11)
    points = generator.uniform([-1, -1, 2.5], [1, 1, 4], size=(20, 3))
    seen: dict[str, list] = {"camera": [], "mark": [], "u": [], "v": []}
    poses = {}
    for model in MODELS:
        rvec, tvec = generator.normal(scale=0.1, size=3), generator.normal(scale=0.1, size=3)
        if model in SCALES:
            tvec[2] = 0.0  # such cameras do not see how far away things are
        poses[model] = rvec, tvec
        moved = points @ cv2.Rodrigues(rvec)[0].T + tvec
        for mark, (u, v) in enumerate(projected(model, moved)):
            for name, value in zip(seen, (model, float(mark), u, v), strict=True):
                seen[name].append(value)
    return points, seen, poses


def tables(points, seen, poses, *, off: float, turned: float, models=MODELS):
    """Starts: intrinsics ``off`` from the truth by a fraction, poses ``turned``."""
    rows = []
    for model in models:
        rvec, tvec = poses[model]
        angle = np.linalg.norm(rvec + turned)
        q = [np.cos(angle / 2), *(np.sin(angle / 2) * (rvec + turned) / angle)]
        focal = np.array(SCALES.get(model, FOCAL)) * (1 + off)
        bend = np.zeros(5)
        if not off and model in DISTORTION:
            bend[: len(DISTORTION[model])] = DISTORTION[model]
        rows.append([*q, *(tvec + turned * (model not in SCALES)), *focal, *(np.array(CENTER) * (1 - off)), *bend])
    names = ["qw", "qx", "qy", "qz", "tx", "ty", "tz", "fx", "fy", "cx", "cy", "d1", "d2", "d3", "d4", "d5"]
    kept = [i for i, camera in enumerate(seen["camera"]) if camera in models]
    return {
        "cams": {"name": [f"cam {m}" for m in models], "kind": list(models)}
        | dict(zip(names, np.array(rows).T, strict=True)),
        "marks": {"mark": np.arange(20.0), **dict(zip("xyz", points.T, strict=True))},
        "seen": {name: [column[i] for i in kept] for name, column in seen.items()}
        | {"camera": [f"cam {seen['camera'][i]}" for i in kept]},
    }


def test_intrinsics_and_distortion_of_every_model_are_found() -> None:
    """Without noise all numbers come out; 1e-6 of the focal length is 1e-3 of the stated noise."""
    made = world()
    text = TEXT.format(placed="true", calibrated="false", bent=BENT)
    solved = mbm.loads(text).solve(data=tables(*made, off=0.03, turned=0.0))
    assert solved.status == "ok"
    assert solved.first.cost < 1e-10
    for row, model in enumerate(MODELS):
        np.testing.assert_allclose(solved["f"].value[row], SCALES.get(model, FOCAL), rtol=1e-6)
        np.testing.assert_allclose(solved["c"].value[row], CENTER, rtol=1e-6)
        bend = DISTORTION.get(model, ())
        np.testing.assert_allclose(solved["d"].value[row][: len(bend)], bend, rtol=0, atol=1e-5)


@pytest.mark.parametrize("known", [True, False])
def test_poses_are_found_where_the_cameras_are_known_and_where_they_are_not(known: bool) -> None:
    made = world()
    both = tuple(DISTORTION)
    word = "true" if known else "false"
    text = TEXT.format(placed="false", calibrated=word, bent="true" if known else BENT)
    solved = mbm.loads(text).solve(data=tables(*made, off=0.0 if known else 0.02, turned=0.02, models=both))
    assert solved.status == "ok"
    assert solved.first.cost < 1e-8
    for row, model in enumerate(both):
        rvec, tvec = made[2][model]
        value = solved["T"].value[row]
        turned = 2 * np.arctan2(np.linalg.norm(value[1:4]), value[0]) * value[1:4] / np.linalg.norm(value[1:4])
        np.testing.assert_allclose(turned, rvec, rtol=0, atol=1e-6)
        np.testing.assert_allclose(value[4:], tvec, rtol=0, atol=1e-6)


def test_the_paper_has_other_axes() -> None:
    """x forward, y left, z up: image axes to the left and upwards, u = f y/x."""
    points = np.random.default_rng(2).uniform([2, -1, -1], [4, 1, 1], size=(10, 3))
    u, v = 300 * points[:, 1] / points[:, 0] + 7, 310 * points[:, 2] / points[:, 0] - 3
    text = """
    (problem paper (data d external) (camera cam :axes paper :focal f :center c)
      (unknowns (f (vector 2) :init [200 200]) (c (vector 2) :init [0 0]))
      (observe d (= [u v] (project cam [x y z])) :sigma 1))"""
    solved = mbm.loads(text).solve(data={"d": dict(zip(("x", "y", "z", "u", "v"), (*points.T, u, v), strict=True))})
    np.testing.assert_allclose(solved["f"].value, [300, 310], rtol=1e-9)
    np.testing.assert_allclose(solved["c"].value, [7, -3], rtol=1e-9)


def test_a_model_that_there_is_not_is_named() -> None:
    made = world()
    data = tables(*made, off=0.0, turned=0.0)
    text = TEXT.format(placed="true", calibrated="false", bent=BENT)
    data["cams"]["kind"][1] = "fisheyes"
    with pytest.raises(MbmError, match="`fisheyes` is no camera model"):
        mbm.loads(text).solve(data=data)
    with pytest.raises(MbmError, match="the model of a camera"):
        mbm.loads(text.replace(":model kind", ":model fx")).solve(data=data)


@pytest.mark.parametrize(
    "model",
    [
        '(if (= name "a") pinhole orthographic)',
        '(if (= name "a") "pinhole" "orthographic")',
        '(cond ((= name "b") orthographic) (else pinhole))',
        "kind",
    ],
)
def test_a_member_is_given_its_model_by_a_form(model: str) -> None:
    """By a pinhole camera u = f x/z, by an orthographic one u = f x; words mean models beside columns and unknowns."""
    text = f"""
    (problem models
      (data cams (table (name kind) (a pinhole) (b orthographic)) :key name)
      (data d (table (camera x y u v) (a 1 0 50 0) (a 0 1 0 50) (b 1 0 100 0) (b 0 1 0 100)))
      (camera cam :per cams :model {model} :focal f)
      (unknowns (f :init 90))
      (observe d (= [u v] (project (cam camera) [x y 2])) :sigma 1))"""
    solved = mbm.loads(text).solve()
    assert solved["f"].value == pytest.approx(100.0)
    assert solved.first.cost < 1e-12


@pytest.mark.parametrize("model", ["orthographic", '"orthographic"'])
@pytest.mark.parametrize("per", ["", ":per cams"])
def test_the_word_for_a_model_may_be_a_text(model: str, per: str) -> None:
    text = f"""
    (problem models (data cams (table (name) (a)) :key name) (data d (table (x y u v) (1 0 100 0) (0 1 0 100)))
      (camera cam {per} :model {model} :focal f MORE) (unknowns (f :init 90))
      (observe d (= [u v] (project {'(cam "a")' if per else "cam"} [x y 2])) :sigma 1))"""
    assert mbm.loads(text.replace("MORE", "")).solve()["f"].value == pytest.approx(100.0)
    with pytest.raises(MbmError, match="orthographic camera has no distortion"):
        mbm.loads(text.replace("MORE", ":distortion (0.1)")).solve()
    with pytest.raises(MbmError, match="`ortographic` is no camera model"):
        mbm.loads(text.replace("MORE", "").replace(model, '"ortographic"')).solve()


def test_a_misspelt_model_in_a_form_is_named() -> None:
    text = """
    (problem models (data cams (table (name) (a)) :key name) (data d (table (camera x u) (a 1 2)))
      (camera cam :per cams :model (if (= name "a") pinhoel fisheye) :focal f) (unknowns (f :init 90))
      (observe d (= [u u] (project (cam camera) [x x 2])) :sigma 1))"""
    with pytest.raises(MbmError, match="`pinhoel` is not a variable") as caught:
        mbm.loads(text).solve()
    assert "`pinhole`" in caught.value.diagnostics[0].hint


def test_other_models_in_the_same_columns_are_compiled_anew(tmp_path, monkeypatch) -> None:
    """What is kept of a problem holds for the models that it was compiled for."""
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "cache"))
    text = """
    (problem models
      (data cams external :key name) (data d external)
      (camera cam :per cams :model kind :focal f)
      (unknowns (f :init 90))
      (observe d (= [u v] (project (cam camera) [x y 2])) :sigma 1))"""
    data = {"camera": ["a", "a"], "x": [1.0, 0.5], "y": [0.0, 1.0], "u": [50.0, 25], "v": [0.0, 50]}
    for kind, focal in (("pinhole", 100.0), ("orthographic", 50.0), ("pinhole", 100.0)):
        solved = mbm.loads(text).solve(data={"cams": {"name": ["a"], "kind": [kind]}, "d": data})
        assert solved["f"].value == pytest.approx(focal)
