"""FileStorage files of OpenCV: as OpenCV itself writes and reads them, and as they may be damaged."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import mbm
from mbm.cli.main import run
from mbm.data.readers import READERS
from mbm.text.types import MbmError

pytest.importorskip("yaml")

FILE = """%YAML:1.0
---
nframes: 13
camera: "left one"
K: !!opencv-matrix
   rows: 2
   cols: 3
   dt: d
   data: [ 5.5e+02, 0., 3.25e+02, 0., 5.25e+02,
       -1.0000000000000001e-01 ]
dist: !!opencv-matrix
   rows: 4
   cols: 1
   dt: f
   data: [ -0.25, .5, 1., .Nan ]
corners: !!opencv-matrix
   rows: 2
   cols: 1
   dt: "2f"
   data: [ 1., 2., 3., 4. ]
sizes: [ 9, 6 ]
pairs: [ [ 1, 2 ], [ 3, 4 ] ]
inner: { depth: 7, R: !!opencv-matrix { rows: 1, cols: 1, dt: d, data: [ 3. ] } }
"""


@pytest.fixture
def tables(tmp_path):
    def read(text=FILE):
        path = tmp_path / "d.yml"
        path.write_text(text)
        return READERS["opencv"].read(path)

    return read


def columns(table):
    assert not isinstance(table, MbmError), table
    return {c.name: list(c.texts) if c.is_text else c.numbers.tolist() for c in table.columns}


def test_a_matrix_is_a_table_of_its_rows(tables):
    found = tables()
    assert columns(found["K"]) == {"c1": [550, 0], "c2": [0, 525], "c3": [325, -0.1]}
    assert columns(found["corners"]) == {"c1": [1, 3], "c2": [2, 4]}
    np.testing.assert_array_equal(columns(found["dist"])["c1"], [-0.25, 0.5, 1, np.nan])
    assert columns(found["sizes"]) == {"c1": [9, 6]}
    assert columns(found["pairs"]) == {"c1": [1, 3], "c2": [2, 4]}
    assert columns(found["inner.R"]) == {"c1": [3]}
    assert (columns(found["nframes"]), columns(found["camera"])) == ({"value": [13]}, {"value": ["left one"]})


def test_a_map_is_a_row_of_what_it_holds(tables):
    found = tables()
    row = columns(found[""])
    found_there = [row[name][0] for name in ("nframes", "camera", "K13", "dist2", "sizes1")]
    assert found_there == [13, "left one", 325, 0.5, 9]
    assert "inner" not in row and not any(name.startswith("inner") for name in row)
    assert found[""].groups["K"].shape == (2, 3)
    assert found[""].groups["dist"].shape == (4,)
    assert columns(found["inner"]) == {"depth": [7], "R1": [3]}


def test_a_problem_takes_elements_of_a_matrix(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("d.yml").write_text(FILE)
    text = """(problem p (data file (opencv "d.yml")) (data K (opencv "d.yml" "K")) (unknowns (a) (b))
      (observe file (= (K 1 3) a) :sigma 1) (observe K (= (c 2) b) :sigma 1)
      (derive (fx (first file (K 1 1))) (k (first file (dist 2)))))"""
    text = text.replace("(data K (", "(data rows (").replace("observe K", "observe rows")
    result = mbm.loads(text, base=Path()).solve()
    found = [float(result[name].value) for name in ("a", "b", "fx", "k")]
    assert found == pytest.approx([325, 262.5, 550, 0.5], rel=1e-12)  # means and constants


def test_what_opencv_writes_is_read_as_opencv_reads_it(tmp_path):
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(1)
    written = {
        "K": rng.normal(size=(3, 3)) * 1e3,
        "dist": rng.normal(size=(1, 5)),
        "single": rng.normal(size=(4, 2)).astype(np.float32),
        "whole": np.array([[1, -2, 3]], dtype=np.int32),
        "points": rng.normal(size=(6, 1, 2)).astype(np.float32),
    }
    path = tmp_path / "d.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("flags", 3)
    for name, matrix in written.items():
        storage.write(name, matrix)
    storage.startWriteStruct("outer", cv2.FILE_NODE_MAP)
    storage.write("R", written["K"])
    storage.endWriteStruct()
    storage.release()
    found = READERS["opencv"].read(path)
    reader = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    for name in written:
        there = reader.getNode(name).mat()
        here = np.column_stack(list(columns(found[name]).values()))
        np.testing.assert_array_equal(here.astype(there.dtype), there.reshape(len(there), -1), err_msg=name)
    np.testing.assert_array_equal(np.column_stack(list(columns(found["outer.R"]).values())), written["K"])
    assert columns(found["flags"]) == {"value": [3]}


def test_the_calibration_of_the_chessboard(tmp_path):
    cv2 = pytest.importorskip("cv2")
    shared = os.environ.get("MBM_SHARED")
    path = Path(shared or "", "data", "chessboard", "left_intrinsics.yml")
    if not shared or not path.exists():
        pytest.skip("MBM_SHARED is not there")
    found = READERS["opencv"].read(path)
    reader = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    for name in ("camera_matrix", "distortion_coefficients", "extrinsic_parameters", "per_view_reprojection_errors"):
        there = reader.getNode(name).mat()
        np.testing.assert_array_equal(np.column_stack(list(columns(found[name]).values())).astype(there.dtype), there)
    assert columns(found[""])["image_width"] == [640]


LAUGHS = "a0: &a0 [ 1 ]\n" + "".join(f"a{i}: &a{i} [ {', '.join([f'*a{i - 1}'] * 9)} ]\n" for i in range(1, 40))


@pytest.mark.parametrize(
    ("text", "node", "reason"),
    [
        (FILE.replace("rows: 2\n   cols: 3", "rows: 2000000000\n   cols: 3"), "K", "2000000000 rows"),
        (FILE.replace("rows: 2\n   cols: 3", "rows: -1\n   cols: 3"), "K", "states no number of `rows`"),
        (FILE.replace("dt: d\n   data: [ 5.5e+02", "dt: 9999d\n   data: [ 5.5e+02"), "K", "channels"),
        (FILE.replace("dt: d\n   data: [ 5.5e+02", "dt: x\n   data: [ 5.5e+02"), "K", "the type `dt`"),
        (FILE.replace("5.5e+02", "five"), "K", "no number"),
        (FILE.replace("5.5e+02", "1_000"), "K", "no number"),
        (FILE, "Q", "has no node `Q`"),
        (FILE, "K.rows.x", "has no node"),
        (FILE, "inner.depth.x", "has no node"),
        ("a: [ [ 1, 2 ], [ 3 ] ]\n", "a", "different lengths"),
        ("a: [ [ 1 ], 2 ]\n", "a", "no list of numbers"),
        ("a: { b: { c: 1 } }\n", "a", "holds no numbers or texts"),
        (LAUGHS, "a39", "holds something that is no number"),
        ("a: !!python/object/apply:os.system [ 'echo' ]\n", "a", "no number"),
    ],
)
def test_what_a_node_may_have_wrong(tables, text, node, reason):
    error = tables(text)[node]
    assert isinstance(error, MbmError)
    assert reason in error.diagnostics[0].message
    assert error.diagnostics[0].place.file.endswith("d.yml")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: [ 1, 2\n", "line 1"),
        ("a: 1\na: 2\n", "the key `a` stands twice"),
        ("a: *b\n", "has no anchor before it"),
        ("a: &a [ *a ]\n", "has no anchor before it"),
        ("[" * 40, "32 deep"),
        ("[" * 100_000, "line 1"),
        ("? [ 1 ]\n: 2\n", "a key is no text"),
        ("a: 1\n---\nb: 2\n", "more than one document"),
        ("# nothing\n", "it holds nothing"),
        ("a: \x07\n", "line"),
        ("a: 1\n\t- b\n", "line 2"),
    ],
)
def test_what_is_no_yaml(tables, text, reason):
    with pytest.raises(MbmError) as caught:
        tables(text)
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "malformed-yaml"
    assert reason in fault.message or reason == "line"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(data=st.data())
def test_whatever_a_file_holds(tmp_path, data):
    content = bytearray(FILE.encode())
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "d.yml"
    path.write_bytes(data.draw(st.sampled_from([bytes(content), bytes(content[: len(content) // 2])]) | st.binary()))
    for reader, nodes in ((READERS["opencv"], ("", "K", "dist", "inner")), (READERS["kalibr"], ("cameras",))):
        try:
            found = reader.read(path)
        except MbmError as error:
            assert all(fault.place.file == path.as_posix() for fault in error.diagnostics)
            continue
        for node in nodes:
            if not isinstance(found[node], MbmError):
                assert {len(cells) for cells in columns(found[node]).values()} == {len(found[node].file_rows)}


def test_the_form_takes_a_path_and_a_node(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("d.yml").write_text(FILE)
    for source in ('(opencv "d.yml" :K)', '(opencv "d.yml" "K" "R")', "(opencv)", "(opencv K)"):
        Path("p.mbm").write_text(f"(problem p (data d {source}) (unknowns (a)) (observe d (= c1 a)))")
        assert run(["check", "p.mbm"]) == 2
        assert "error[bad-form]" in capsys.readouterr().err
    Path("p.mbm").write_text('(problem p (data d (opencv "d.yml" "KK")) (unknowns (a)) (observe d (= c1 a)))')
    assert run(["check", "p.mbm"]) == 2
    assert "did you mean `K`" in capsys.readouterr().err
