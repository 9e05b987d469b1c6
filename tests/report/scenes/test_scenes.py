"""Scenes written for COLMAP, Bundler and OpenCV: read by those, and by formulas that stand here, and read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2")

import cv2

import mbm
from mbm.text.types import MbmError
from tests.report.scenes.simulated import (
    CAMERAS,
    SAID,
    SIZES,
    TEXT,
    camera_pose,
    images,
    quaternion,
    rotation,
    solved,
    tables_of,
    world,
)

# Without noise the solve ends at the truth to 1e-12; files have all digits.
NEAR = {"rtol": 0, "atol": 1e-8}


@pytest.fixture(scope="module", params=SAID)
def scene(request):
    made = world(rig=request.param == "rig")
    return request.param, made, solved(request.param, made)


def wanted_image(said, made, name):
    """The camera and the pose of an image by its name."""
    camera, _, photo = name.rpartition("-")
    camera = camera or ("left", "right")[(int(photo[-1]) - 1) % 2]
    return camera, camera_pose(camera, made.poses[photo], said == "rig")


def test_colmap_itself_projects_to_what_was_measured(scene, tmp_path: Path) -> None:
    """COLMAP counts pixels from the corner: the centre of the first is at 0.5, where OpenCV has 0."""
    pycolmap = pytest.importorskip("pycolmap")
    said, made, result = scene
    result.write("colmap", tmp_path / "model")
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    assert len(model.images) == (10 if said == "rig" else 5)
    for image in model.images.values():
        camera, pose = wanted_image(said, made, image.name)
        own = model.cameras[image.camera_id]
        assert (own.width, own.height) == SIZES[camera]
        moved = image.cam_from_world()
        np.testing.assert_allclose(moved.rotation.matrix(), rotation(pose[0]), **NEAR)
        np.testing.assert_allclose(moved.translation, pose[1], **NEAR)
        seen = images(camera, pose, made.points)
        for point2d in image.points2D:
            point = model.points3D[point2d.point3D_id]
            number = point2d.point3D_id - 1
            np.testing.assert_allclose(point.xyz, made.points[number], **NEAR)
            np.testing.assert_allclose(point2d.xy, seen[number] + 0.5, rtol=0, atol=1e-9)
            np.testing.assert_allclose(own.img_from_cam(moved * point.xyz), point2d.xy, rtol=0, atol=1e-6)
    assert model.compute_mean_reprojection_error() < 1e-6


def read_again(source: str, columns: str, folder: Path) -> np.ndarray:
    """The means of some columns of a table, as mbm reads it."""
    size = len(columns.split())
    text = f"(problem p (data d {source}) (unknowns (m (vector {size}))) (observe d (= [{columns}] m) :sigma 1))"
    return mbm.loads(text, base=folder).solve()["m"].value


def test_our_reader_reads_what_was_written(scene, tmp_path: Path) -> None:
    said, made, result = scene
    result.write("colmap", tmp_path / "model")
    marks = read_again('(colmap "model" :points)', "x y z", tmp_path)
    np.testing.assert_allclose(marks, made.points.mean(axis=0), **NEAR)
    seen = read_again('(colmap "model" :observations)', "u v", tmp_path)
    np.testing.assert_allclose(seen, [np.mean(made.seen[n]) + 0.5 for n in "uv"], rtol=0, atol=1e-9)
    poses = [
        camera_pose(c, pose, said == "rig")
        for pose in made.poses.values()
        for c in (CAMERAS if said == "rig" else ["left"])
    ]
    found = read_again('(colmap "model" :images)', "qw qx qy qz x y z", tmp_path)
    wanted = np.mean([np.concatenate([quaternion(rvec), tvec]) for rvec, tvec in poses], axis=0)
    np.testing.assert_allclose(found, wanted, **NEAR)


def test_opencv_reads_its_cameras(scene, tmp_path: Path) -> None:
    said, made, result = scene
    result.write("opencv-yaml", tmp_path / "cameras")
    for name, (matrix, distortion) in CAMERAS.items():
        stored = cv2.FileStorage(str(tmp_path / "cameras" / f"cam-{name}.yml"), cv2.FILE_STORAGE_READ)
        np.testing.assert_array_equal(stored.getNode("camera_matrix").mat(), matrix)
        np.testing.assert_array_equal(stored.getNode("distortion_coefficients").mat().ravel(), distortion)
        assert (stored.getNode("image_width").real(), stored.getNode("image_height").real()) == SIZES[name]
        assert stored.getNode("avg_reprojection_error").real() < 1e-9
        placed = stored.getNode("extrinsic_parameters").mat()
        photos = list(made.poses) if said == "rig" else list(made.poses)[0 if name == "left" else 1 :: 2]
        wanted = [np.concatenate(camera_pose(name, made.poses[photo], said == "rig")) for photo in photos]
        np.testing.assert_allclose(placed, wanted, **NEAR)
    pytest.importorskip("yaml")
    (mean,) = read_again('(opencv "cameras/cam-left.yml" "camera_matrix")', "c1", tmp_path)
    assert mean == pytest.approx(500 / 3)


BUNDLE = """
(problem bundle
  (data cams external :key camera)
  (data marks external :key point)
  (data seen external :with (marks point))
  (camera cam :per cams :focal ({focal} {focal}) :center ({center} {center}) :distortion (k1 k2) :axes {axes})
  (unknowns (T (pose 3) :per cams :init (pose3 (quaternion qw qx qy qz) [tx ty tz])))
  (observe seen (= [u v] (project (cam camera) (transform (T camera) [marks.x marks.y marks.z]))) :sigma 1px))
"""


@pytest.mark.parametrize(("axis", "focal", "axes"), [(1, "f", "opencv"), (-1, "(- f)", "opencv"), (-1, "f", "opengl")])
def test_bundler_files_follow_its_formula(axis: int, focal: str, axes: str, tmp_path: Path) -> None:
    """P = R X + t, p = −P / P_z, p' = f (1 + k1 |p|² + k2 |p|⁴) p (the manual of Bundler v0.3), y upwards.

    Cameras that look along z with y downwards (OpenCV), and along −z with y upwards, as in BAL's files.
    """
    generator = np.random.default_rng(5)
    points = generator.uniform([-1, -1, 3], [1, 1, 5], size=(10, 3))
    flip = np.diag([1.0, 1.0, 1.0]) if axis > 0 else np.diag([1.0, -1.0, -1.0])
    f, k1, k2 = 450.0, -0.1, 0.02
    center = 200.0 if axis > 0 else 0.0
    cameras = [(generator.normal(scale=0.1, size=3), generator.normal(scale=0.1, size=3)) for _ in range(3)]
    seen, rows = [], []
    for number, (rvec, tvec) in enumerate(cameras):
        matrix, along = flip @ rotation(rvec), flip @ tvec
        inside = points @ matrix.T + along
        p = inside[:, :2] / inside[:, 2:]
        square = np.square(p).sum(axis=1, keepdims=True)
        uv = axis * f * (1 + k1 * square + k2 * square**2) * p + center
        seen += [(float(number), float(i), *each) for i, each in enumerate(uv)]
        rows.append([float(number), f, k1, k2, *quaternion(cv2.Rodrigues(matrix)[0].ravel()), *along])
    tables = {
        "seen": dict(zip(("camera", "point", "u", "v"), np.array(seen).T, strict=True)),
        "marks": {"point": np.arange(10.0), **dict(zip("xyz", points.T, strict=True))},
        "cams": dict(
            zip(("camera", "f", "k1", "k2", "qw", "qx", "qy", "qz", "tx", "ty", "tz"), np.array(rows).T, strict=True)
        ),
    }
    result = mbm.loads(BUNDLE.format(focal=focal, center=center, axes=axes)).solve(data=tables)
    assert result.first.cost < 1e-12
    result.write("bundler", tmp_path)
    numbers = [line.split() for line in (tmp_path / "bundle.out").read_text().splitlines()[1:]]
    assert numbers[0] == ["3", "10"]
    values = np.array([float(x) for line in numbers[1:16] for x in line]).reshape(3, 15)
    stream = [float(x) for line in numbers[16:] for x in line]
    for number in range(10):
        where = np.array(stream[:3])
        np.testing.assert_allclose(where, points[number], **NEAR)
        count = int(stream[6])
        views = np.array(stream[7 : 7 + 4 * count]).reshape(-1, 4)
        stream = stream[7 + 4 * count :]
        assert views[:, 0].tolist() == [0, 1, 2]
        assert views[:, 1].tolist() == [number] * 3
        for camera, _, x, y in views:
            focal, r1, r2, *rest = values[int(camera)]
            P = np.array(rest[:9]).reshape(3, 3) @ where + rest[9:]
            p = -P[:2] / P[2]
            square = p @ p
            wanted = focal * (1 + r1 * square + r2 * square**2) * p
            np.testing.assert_allclose([x, y], wanted, rtol=0, atol=1e-6)
            # what was measured from the principal point, upwards
            measured = np.array(seen[int(camera) * 10 + number][2:]) - center
            np.testing.assert_allclose([x, y], measured * [1, -axis], rtol=0, atol=1e-9)
            assert P[2] < 0
    np.testing.assert_allclose(
        read_again('(bundler "bundle.out" :cameras)', "f k1 k2", tmp_path), [f, k1, k2], rtol=1e-12
    )
    mean = np.mean([np.subtract(each[2:], center) * [1, -axis] for each in seen], axis=0)
    np.testing.assert_allclose(
        read_again('(bundler "bundle.out" :observations)', "u v", tmp_path), mean, rtol=0, atol=1e-9
    )


BACKWARDS = """
(problem backwards
  (data seen external)
  (camera cam :focal {focal} :center (310 -230) :distortion {distortion} :axes {axes})
  (unknowns (T (pose 3) :per seen.photo :init (pose3 (quaternion 1 0 0 0) [0 0 {away}])))
  (observe seen (= [u v] (project cam (transform (T photo) [x y z]))) :sigma 1px))
"""
TANGENTIAL = (-0.1, 0.02, 0.004, -0.003, 0.01)
LOOKING = {
    # v grows upwards, (x, y) / −z takes the distortion
    "opengl": ("opengl", "(600 610)", -4.0, lambda P: (P[:, :2] / -P[:, 2:], np.array([600, 610]))),
    "negative": ("opencv", "(-600 -610)", -4.0, lambda P: (P[:, :2] / P[:, 2:], np.array([-600, -610]))),
    "both": ("opengl", "(-600 -610)", 4.0, lambda P: (P[:, :2] / -P[:, 2:], np.array([-600, -610]))),
}


@pytest.mark.parametrize("name", LOOKING)
def test_opencv_projects_what_cameras_along_minus_z_measured(name: str, tmp_path: Path) -> None:
    """The files are of cameras along z, v downwards: their numbers in OpenCV's formula give what was measured."""
    axes, focal, away, formula = LOOKING[name]
    generator = np.random.default_rng(8)
    points = generator.uniform(-1, 1, size=(12, 3))
    k1, k2, p1, p2, k3 = TANGENTIAL
    rows = []
    for photo in range(2):
        inside = points @ rotation(generator.normal(scale=0.1, size=3)).T + [0.1, -0.1, away]
        (x, y), f = formula(inside)[0].T, formula(inside)[1]
        rr = x * x + y * y
        radial = 1 + k1 * rr + k2 * rr**2 + k3 * rr**3
        u = f[0] * (x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x)) + 310
        v = f[1] * (y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y) - 230
        rows += [(float(photo), *point, *uv) for point, *uv in zip(points, u, v, strict=True)]
    table = np.array(rows)
    text = BACKWARDS.format(axes=axes, focal=focal, away=away, distortion=f"({' '.join(map(str, TANGENTIAL))})")
    result = mbm.loads(text).solve(data={"seen": dict(zip(("photo", *"xyzuv"), table.T, strict=True))})
    assert result.first.cost < 1e-12
    result.write("opencv-yaml", tmp_path)
    result.write("colmap", tmp_path / "model")
    stored = cv2.FileStorage(str(tmp_path / "cam.yml"), cv2.FILE_STORAGE_READ)
    matrix, distortion = (stored.getNode(n).mat() for n in ("camera_matrix", "distortion_coefficients"))
    placed = stored.getNode("extrinsic_parameters").mat()
    lines = [each for each in (tmp_path / "model" / "images.txt").read_text().splitlines() if each[0] != "#"]
    for photo in range(2):
        mine = table[table[:, 0] == photo]
        turn, shift = placed[photo, :3], placed[photo, 3:]
        assert ((mine[:, 1:4] @ rotation(turn).T + shift)[:, 2] > 0).all()
        seen = cv2.projectPoints(mine[:, 1:4].copy(), turn, shift, matrix, distortion)[0].reshape(-1, 2)
        upright = 1 if name == "both" else -1
        np.testing.assert_allclose(seen, mine[:, 4:] * [1, upright], rtol=0, atol=1e-6)
        # COLMAP's images: pose, then u v point; its pixels are larger by a half
        pose = np.array(lines[2 * photo].split()[1:8], dtype=float)
        np.testing.assert_allclose(np.abs(pose[:4] @ quaternion(turn)), 1.0, **NEAR)
        np.testing.assert_allclose(pose[4:], shift, **NEAR)
        measured = np.array(lines[2 * photo + 1].split(), dtype=float).reshape(-1, 3)[:, :2] - 0.5
        np.testing.assert_allclose(measured, mine[:, 4:] * [1, upright], rtol=0, atol=1e-9)


def test_a_board_is_written_though_its_points_are_data(tmp_path: Path) -> None:
    """Points that are known are found from the equations, each once."""
    made = world()
    result = mbm.loads(
        """
        (problem board (data marks external :key point) (data seen external :with (marks point))
          (camera cam :focal (500 510) :center (320 240) :distortion (-0.2 0.05 0.001 -0.002 0.01))
          (unknowns (T (pose 3) :init (pose3 (identity 3) [0 0 0])))
          (observe seen (= [u v] (project cam (transform T [marks.x marks.y marks.z])))
            :sigma 1px :when (= photo "photo1")))
        """
    ).solve(
        data={
            "seen": made.seen,
            "marks": {"point": np.arange(1.0, 13.0), **dict(zip("xyz", made.points.T, strict=True))},
        }
    )
    result.write("colmap", tmp_path)
    lines = [line.split() for line in (tmp_path / "points3D.txt").read_text().splitlines()[1:]]
    np.testing.assert_allclose(np.array([line[1:4] for line in lines], dtype=float), made.points, **NEAR)
    assert (tmp_path / "cameras.txt").read_text().splitlines()[1].startswith("1 FULL_OPENCV ")


STEREO = """
(problem stereo
  (data marks (table (mark x y z) (a 0 0 0) (b 1 0 0) (c 1 1 0.2) (d 0 1 0.1)) :key mark)
  (data seen (table (photo mark u v)
      (p0 a 320 240) (p0 b 420 240) (p0 c 416 336) (p0 d 320 338)
      (p1 a 325 245) (p1 b 425 245) (p1 c 421 341) (p1 d 325 343)) :with (marks mark))
  (camera l :focal 500 :center (320 240)) {camera}
  (unknowns (T (pose 3) :per seen.photo :init (pose3 (identity 3) [0 0 5])))
  (observe seen (= [u v] (project l (transform (T photo) [marks.x marks.y marks.z]))) :sigma 0.3px)
  {right})
"""
RIGHT = """(observe seen
    (= [(- u 10) v] (project r (transform (pose3 (identity 3) [-0.1 0 0])
      (transform (T photo) [marks.x marks.y marks.z])))) :sigma 0.3px WHEN)"""


@pytest.mark.parametrize(
    ("camera", "right", "wanted"),
    [
        ("", "", ["p0", "p1"]),
        ("(camera r :focal 500 :center (320 240))", RIGHT.replace("WHEN", ""), ["l-p0", "l-p1", "r-p0", "r-p1"]),
        (
            "(camera r :focal 500 :center (320 240))",
            RIGHT.replace("WHEN", ':when (= photo "p1")'),
            ["l-p0", "l-p1", "r-p1"],
        ),
    ],
    ids=["one camera", "two cameras", "one of two cameras saw less"],
)
def test_images_are_called_by_the_photo_and_the_camera_where_there_are_two(camera, right, wanted, tmp_path: Path):
    """COLMAP looks for a file of this name."""
    mbm.loads(STEREO.format(camera=camera, right=right)).solve().write("colmap", tmp_path)
    lines = (tmp_path / "images.txt").read_text().splitlines()[2::2]
    assert sorted(line.split()[-1] for line in lines) == wanted


NAMED = """
(problem named
  (data marks (table (mark x y z) (a 0 0 0) (b 1 0 0) (c 1 1 0.2) (d 0 1 0.1)) :key mark)
  (data photos (table (photo name) (7 "{first}") (9 "set 2/right.jpg")) :key photo)
  (data seen (table (photo mark u v)
      (7 a 320 240) (7 b 420 240) (7 c 416 336) (7 d 320 338)
      (9 a 325 245) (9 b 425 245) (9 c 421 341) (9 d 325 343)) :with (photos photo) :with (marks mark))
  (camera l :focal 500 :center (320 240))
  (unknowns (T (pose 3) :per photos :init (pose3 (identity 3) [0 0 5])))
  (observe seen (= [u v] (project l (transform (T photo) [marks.x marks.y marks.z]))) :sigma 0.3px))
"""


@pytest.mark.parametrize(
    ("first", "wanted"),
    [("set/left.jpg", ["set/left.jpg", "set_2/right.jpg"]), ("set 2/right.jpg", ["7", "9"])],
    ids=["by their files", "two of one name"],
)
def test_images_keep_the_names_of_their_files_and_their_numbers(first: str, wanted: list[str], tmp_path: Path) -> None:
    """As a model of COLMAP has them: its database knows images by these names. A blank ends a name."""
    result = mbm.loads(NAMED.format(first=first)).solve()
    result.write("colmap", tmp_path / "colmap")
    lines = (tmp_path / "colmap" / "images.txt").read_text().splitlines()[2::2]
    assert [line.split()[0] for line in lines] == ["7", "9"]
    assert [line.split()[-1] for line in lines] == wanted
    result.write("bundler", tmp_path / "bundler")
    assert (tmp_path / "bundler" / "list.txt").read_text().split() == wanted


def test_photographs_that_mbm_measured_are_called_by_their_files(tmp_path: Path) -> None:
    problem = mbm.load(Path(__file__).parents[3] / "problems" / "photographs" / "photographs.mbm")
    problem.solve().write("colmap", tmp_path)
    lines = (tmp_path / "images.txt").read_text().splitlines()[2::2]
    assert [line.split()[-1] for line in lines] == [f"board{i}.png" for i in range(1, 8)]


def test_rejected_rows_are_in_no_track(tmp_path: Path) -> None:
    made = world()
    made.seen["u"][3] += 80.0
    init, point = SAID["inward"]
    text = TEXT.format(init=init, point=point, known="(< point 13)").replace(
        ":sigma 1px))", ":sigma 1px) (solve :robust gnc))"
    )
    tables = tables_of(made)
    tables["marks"] |= dict(zip("xyz", made.points.T, strict=True))
    result = mbm.loads(text).solve(data=tables)
    assert result.first.residual_summaries["seen"].outliers == (4,)
    result.write("colmap", tmp_path)
    track = (tmp_path / "points3D.txt").read_text().splitlines()[4].split()
    assert track[0] == "4"
    assert len(track[8:]) == 2 * 4


REFUSED = {
    "no image": ("(unknowns (a :init 1)) (observe o (= 1 a) :sigma 1)", "colmap", "needs an observation `(= [u v]"),
    "no pose": (
        "(camera cam :focal 500) (unknowns (f :init 1)) (observe o (= [10 20] (project cam [f 1 50])) :sigma 1)",
        "colmap",
        "needs a pose (`(pose 3)`) by which `cam` sees its points",
    ),
    "other axes": (
        "(camera cam :focal 500 :axes paper) (unknowns (T (pose 3) :init (pose3 (identity 3) [0 0 0])))"
        " (data d (table (x y z u v) (5 0 0 1 1) (5 1 0 101 0) (5 0 1 0 101) (6 1 1 82 83)))"
        " (observe d (= [u v] (project cam (transform T [x y z]))) :sigma 1)",
        "bundler",
        "needs a camera with `:axes opencv` or `opengl`; `cam` has others",
    ),
    "no model": (
        "(camera cam :focal 500 :model orthographic) (unknowns (T (pose 3) :init (pose3 (identity 3) [0 0 0])))"
        " (data d (table (x y z u v) (0 0 5 1 1) (1 0 5 501 0) (0 1 5 0 501) (1 1 6 502 503)))"
        " (observe d (= [u v] (project cam (transform T [x y z]))) :sigma 1)",
        "opencv-yaml",
        "has no orthographic cameras, as `cam` is",
    ),
    "no points": ("(unknowns (a :init 1)) (observe o (= 1 a) :sigma 1)", "ply", "needs a family of points"),
    "no graph": ("(unknowns (a :init 1)) (observe o (= 1 a) :sigma 1)", "g2o", "needs a family of poses"),
    "no trajectory": ("(unknowns (a :init 1)) (observe o (= 1 a) :sigma 1)", "tum", "needs a family of poses"),
    "many solves": (
        "(for-each k) (data d (table (k x) (1 1) (2 2))) (unknowns (a :init 1)) (observe d (= x a) :sigma 1)",
        "ply",
        "needs one solve, and there are 2",
    ),
    "no format": ("(unknowns (a :init 1)) (observe o (= 1 a) :sigma 1)", "colmpa", "`colmpa` is no format to write"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_format_lacks_is_named(case: str, tmp_path: Path) -> None:
    clauses, form, sentence = REFUSED[case]
    result = mbm.loads(f"(problem p {clauses})").solve()
    with pytest.raises(MbmError) as caught:
        result.write(form, tmp_path / "out")
    (diagnostic,) = caught.value.diagnostics
    assert sentence in diagnostic.message
    assert diagnostic.code.name == ("unknown-output" if case == "no format" else "format-needs")
    assert not (tmp_path / "out").exists()
