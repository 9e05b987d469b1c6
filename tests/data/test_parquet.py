"""Parquet files, and what is said where pyarrow is not installed."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from mbm.data.readers import READERS
from mbm.text.types import MbmError

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


def test_numbers_texts_and_gaps(tmp_path):
    path = tmp_path / "d.parquet"
    columns = {"x": pa.array([1.5, None, 3.0]), "n": pa.array([1, 2, None], pa.int32()), "name": ["a", "b", "c"]}
    columns["ok"] = pa.array([True, None, False])
    parquet.write_table(pa.table(columns), path)
    x, n, name, ok = READERS["parquet"].read(path).columns
    np.testing.assert_array_equal(x.numbers, [1.5, np.nan, 3])
    np.testing.assert_array_equal(n.numbers, [1, 2, np.nan])
    assert name.texts == ("a", "b", "c")
    np.testing.assert_array_equal(ok.numbers, [1, np.nan, 0])


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    path = tmp_path / "d.parquet"
    path.write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MbmError) as caught:
        READERS["parquet"].read(path)
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.hint) == ("missing-extra", 'install them with `pip install "mbm[tables]"`')


DAMAGED = """
import sys
from pathlib import Path
from mbm.data.readers.parquet import read
from mbm.text.types import MbmError

whole, file = Path(sys.argv[1]).read_bytes(), Path(sys.argv[2])
footer = int.from_bytes(whole[-8:-4], "little")
for place in range(len(whole) - 8 - footer, len(whole)):
    for change in (1, 4, 128):
        file.write_bytes(whole[:place] + bytes([(whole[place] + change) % 256]) + whole[place + 1 :])
        try:
            read(file)
        except MbmError:
            pass
print("to the end")
"""


def test_no_damage_to_a_footer_ends_the_process(tmp_path):
    """Each byte of the metadata is changed in turn: tables or diagnostics, and no exception that nobody catches."""
    table = pa.table({"x": [1.0, 2.0, 3.0], "name": ["a", "b", None]})
    parquet.write_table(table, tmp_path / "whole.parquet")
    command = [sys.executable, "-c", DAMAGED, str(tmp_path / "whole.parquet"), str(tmp_path / "damaged.parquet")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "to the end"), done.stderr
