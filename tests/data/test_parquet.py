"""Parquet files, and what is said where pyarrow is not installed."""

from __future__ import annotations

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
    parquet.write_table(pa.table(columns), path)
    x, n, name = READERS["parquet"].read(path).columns
    np.testing.assert_array_equal(x.numbers, [1.5, np.nan, 3])
    np.testing.assert_array_equal(n.numbers, [1, 2, np.nan])
    assert name.texts == ("a", "b", "c")


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    path = tmp_path / "d.parquet"
    path.write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MbmError) as caught:
        READERS["parquet"].read(path)
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.hint) == ("missing-extra", 'install them with `pip install "mbm[tables]"`')
