"""What is said of faults in formats with a fixed layout, and of packed files: the code, the line and the words."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

import mbm
from mbm.data.readers import READERS
from mbm.data.types import ManyReader
from mbm.text.types import MbmError

POSE = "1 1 2 3 0 0 0 1\n"
INFORMATION = " 1 0 0 1 0 1\n"
EDGE = f"EDGE_SE2 0 1 1 0 0{INFORMATION}"
CASES = [
    ("short-row", "tum", f"{POSE}2 1 2\n", 2, "z", "row 2 has 3 cells, but there are 8 columns"),
    ("long-row", "tum", f"# t\n{POSE.strip()} 9\n", 2, None, "row 2 has 9 cells"),
    ("short-row", "tum", f"# a\u2028b\n{POSE}2 1\x0c2\n", 3, "z", "row 3 has 3 cells"),
    ("short-row", "tum", f"{POSE.strip()}\r{POSE.strip()}\r\n2 1\x1c2\x85\n", 3, "z", "row 3 has 3 cells"),
    ("malformed-record", "tum", f"{POSE}2 1 2 3 0 0 zero 1\n", 2, "qz", "`qz` is `zero`, no number"),
    ("malformed-record", "tum", f"{POSE}2 1 2 3 0 0 1_0 1\n", 2, "qz", "`qz` is `1_0`, no number"),
    ("short-row", "kitti", "1 0 0 0 0 1 0 0 0 0 1\n", 1, "t3", "row 1 has 11 cells"),
    ("malformed-record", "kitti", "1 0 0 0 0 1 0 0 0 0 2 0\n", 1, None, "no rotation matrix"),
    ("malformed-record", "kitti", "1 0 0 0 0 1 0 0 0 0 -1 0\n", 1, None, "no rotation matrix"),
    ("malformed-record", "euroc", "x,1,2,3,1,0,0,0\n", 1, "timestamp", "`timestamp` is `x`, no number"),
    ("malformed-record", "euroc", "inf,1,2,3,1,0,0,0\n", 1, None, "`timestamp` is not finite"),
    ("malformed-record", "euroc", "nan,1,2,3,1,0,0,0\n", 1, None, "`timestamp` is not finite"),
    ("malformed-record", "euroc", "1403636579.763555584,1,2,3,1,0,0,0\n", 1, None, "579.763555584, no whole number"),
    ("malformed-record", "bal:points", "1 1\n", 1, None, "begins with the numbers of cameras, points"),
    ("malformed-record", "bal:points", "1 1 1\n0 0 1 x\n", 2, None, "`x` is no number"),
    ("malformed-record", "bal:points", "1 1 1\n0 0 1 2\n", None, None, "7 numbers where its first line announces 19"),
    ("malformed-record", "bal:points", "0 0 1\n3 0 1 2\n", 2, "camera", "there is no camera 3"),
    ("malformed-record", "g2o:edges", "EDGE_SE2_XY 0 1 2 3 1 0 1\n", 1, None, "`EDGE_SE2_XY` is no kind of line"),
    ("malformed-record", "g2o:edges", f"EDGE_SE2 0 1.5 1 0 0{INFORMATION}", 1, "to", "`to` is 1.5, no whole number"),
    ("malformed-record", "g2o:vertices", "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 0\n", 1, None, "has the length 0, not 1"),
    ("short-row", "g2o:edges", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0\n", 1, "information entry 6", "row 1 has 10 cells"),
    ("mixed-records", "g2o:edges", f"{EDGE}VERTEX3 0 1 2 3 0 0 0\n", 2, None, "`VERTEX3`, line 1 a"),
    ("no-records", "g2o:edges", "VERTEX_SE2 0 0 0 0\n", None, None, "holds no edges"),
    ("no-records", "g2o:vertices", "# nothing\n", None, None, "holds no vertices"),
    ("malformed-parquet", "parquet", "PAR1 and no more", None, None, "is no Parquet file"),
]  # fmt: skip


@pytest.mark.parametrize(("code", "source", "content", "row", "column", "words"), CASES)
def test_faults_in_records(tmp_path, code, source, content, row, column, words):
    name, _, part = source.partition(":")
    reader = READERS[name]
    path = tmp_path / "d"
    path.write_text(content)
    with pytest.raises(MbmError) as caught:
        (reader.part(part) if isinstance(reader, ManyReader) else reader).read(path)
    fault = caught.value.diagnostics[0]
    assert fault.code.name == code
    assert fault.place.file == path.as_posix()
    assert (fault.place.row, fault.place.column) == (row, column)
    assert words in fault.message


@pytest.mark.parametrize("ending", ["gz", "bz2", "xz"])
@pytest.mark.parametrize("content", [b"t x y z", gzip.compress(POSE.encode(), mtime=0)[:-6]])
def test_what_does_not_unpack_is_a_damaged_archive(tmp_path, ending, content):
    path = tmp_path / f"d.tum.{ending}"
    path.write_bytes(content)
    with pytest.raises(MbmError) as caught:
        READERS["tum"].read(path)
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.place.file) == ("damaged-archive", path.as_posix())


def test_an_archive_of_nothing_is_empty(tmp_path):
    path = tmp_path / "d.tum.gz"
    path.write_bytes(gzip.compress(b""))
    with pytest.raises(MbmError, match="is empty"):
        READERS["tum"].read(path)


def test_what_is_wrong_with_a_file_of_two_tables_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_text("FOO 1 2\n")
    (tmp_path / "p.mbm").write_text("""(problem p
      (data nodes (g2o "graph.g2o" :vertices)) (data edges (g2o "graph.g2o" :edges))
      (unknowns (T (pose 2) :per nodes :init (pose2 x y theta)))
      (observe edges (= (pose2 dx dy dtheta) (between (T from) (T to))) :information information))""")
    with pytest.raises(MbmError) as error:
        mbm.load(tmp_path / "p.mbm").solve()
    assert [d.code.name for d in error.value.diagnostics] == ["malformed-record"]
