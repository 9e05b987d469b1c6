"""Errors of aligned trajectories: equal to evo's digits, of any alignment that a file states, with what is refused."""

from __future__ import annotations

import csv
import gzip
import json
from io import StringIO

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.api import trajectory_file
from mbm.cli.main import run
from mbm.report.options import SolveOptions
from tests.evidence.material import measured

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")
ALIGNED = "(= [ref.x ref.y ref.z] (transform S [est.x est.y est.z]))"
POSES = {
    side: f"(pose3 (quaternion {side}.qw {side}.qx {side}.qy {side}.qz) [{side}.x {side}.y {side}.z])"
    for side in ("ref", "est")
}
FIRST = {
    side: f"(pose3 (quaternion {' '.join(f'(first both {side}.{q})' for q in ('qw', 'qx', 'qy', 'qz'))}) "
    f"(first both [{side}.x {side}.y {side}.z]))"
    for side in ("ref", "est")
}
ALIGNMENTS = {
    "sim3": "(unknowns (S (similarity 3)))",
    "se3": "(unknowns (S (pose 3)))",
    "origin": f"(unknowns (S (pose 3) :fixed true :init (compose {FIRST['ref']} (inverse {FIRST['est']}))))",
    "none": "(unknowns (S (pose 3) :fixed true :init (pose3)))",
}
FILE = """
(problem p
  (data ref (tum "{ref}"))
  (data est (tum "{est}"))
  (pair both (ref est) :by t :tolerance 10ms)
  {more}
  (observe both {equation}))
"""


def written(folder, seed=0, count=120):
    """Two TUM files: a walk through space, and what an odometry of another frame, scale and drift makes of it."""
    random = np.random.default_rng(seed)
    t = 1000 + np.arange(count) * 0.1
    turn = Rotation.from_rotvec(np.cumsum(random.normal(0, 0.03, (count, 3)), axis=0))
    position = np.cumsum(turn.apply([0.05, 0.0, 0.0]), axis=0)
    frame = Rotation.from_rotvec([0.3, -0.8, 1.4])
    drift = Rotation.from_rotvec(np.cumsum(random.normal(0, 0.003, (count, 3)), axis=0))
    seen = frame.apply(position) * 0.6 + [3, -1, 2] + np.cumsum(random.normal(0, 0.004, (count, 3)), axis=0)
    paths = []
    for name, times, where, how in (
        ("ref", t, position, turn),
        ("est", t + random.uniform(-0.004, 0.004, count), seen, frame * turn * drift),
    ):
        path = folder / f"{name}.txt"
        np.savetxt(path, np.column_stack([times, where, how.as_quat()]), fmt="%.9f")
        paths.append(path)
    return paths


def problem(folder, ref, est, alignment="se3", equation=ALIGNED, more=""):
    path = folder / "p.mbm"
    path.write_text(FILE.format(ref=ref, est=est, more=ALIGNMENTS.get(alignment, alignment) + more, equation=equation))
    return path


def evo_errors(ref, est, alignment, deltas):
    """What evo says: of each part (and step) its statistics."""
    pytest.importorskip("evo")
    from evo.core import metrics, sync
    from evo.tools import file_interface

    a, b = sync.associate_trajectories(*(file_interface.read_tum_trajectory_file(str(p)) for p in (ref, est)))
    if alignment == "origin":
        b.align_origin(a)
    elif alignment != "none":
        b.align(a, correct_scale=alignment == "sim3")
    parts = {
        "translation": metrics.PoseRelation.translation_part,
        "rotation": metrics.PoseRelation.rotation_angle_deg,
        "rotation_part": metrics.PoseRelation.rotation_part,
        "full": metrics.PoseRelation.full_transformation,
    }
    found = {}
    for name, relation in parts.items():
        for delta in (None, *deltas):
            if delta is None:
                metric = metrics.APE(relation)
            else:
                unit = metrics.Unit.frames if delta.endswith("f") else metrics.Unit.meters
                metric = metrics.RPE(relation, float(delta[:-1]), unit, 0.1, True, pairs_from_reference=True)
            metric.process_data((a, b))
            found[delta, name] = (metric.get_all_statistics(), len(metric.error))
    return found


def compare(document, expected, deltas):
    for (delta, part), (wanted, rows) in expected.items():
        found = document["ape"] if delta is None else document["segments"][deltas.index(delta)]
        found = found if part == "translation" else found[part]
        assert found["rows"] == rows
        for name in STATISTICS:
            # Both end within 1e-12 of the least squares; errors of 1e-16 (of the first pose, at the origin) are zeros.
            assert found[name] == pytest.approx(float(wanted[name]), rel=1e-9, abs=1e-7), (delta, part, name)


@pytest.mark.parametrize("alignment", ALIGNMENTS)
def test_errors_equal_evos(alignment, tmp_path):
    deltas = ("1f", "7f", "0.4m")
    ref, est = written(tmp_path)
    expected = evo_errors(ref, est, alignment, deltas)
    answer = trajectory_file(problem(tmp_path, ref, est, alignment), SolveOptions(), deltas)
    document = answer.document()
    assert document["status"] == "ok"
    compare(document["solves"][0]["trajectory"], expected, deltas)


@pytest.mark.parametrize(
    ("truth", "estimate", "alignment"),
    [
        ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", "se3"),
        ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", "sim3"),
        ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", "origin"),
        ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", "none"),
        ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-ORB_kf_mono.txt", "sim3"),
        ("fr2_desk_groundtruth.txt.gz", "fr2_desk_ORB_kf_mono.txt", "sim3"),
        ("fr2_desk_groundtruth.txt.gz", "fr2_desk_ORB.txt", "se3"),
    ],
)
def test_errors_of_measured_trajectories_equal_evos(truth, estimate, alignment, tmp_path):
    ref, est = measured("trajectory", truth), measured("trajectory", estimate)
    if ref.suffix == ".gz":
        plain = tmp_path / "truth.txt"
        plain.write_bytes(gzip.decompress(ref.read_bytes()))
        ref = plain
    deltas = ("1f", "0.5m")
    expected = evo_errors(ref, est, alignment, deltas)
    answer = trajectory_file(problem(tmp_path, ref, est, alignment), SolveOptions(), deltas)
    compare(answer.document()["solves"][0]["trajectory"], expected, deltas)


def test_steps_are_those_of_pairs_of_the_table_with_itself(tmp_path):
    ref, est = written(tmp_path)
    more = """
      (pair rows ((from both) (to both)) :by row :step 7)
      (pair way ((from both) (to both)) :by distance :step 0.4m :tolerance 4cm :along (ref.x ref.y ref.z))
      (pair late ((from both) (to both)) :by t :step 700ms :tolerance 1ms)"""
    stated = trajectory_file(problem(tmp_path, ref, est, more=more), SolveOptions())
    asked = trajectory_file(problem(tmp_path, ref, est), SolveOptions(), ("7f", "0.4m", "0.7s"))
    one, other = (answer.document()["solves"][0]["trajectory"]["segments"] for answer in (stated, asked))
    assert [each.pop("pair") for each in one] == ["rows", "way", "late"]
    assert one == other
    # rows are 0.1 s apart
    assert one[0]["rmse"] == one[2]["rmse"]


def test_poses_may_be_compared_as_such(tmp_path):
    ref, est = written(tmp_path)
    equation = f"(= {POSES['ref']} (compose S {POSES['est']})) :sigma [0.1 0.1 0.1 1 1 1]"
    found = trajectory_file(problem(tmp_path, ref, est, equation=equation), SolveOptions(), ("5f",))
    result = found.result.solves[0]
    pose = next(e for e in result.estimates if e.quantity.name == "S").value
    turn = Rotation.from_quat(np.roll(pose[:4], -1))
    tables = [np.loadtxt(path) for path in (ref, est)]
    aligned = turn.apply(tables[1][:, 1:4]) + pose[4:]
    apart = Rotation.from_quat(tables[0][:, 4:]).inv() * turn * Rotation.from_quat(tables[1][:, 4:])
    ape = found.trajectories[0].ape
    np.testing.assert_allclose(ape.translation, np.linalg.norm(aligned - tables[0][:, 1:4], axis=1), rtol=1e-9)
    np.testing.assert_allclose(ape.rotation, apart.magnitude(), rtol=1e-6)


def test_only_the_yaw_is_aligned(tmp_path):
    ref, est = written(tmp_path)
    alignment = "(unknowns (psi angle :init 1) (o (vector 3) :init [0 0 0]))"
    equation = "(= [ref.x ref.y ref.z] (transform (pose3 (rot-z psi) o) [est.x est.y est.z]))"
    found = trajectory_file(problem(tmp_path, ref, est, alignment, equation), SolveOptions()).trajectories[0]
    a, b = (np.loadtxt(path) for path in (ref, est))
    # In closed form: the yaw that turns the centred positions onto each other, seen from above.
    p, q = (table[:, 1:4] - table[:, 1:4].mean(axis=0) for table in (a, b))
    psi = np.arctan2((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum(), (q[:, :2] * p[:, :2]).sum())
    turn = Rotation.from_rotvec([0, 0, psi])
    np.testing.assert_allclose(found.ape.translation, np.linalg.norm(turn.apply(q) - p, axis=1), rtol=1e-7)
    apart = Rotation.from_quat(a[:, 4:]).inv() * turn * Rotation.from_quat(b[:, 4:])
    np.testing.assert_allclose(found.ape.rotation, apart.magnitude(), rtol=1e-7)


PLANE = """
(problem p
  (data ref (table (t x y th) {ref}))
  (data est (table (t x y th) {est}))
  (pair both (ref est) :by t)
  (unknowns (S (similarity 2)))
  (observe both (= [ref.x ref.y] (transform S [est.x est.y])) :sigma 0.1 {options}))
"""


def plane(options="", wild=()):
    random = np.random.default_rng(7)
    t = np.arange(30.0)
    heading = np.cumsum(random.normal(0, 0.2, 30))
    where = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    seen = (where + random.normal(0, 0.1, where.shape)) @ turn / 2 + [4, 5]
    for row in wild:
        seen[row] += 30
    own = heading - 0.7 + random.normal(0, 0.02, 30)

    def rows(*columns):
        return " ".join(f"({' '.join(repr(float(c)) for c in row)})" for row in zip(*columns, strict=True))

    text = PLANE.format(ref=rows(t, *where.T, heading), est=rows(t, *seen.T, own), options=options)
    return mbm.loads(text), heading, own


def test_the_plane_with_headings():
    made, heading, own = plane()
    solved = made.solve()
    found = solved.trajectory("3f")
    angle = float(solved["S"].value[0])
    apart = own + angle - heading
    np.testing.assert_allclose(found.ape.rotation, np.abs(np.arctan2(np.sin(apart), np.cos(apart))), atol=1e-9)
    np.testing.assert_array_equal(found.rpe[0].end - found.rpe[0].start, 3)
    turned = np.abs((own[3:] - own[:-3]) - (heading[3:] - heading[:-3]))
    np.testing.assert_allclose(found.rpe[0].errors.rotation, turned, atol=1e-9)


def test_a_loss_keeps_wild_poses_out_of_the_alignment_but_not_of_the_errors():
    clean, wild = plane()[0].solve(), plane(":loss (tukey)", wild=(4, 20))[0].solve()
    errors = wild.trajectory().ape.translation
    assert sorted(np.argsort(errors)[-2:]) == [4, 20]
    others = np.delete(errors, [4, 20])
    wanted = np.delete(clean.trajectory().ape.translation, [4, 20])
    np.testing.assert_allclose(np.sqrt(np.mean(others**2)), np.sqrt(np.mean(wanted**2)), rtol=0.1)


def test_positions_alone_are_compared_by_their_distances():
    made = mbm.loads("""
        (problem p
          (data d (table (t ref.x ref.y est.x est.y) (0 0m 0m 1m 0m) (1 3m 4m 4m 4m) (2 6m 8m 8m 8m)))
          (unknowns (o (vector 2) :init [0 0] :unit m))
          (observe d (= [ref.x ref.y] (+ o [est.x est.y])) :sigma 1cm))""")
    found = made.solve().trajectory()
    assert found.ape.rotation is None
    # 5 m each; the estimate walks 5 m, then √(4² + 4²)
    np.testing.assert_allclose(found.rpe[0].errors.translation, [0, np.sqrt(32) - 5], atol=1e-12)
    assert found.ape.unit is None or found.ape.unit == "m"


def test_each_pose_has_a_row_in_the_csv_file(tmp_path, capsys):
    ref, est = written(tmp_path)
    file = problem(tmp_path, ref, est)
    made = ["--csv", str(tmp_path / "e.csv"), "--json", str(tmp_path / "e.json"), "--plot", str(tmp_path / "e.svg")]
    assert run(["trajectory", str(file), "--delta", "5f", *made]) == 0
    shown = capsys.readouterr().out
    assert "absolute, position" in shown
    assert "per 5 rows, rotation" in shown
    document = json.loads((tmp_path / "e.json").read_text())
    ape = document["solves"][0]["trajectory"]["ape"]
    rows = list(csv.DictReader(StringIO((tmp_path / "e.csv").read_text())))
    errors = np.array([float(row["ape"]) for row in rows])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(ape["rmse"], rel=1e-12)
    assert [row["rpe"] == "" for row in rows] == [i < 5 for i in range(len(rows))]
    picture = (tmp_path / "e.svg").read_text()
    assert all(words in picture for words in ("<svg", "</svg>"))


def test_an_alignment_that_is_not_observable_is_an_answer_in_doubt(tmp_path, capsys):
    file = tmp_path / "p.mbm"
    file.write_text("""
        (problem p
          (data d (table (ref.x ref.y ref.z est.x est.y est.z) (0 0 0 0 0 0) (1 0 0 1 0 0) (2 0 0 2 0 0)))
          (unknowns (S (pose 3) :init (pose3)))
          (observe d (= [ref.x ref.y ref.z] (transform S [est.x est.y est.z])) :sigma 0.1))""")
    assert run(["trajectory", str(file)]) == 1
    said = capsys.readouterr().out
    assert "absolute, position" in said
    assert "unobservable" in said
    assert "not determined by the data" in said


def test_what_an_alignment_warns_of_is_said_with_the_errors(tmp_path, capsys):
    """The noise alone tells how a straight line is turned about itself, and with it the errors of rotations."""
    g = np.random.default_rng(0)
    rows = [[k, 0.0, 0.0, *(np.array([k, 0.0, 0.0]) + 0.05 * g.normal(size=3))] for k in range(20)]
    text = " ".join(f"({' '.join(map(str, row))})" for row in rows)
    file = tmp_path / "p.mbm"
    file.write_text(f"""
        (problem p
          (data d (table (ref.x ref.y ref.z est.x est.y est.z) {text}))
          (unknowns (S (pose 3)))
          (observe d (= [ref.x ref.y ref.z] (transform S [est.x est.y est.z]))))""")
    assert run(["trajectory", str(file)]) == 0
    said = capsys.readouterr()
    assert "absolute, position" in said.out
    assert "too-nonlinear" in said.err
    assert run(["trajectory", str(file), "-q"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("quaternion", ["0 0 0 0", "nan 0 0 1"])
def test_a_quaternion_that_is_no_rotation_is_told_with_its_line(quaternion, tmp_path):
    ref, est = written(tmp_path)
    lines = est.read_text().splitlines()
    lines[7] = " ".join([*lines[7].split()[:4], quaternion])
    est.write_text("\n".join(lines))
    file = tmp_path / "p.mbm"
    file.write_text(FILE.format(ref=ref, est=est, more=ALIGNMENTS["se3"], equation=ALIGNED))
    with pytest.raises(mbm.MbmError) as caught:
        trajectory_file(file, SolveOptions())
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "no-rotation"
    assert (fault.place.file, fault.place.row) == (str(est), 8)
    assert f"length {'0' if quaternion == '0 0 0 0' else 'nan'}" in fault.message


@pytest.mark.parametrize(
    ("text", "deltas", "code"),
    [
        ("(unknowns (v)) (data d (table (x y) (1 2) (2 3))) (observe d (= y (* v x)))", (), "no-trajectory"),
        (
            "(unknowns (o (vector 2) :init [0 0])) (data d (table (a.x a.y b.x b.y) (1 2 3 4) (2 3 4 5)))"
            "(observe one d (= [a.x a.y] (+ o [b.x b.y]))) (observe two d (= [b.x b.y] (+ o [a.x a.y])))",
            (),
            "several-trajectories",
        ),
        *(
            (
                "(unknowns (o (vector 2) :init [0 0])) (data d (table (a.x a.y b.x b.y) (1 2 3 4) (2 3 4 5)))"
                "(observe d (= [a.x a.y] (+ o [b.x b.y])))",
                (delta,),
                "bad-delta",
            )
            for delta in ("7", "0f", "1.5f", "-1m", "1e999m", "nanm", "9f", "100m", "1s", "")
        ),
    ],
)
def test_what_is_refused(text, deltas, code, tmp_path):
    file = tmp_path / "p.mbm"
    file.write_text(f"(problem p {text})")
    with pytest.raises(mbm.MbmError) as caught:
        trajectory_file(file, SolveOptions(), deltas)
    assert {d.code.name for d in caught.value.diagnostics} == {code}


def test_one_of_several_observations_is_named(tmp_path, capsys):
    file = tmp_path / "p.mbm"
    file.write_text("""
        (problem p
          (data d (table (a.x a.y b.x b.y c.x c.y) (1 2 3 4 0 0) (2 3 4 6 1 1)))
          (unknowns (o (vector 2) :init [0 0]) (u (vector 2) :init [0 0]))
          (observe one d (= [a.x a.y] (+ o [b.x b.y])))
          (observe two d (= [a.x a.y] (+ u [c.x c.y]))))""")
    assert run(["trajectory", str(file), "--observation", "two", "-q"]) == 0
    assert "`c` against `a`" in capsys.readouterr().out


@pytest.mark.parametrize("moves", ["neither", "est", "ref", "otherwise"])
def test_a_similarity_that_collapses_is_refused(moves, tmp_path):
    """Nothing can be told of the scale between a path and one that stands still, or that goes elsewhere."""
    ref, est = written(tmp_path)
    g = np.random.default_rng(1)
    for path, side in ((ref, "ref"), (est, "est")):
        rows = np.loadtxt(path)
        if moves == "otherwise":
            rows[:, 1:4] = g.normal(0, 1, (120, 3)) if side == "est" else rows[:, 1:4]
        elif moves != side:
            rows[:, 1:4] = np.array([1.0, 2.0, 3.0]) + (0.01 * g.normal(size=(120, 3)) if side == "est" else 0.0)
        np.savetxt(path, rows, fmt="%.9f")
    with pytest.raises(mbm.MbmError) as caught:
        trajectory_file(problem(tmp_path, ref, est, "sim3"), SolveOptions())
    (said,) = caught.value.diagnostics
    assert (said.code.name, "no scale" in said.message) == ("no-trajectory", True)
    found = trajectory_file(problem(tmp_path, ref, est, "se3"), SolveOptions())
    assert found.trajectories[0].ape.statistics()["translation"].rmse > 0
