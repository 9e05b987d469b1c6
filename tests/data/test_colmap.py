"""COLMAP models, as texts and binary: what is in the tables, and what a damaged or inconsistent model is told.

The files are laid out here as COLMAP's documentation of its output format has them.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import mbm
from mbm.cli.main import run
from mbm.data.readers import READERS
from mbm.text.types import MbmError

MODELS = {"SIMPLE_RADIAL": 2, "OPENCV": 4, "PINHOLE": 1}


@dataclass(frozen=True)
class Model:
    cameras: tuple = ((1, "SIMPLE_RADIAL", 640, 480, (500.5, 320.0, 240.0, -0.1)),
                      (7, "OPENCV", 1024, 768, (801.0, 802.0, 512.0, 384.0, 0.1, 0.01, 1e-3, -2e-3)))  # fmt: skip
    images: tuple = (
        (
            3,
            (1.0, 0.0, 0.0, 0.0),
            (0.5, -0.25, 2.0),
            7,
            "a b.jpg",
            ((10.5, 20.25, 11), (1.0, 2.0, -1), (30.0, 40.0, 12)),
        ),
        (4, (0.6, 0.0, 0.8, 0.0), (1.0, 2.0, 3.0), 1, "é.jpg", ()),
        (9, (0.8, 0.0, 0.0, -0.6), (0.0, 0.0, 1.0), 1, "z/c.png", ((5.0, 6.0, 12),)),
    )
    points: tuple = (
        (11, (0.1, 0.2, 0.3), (255, 0, 7), 0.5, ((3, 0),)),
        (12, (-1.0, 2.0, 4.5), (1, 2, 3), 0.25, ((3, 2), (9, 0))),
    )
    extra: bytes = field(default=b"")


def write_text(folder, model):
    lines = [" ".join(map(str, (i, m, w, h, *p))) for i, m, w, h, p in model.cameras]
    (folder / "cameras.txt").write_text("# Camera list\n" + "\n".join(lines) + "\n")
    lines = []
    for number, q, t, camera, name, points in model.images:
        lines.append(" ".join(map(str, (number, *q, *t, camera, name))))
        lines.append(" ".join(f"{x!r} {y!r} {seen}" for x, y, seen in points))
    (folder / "images.txt").write_text("# Image list\n\n" + "\n".join(lines) + "\n")
    lines = [
        " ".join(map(str, (i, *x, *c, e, *(n for pair in track for n in pair)))) for i, x, c, e, track in model.points
    ]
    (folder / "points3D.txt").write_text("# 3D point list\n" + "\n".join(lines) + "\n")


def write_binary(folder, model):
    content = struct.pack("<Q", len(model.cameras))
    for number, name, width, height, parameters in model.cameras:
        content += struct.pack("<iiQQ", number, MODELS[name], width, height)
        content += struct.pack(f"<{len(parameters)}d", *parameters)
    (folder / "cameras.bin").write_bytes(content + model.extra)
    content = struct.pack("<Q", len(model.images))
    for number, q, t, camera, name, points in model.images:
        content += struct.pack("<i7di", number, *q, *t, camera) + name.encode() + b"\0" + struct.pack("<Q", len(points))
        content += b"".join(struct.pack("<ddq", *each) for each in points)
    (folder / "images.bin").write_bytes(content)
    content = struct.pack("<Q", len(model.points))
    for number, x, color, error, track in model.points:
        content += struct.pack("<Q3d3BdQ", number, *x, *color, error, len(track))
        content += b"".join(struct.pack("<ii", *each) for each in track)
    (folder / "points3D.bin").write_bytes(content)


WRITERS = {"txt": write_text, "bin": write_binary}


@pytest.fixture(params=WRITERS)
def kind(request):
    return request.param


def tables(folder):
    return READERS["colmap"].read(folder)


def columns(table):
    return {c.name: list(c.texts) if c.is_text else c.numbers.tolist() for c in table.columns}


def test_the_columns_are_those_of_the_manual(tmp_path, kind):
    WRITERS[kind](tmp_path, Model())
    found = tables(tmp_path)
    cameras = columns(found["cameras"])
    assert list(cameras) == [
        "camera",
        "model",
        "width",
        "height",
        "f",
        "cx",
        "cy",
        "k",
        "fx",
        "fy",
        "k1",
        "k2",
        "p1",
        "p2",
    ]
    assert (cameras["camera"], cameras["model"]) == ([1, 7], ["SIMPLE_RADIAL", "OPENCV"])
    assert (cameras["cx"], cameras["width"]) == ([320, 512], [640, 1024])
    np.testing.assert_array_equal([cameras["k"], cameras["p2"]], [[-0.1, np.nan], [np.nan, -2e-3]])
    images = columns(found["images"])
    assert list(images) == ["image", "name", "camera", "qw", "qx", "qy", "qz", "x", "y", "z"]
    assert (images["image"], images["name"]) == ([3, 4, 9], ["a b.jpg", "é.jpg", "z/c.png"])
    assert (images["camera"], images["qy"], images["z"]) == ([7, 1, 1], [0, 0.8, 0], [2, 3, 1])
    assert columns(found["points"]) == {"point": [11, 12], "x": [0.1, -1], "y": [0.2, 2], "z": [0.3, 4.5]}
    seen = {"image": [3, 3, 9], "point": [11, 12, 12], "u": [10.5, 30, 5], "v": [20.25, 40, 6]}
    assert columns(found["observations"]) == seen  # the 2D point without a point is no observation
    assert [found[part].key for part in found] == ["camera", "image", "point", None]
    for part, stem in zip(found, ("cameras", "images", "points3D", "images"), strict=True):
        path = tmp_path / f"{stem}.{kind}"
        assert (found[part].path, found[part].sha256) == (
            path.as_posix(),
            hashlib.sha256(path.read_bytes()).hexdigest(),
        )


def test_binary_files_go_before_texts_if_all_of_them_are_there(tmp_path):
    write_text(tmp_path, Model())
    other = replace(
        Model(), points=((11, (9.0, 9.0, 9.0), (0, 0, 0), 0.0, ()), (12, (8.0, 8.0, 8.0), (0, 0, 0), 0.0, ()))
    )
    write_binary(tmp_path, other)
    assert columns(tables(tmp_path)["points"])["x"] == [9, 8]
    (tmp_path / "cameras.bin").unlink()
    assert columns(tables(tmp_path)["points"])["x"] == [0.1, -1]


BROKEN = {
    "camera": (
        lambda m: replace(m, images=((*m.images[0][:3], 5, *m.images[0][4:]), *m.images[1:])),
        "images", "images.{}", "there is no camera 5 in `{}cameras.{}`",
    ),
    "point": (
        lambda m: replace(m, points=m.points[1:]),
        "observations", "images.{}", "2D point 0 of image 3 is that of point 11, and there is none in",
    ),
    "image": (
        lambda m: replace(m, points=((*m.points[0][:4], ((3, 0), (8, 0))), m.points[1])),
        "observations", "points3D.{}", "its track names image 8, and there is none in",
    ),
    "2D point": (
        lambda m: replace(m, points=((*m.points[0][:4], ((3, 3),)), m.points[1])),
        "observations", "points3D.{}", "its track names 2D point 3 of image 3, which has 3, counted from 0",
    ),
    "empty image": (
        lambda m: replace(m, points=((*m.points[0][:4], ((4, 0),)), m.points[1])),
        "observations", "points3D.{}", "its track names 2D point 0 of image 4, which has 0, counted from 0",
    ),
    "other point": (
        lambda m: replace(m, points=((*m.points[0][:4], ((3, 2),)), m.points[1])),
        "observations", "points3D.{}", "its track names 2D point 2 of image 3, which belongs to point 12",
    ),
    "twice": (
        lambda m: replace(m, images=(m.images[0], m.images[0])),
        "images", "images.{}", "there is a second image 3",
    ),
    "rotation": (
        lambda m: replace(m, images=((3, (0.5, 0.0, 0.0, 0.0), *m.images[0][2:]), *m.images[1:])),
        "images", "images.{}", "its quaternion has the length 0.5, not 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_what_refers_to_nothing_is_told_with_its_place(tmp_path, kind, what):
    broken, part, file, reason = BROKEN[what]
    WRITERS[kind](tmp_path, broken(Model()))
    error = tables(tmp_path)[part]
    assert isinstance(error, MbmError)
    (fault,) = error.diagnostics
    assert fault.code.name == "malformed-record"
    assert reason.format(tmp_path.as_posix() + "/", kind) in fault.message
    assert fault.place.file == (tmp_path / file.format(kind)).as_posix()
    assert fault.place.row is not None


def test_tables_that_do_not_need_what_is_wrong_are_read(tmp_path, kind):
    broken, *_ = BROKEN["point"]
    WRITERS[kind](tmp_path, broken(Model()))
    found = tables(tmp_path)
    assert [isinstance(found[part], MbmError) for part in found] == [False, False, False, True]
    (tmp_path / f"points3D.{kind}").unlink()
    if kind == "txt":
        (fault,) = tables(tmp_path)["observations"].diagnostics
        assert (fault.code.name, "points3D.txt" in fault.message) == ("missing-file", True)


@pytest.mark.parametrize("stem", ["cameras", "images", "points3D"])
def test_a_binary_file_that_is_cut_or_longer_or_lies_about_its_counts(tmp_path, stem):
    write_binary(tmp_path, Model())
    path = tmp_path / f"{stem}.bin"
    whole = path.read_bytes()
    part = {"cameras": "cameras", "images": "images", "points3D": "points"}[stem]
    huge = struct.pack("<Q", 2**63)
    for content in (*(whole[:n] for n in range(1, len(whole), 7)), whole + b"\0", huge + whole[8:], huge):
        path.write_bytes(content)
        (fault,) = tables(tmp_path)[part].diagnostics
        assert (fault.code.name, fault.place.file) == ("malformed-record", path.as_posix())


def test_texts_with_faults(tmp_path):
    write_text(tmp_path, Model())
    for file, part, content, reason in (
        (
            "cameras.txt",
            "cameras",
            "1 PINHOLE 640 480 1 2 3\n",
            "PINHOLE has the parameters fx fy cx cy, and here are 3",
        ),
        ("cameras.txt", "cameras", "1 LENS 640 480 1 2 3\n", "`LENS` is no camera model"),
        ("cameras.txt", "cameras", "1 PINHOLE\n", "a camera has an id, a model, a width, a height"),
        ("cameras.txt", "cameras", "1.5 SIMPLE_PINHOLE 6 4 1 2 3\n", "the id of the camera is 1.5"),
        ("images.txt", "images", "3 1 0 0 0 0 0 0 1\n\n", "an image has an id"),
        ("images.txt", "images", "3 1 0 0 0 0 0 x 1 n\n\n", "`x` is no number"),
        ("images.txt", "images", "3 1 0 0 0 0 0 0 1 n\n1 2\n", "triples of x, y"),
        ("points3D.txt", "points", "1 2 3 4 5 6 7\n", "a point has an id, three coordinates"),
        ("points3D.txt", "points", "-1 2 3 4 5 6 7 8\n", "the id of the point is -1"),
    ):
        write_text(tmp_path, Model())
        (tmp_path / file).write_text(content)
        (fault,) = tables(tmp_path)[part].diagnostics
        assert reason in fault.message


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(stem=st.sampled_from(["cameras", "images", "points3D"]), data=st.data())
def test_whatever_bytes_a_file_holds(tmp_path, kind, stem, data):
    """Bytes of a sound file changed, or any: tables with a cell for each row, or diagnostics that name a file."""
    WRITERS[kind](tmp_path, Model())
    path = tmp_path / f"{stem}.{kind}"
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(data.draw(st.sampled_from([bytes(content), bytes(content[: len(content) // 2])]) | st.binary()))
    for found in tables(tmp_path).values():
        if isinstance(found, MbmError):
            assert all(fault.place.file.startswith(tmp_path.as_posix()) for fault in found.diagnostics)
        else:
            assert {len(cells) for cells in columns(found).values()} == {len(found.file_rows)}


LINE = """(problem p (data images (colmap "model" :images)) (data points (colmap "model" :points))
  (data cameras (colmap "model" :cameras))
  (data seen (colmap "model" :observations) :with (images image) :with (points point) :with (cameras images.camera))
  (unknowns (a)) (observe seen (= u (+ a points.z)) :sigma 1))"""


def test_a_problem_reads_the_model_and_confines_its_files(tmp_path, monkeypatch, capsys, kind):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model").mkdir()
    WRITERS[kind](tmp_path / "model", Model())
    (tmp_path / "p.mbm").write_text(LINE.replace(" :with (cameras images.camera)", ""))
    value = float(mbm.load("p.mbm").solve()["a"].value)
    assert value == pytest.approx(np.mean([10.5 - 0.3, 30 - 4.5, 5 - 4.5]), rel=1e-12)  # a mean in one step
    assert run(["solve", "p.mbm", "--csv", f"model/images.{kind}"]) == 2
    assert "would-overwrite" in capsys.readouterr().err
    (tmp_path / "box").mkdir()
    (tmp_path / "model").rename(tmp_path / "box" / "model")
    (tmp_path / "p.mbm").rename(tmp_path / "box" / "p.mbm")
    (tmp_path / "box" / "model" / f"points3D.{kind}").rename(tmp_path / "secret")
    (tmp_path / "box" / "model" / f"points3D.{kind}").symlink_to(tmp_path / "secret")
    assert run(["check", "box/p.mbm"]) == 0
    assert run(["check", "box/p.mbm", "--sandbox", "box"]) == 2
    assert "outside-sandbox" in capsys.readouterr().err


@pytest.mark.parametrize("path", ["none", "p.mbm", "empty"])
def test_what_is_no_model(tmp_path, monkeypatch, capsys, path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "p.mbm").write_text(
        f'(problem p (data d (colmap "{path}" :points)) (unknowns (a)) (observe d (= x a)))'
    )
    assert run(["check", "p.mbm"]) == 2
    said = capsys.readouterr().err
    assert "error[missing-file]" in said and "points3D.txt" in said
