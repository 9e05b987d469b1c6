"""Trajectories: TUM, KITTI and EuRoC files give the same columns, whatever their own order and units are."""

from __future__ import annotations

import bz2
import gzip
import lzma
from hashlib import sha256

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbm.data.loader import load
from mbm.data.readers import READERS

POSE = ["t", "x", "y", "z", "qx", "qy", "qz", "qw"]


def columns(table):
    return {column.name: column.numbers.tolist() for column in table.columns}


def read(name, folder, text):
    path = folder / f"d.{name}"
    path.write_text(text)
    return READERS[name].read(path)


def test_tum_keeps_every_number_and_the_lines(tmp_path):
    table = read("tum", tmp_path, "# t tx ty tz qx qy qz qw\n\n1.5 1 2 3 0 0 0.6 0.8\n  2.5\t4 5 6 0 0 0 1\n")
    assert columns(table) == {
        "t": [1.5, 2.5], "x": [1, 4], "y": [2, 5], "z": [3, 6],
        "qx": [0, 0], "qy": [0, 0], "qz": [0.6, 0], "qw": [0.8, 1],
    }  # fmt: skip
    assert table.file_rows.tolist() == [3, 4]


def test_kitti_matrices_become_quaternions(tmp_path):
    turns = Rotation.random(40, random_state=3)
    half_turns = Rotation.from_matrix([np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1]), np.eye(3)])
    turns = Rotation.concatenate([turns, half_turns])
    places = np.arange(3.0 * len(turns)).reshape(-1, 3)
    rows = np.concatenate([turns.as_matrix(), places[:, :, None]], axis=2).reshape(-1, 12)
    table = read("kitti", tmp_path, "\n".join(" ".join(repr(float(n)) for n in row) for row in rows))
    found = columns(table)
    assert list(found) == POSE
    assert found["t"] == list(range(len(turns)))
    np.testing.assert_array_equal(np.column_stack([found[n] for n in "xyz"]), places)
    quaternions = np.column_stack([found[n] for n in POSE[4:]])
    # Matrices written with all digits: what is left is rounding.
    np.testing.assert_allclose(Rotation.from_quat(quaternions).as_matrix(), turns.as_matrix(), atol=1e-15)
    assert (quaternions[:, 3] >= 0).all()


def test_euroc_is_read_in_seconds_with_the_real_part_last(tmp_path):
    header = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
    motion = ",vx,vy,vz,bwx,bwy,bwz,bax,bay,baz"
    line = "1403636580838555648,4.6,-1.7,0.7,0.8,0.1,0.2,0.3"
    table = read("euroc", tmp_path, f"{header}{motion}\n{line},1,2,3,4,5,6,7,8,9\n")
    found = columns(table)
    # The nearest float to the seconds: 19 digits of nanoseconds do not fit one.
    assert found["t"] == [1403636580.838555648]
    assert [found[n][0] for n in POSE[1:]] == [4.6, -1.7, 0.7, 0.1, 0.2, 0.3, 0.8]
    assert [found[n][0] for n in motion[1:].split(",")] == list(range(1, 10))
    assert list(columns(read("euroc", tmp_path, f"{header}\n{line}\n"))) == POSE


@pytest.mark.parametrize(
    ("stamp", "seconds"),
    [
        ("1403636580838555648", 1403636580.838555648),
        ("1403636580838555648.000", 1403636580.838555648),
        ("1.403636580838555648e18", 1403636580.838555648),
        ("-1500000000", -1.5),
        ("1", 1e-9),
        ("0", 0.0),
    ],
)
def test_whole_nanoseconds_are_read_however_they_are_written(tmp_path, stamp, seconds):
    found = columns(read("euroc", tmp_path, f"{stamp},1,2,3,1,0,0,0\n"))
    # A stamp written as a float has 53 bits, of nanoseconds and then of seconds.
    assert found["t"] == [pytest.approx(seconds, rel=2.3e-16)]


@pytest.mark.parametrize("blank", [" ", "\t", "\x1c", "\x1f", "\x85", "\u2003", "\u2028"])
def test_blanks_of_any_kind_around_a_number_are_none_of_it(tmp_path, blank):
    """They were no number for the whole file and one for each of its cells: an error that said nothing."""
    found = columns(read("euroc", tmp_path, f"1500000000{blank},{blank}1,2,3,1,0,0,0\n"))
    assert (found["t"], found["x"]) == ([1.5], [1.0])


@pytest.mark.parametrize(("ending", "pack"), [("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress)])
def test_packed_files_are_read_as_they_are(tmp_path, ending, pack):
    text = "1 1 2 3 0 0 0 1\n"
    path = tmp_path / f"d.tum.{ending}"
    path.write_bytes(pack(text.encode()))
    table = READERS["tum"].read(path)
    assert columns(table) == columns(read("tum", tmp_path, text))
    assert table.sha256 == sha256(path.read_bytes()).hexdigest()


def test_a_packed_table_is_told_by_the_ending_before(tmp_path, declare):
    path = tmp_path / "d.tsv.gz"
    path.write_bytes(gzip.compress(b"x\ty\n1\t2\n"))
    declaration = declare("external", None)
    table = load(declaration, base=tmp_path, given={}, paths={"d": str(path)}, sandbox=None, readers=READERS)
    assert table.numbers("y").tolist() == [2]
