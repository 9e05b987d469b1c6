"""Camera chains of Kalibr, laid out as its documentation shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.data.readers import READERS
from mbm.text.types import MbmError

pytest.importorskip("yaml")

CHAIN = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.5, 457.25, 367.5, 248.25]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.5]
  - [-1.0, 0.0, 0.0, -0.25]
  - [0.0, 0.0, 1.0, 0.125]
  - [0.0, 0.0, 0.0, 1.0]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 0.6, -0.8, 0.01]
  - [0.0, 0.8, 0.6, 0.02]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: omni
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [1.5, 700.0, 701.0, 376.0, 240.0]
  resolution: [752, 480]
"""


def read(tmp_path, text):
    path = tmp_path / "camchain.yaml"
    path.write_text(text)
    return READERS["kalibr"].read(path)


def columns(table):
    return {c.name: list(c.texts) if c.is_text else c.numbers.tolist() for c in table.columns}


def test_cameras_and_transforms(tmp_path):
    found = read(tmp_path, CHAIN)
    cameras = columns(found["cameras"])
    nan = float("nan")
    assert [cameras[name] for name in ("camera", "model", "distortion")] == [
        ["cam0", "cam1"],
        ["pinhole", "omni"],
        ["radtan", "none"],
    ]
    for name, cells in {
        "width": [752, 752], "height": [480, 480], "fx": [458.5, 700], "fy": [457.25, 701], "cx": [367.5, 376],
        "cy": [248.25, 240], "k1": [-0.28, nan], "p2": [1.8e-5, nan], "xi": [nan, 1.5],
    }.items():  # fmt: skip
        np.testing.assert_array_equal(cameras[name], cells, err_msg=name)
    transforms = columns(found["transforms"])
    assert (transforms["from"], transforms["to"]) == (["imu", "cam0"], ["cam0", "cam1"])
    assert (transforms["x"], transforms["y"], transforms["z"]) == ([0.5, -0.11], [-0.25, 0.01], [0.125, 0.02])
    # quarter turn about −z; a turn about x whose cosine is 0.6, half of it has cosine √0.8
    half = np.sqrt(0.5)
    expected = [[half, 0, 0, -half], [np.sqrt(0.8), np.sqrt(0.2), 0, 0]]
    quaternions = np.column_stack([transforms[name] for name in ("qw", "qx", "qy", "qz")])
    np.testing.assert_allclose(quaternions, expected, atol=1e-15)  # a few roundings of numbers of size 1
    assert found["transforms"].file_rows.tolist() == [10, 16]
    assert found["cameras"].key == "camera"


def test_a_problem_uses_the_chain(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text(CHAIN)
    text = """(problem p (data cams (kalibr "c.yaml" :cameras)) (data T (kalibr "c.yaml" :transforms))
      (data seen (table (cam u) (cam0 467.5)) :with (cams cam)) (unknowns (a :init 0))
      (observe seen (= u (+ a cams.cx)) :sigma 1))"""
    assert float(mbm.loads(text, base=Path()).solve()["a"].value) == pytest.approx(100, rel=1e-12)


def test_a_single_camera_has_no_transforms(tmp_path):
    found = read(tmp_path, CHAIN[: CHAIN.index("  T_cam_imu")])
    assert columns(found["cameras"])["camera"] == ["cam0"]
    assert found["transforms"].diagnostics[0].code.name == "no-records"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("camera_model: pinhole", "camera_model: lens", "`camera_model` of `cam0` is `lens`"),
        ("[458.5, 457.25, 367.5, 248.25]", "[458.5]", "`intrinsics` of `cam0` are fx fy cx cy, and here are 1 numbers"),
        ("distortion_model: radtan", "distortion_model: best", "is `best`; those that are read are radtan"),
        ("resolution: [752, 480]", "resolution: 752", "`resolution` of `cam0` is no list of numbers"),
        ("  resolution: [752, 480]\n  rostopic", "  rostopic", "`cam0` has no `resolution`"),
        ("[0.0, 0.6, -0.8, 0.01]", "[0.0, 0.6, 0.8, 0.01]", "`T_cn_cnm1` of `cam1` is no rotation and translation"),
        ("[0.0, 0.6, -0.8, 0.01]", "[0.0, 0.6, .nan, 0.01]", "is no rotation and translation"),
        ("  - [0.0, 0.6, -0.8, 0.01]\n", "", "`T_cn_cnm1` of `cam1` is no 4×4 matrix"),
        ("T_cam_imu", "T_cn_cnm1", "and no camera stands before it"),
        ("cam0:", "camera0:", "no camera stands before it"),
    ],
)
def test_faults_name_the_camera_and_the_entry(tmp_path, old, new, reason):
    assert old in CHAIN
    with pytest.raises(MbmError) as caught:
        read(tmp_path, CHAIN.replace(old, new, 1))
    (fault,) = caught.value.diagnostics
    assert reason in fault.message
    assert fault.place.row is not None
