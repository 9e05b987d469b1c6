"""npz: arrays as columns, whatever their type of number."""

from __future__ import annotations

import hashlib
import zipfile

import numpy as np
import pytest

from mbm.cli.main import run
from mbm.data.readers import READERS


def read(folder, **arrays):
    np.savez(folder / "d.npz", **arrays)
    return READERS["npz"].read(folder / "d.npz")


def test_arrays_are_columns(tmp_path):
    raw = read(tmp_path, x=np.array([1.5, np.nan]), name=np.array(["a", "bc"]))
    assert [column.name for column in raw.columns] == ["x", "name"]
    np.testing.assert_array_equal(raw.columns[0].numbers, [1.5, np.nan])
    assert raw.columns[1].texts == ("a", "bc")
    assert raw.file_rows.tolist() == [1, 2]
    assert raw.sha256 == hashlib.sha256((tmp_path / "d.npz").read_bytes()).hexdigest()


@pytest.mark.parametrize("kind", ["i1", "u2", "<i4", ">i8", "f2", ">f4", "f8", "longdouble"])
def test_every_type_of_real_number_becomes_float64(tmp_path, kind):
    numbers = read(tmp_path, x=np.array([1, 2, 3], dtype=kind)).columns[0].numbers
    assert numbers.dtype == np.float64
    assert numbers.tolist() == [1.0, 2.0, 3.0]


def test_truth_values_are_one_and_zero(tmp_path):
    assert read(tmp_path, x=np.array([True, False])).columns[0].numbers.tolist() == [1.0, 0.0]


def test_compressed_archives(tmp_path):
    np.savez_compressed(tmp_path / "d.npz", x=np.arange(3.0))
    assert READERS["npz"].read(tmp_path / "d.npz").columns[0].numbers.tolist() == [0.0, 1.0, 2.0]


def test_no_rows(tmp_path):
    assert len(read(tmp_path, x=np.zeros(0)).file_rows) == 0


def test_a_shape_beyond_all_numbers_is_told_by_a_diagnostic_alone(tmp_path, capfd):
    """NumPy warns of it as well: an error in tests, and words aside for users."""
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 9223372036854775808), }".ljust(117) + "\n"
    with zipfile.ZipFile(tmp_path / "d.npz", "w") as archive:
        archive.writestr(
            "y.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(24)
        )
    text = '(problem p (data d (npz "d.npz")) (unknowns (a :init 1)) (observe d (= y a) :sigma 1))'
    (tmp_path / "p.mbm").write_text(text)
    assert run(["check", str(tmp_path / "p.mbm")]) == 2
    assert capfd.readouterr().err.startswith("error[malformed-npz]")
