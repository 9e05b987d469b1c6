"""Whatever bytes a file holds: a table or an MbmError, nothing else."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from mbm.data.cells import column_length
from mbm.data.readers import READERS
from mbm.data.shaping import table_from_given
from mbm.text.types import MbmError


def outcome(reader, path, content):
    """The reader's answer to bytes: every column as long as the table, or diagnostics that have a place."""
    path.write_bytes(content)
    try:
        raw = reader.read(path)
    except MbmError as error:
        assert error.diagnostics
        assert all(fault.place is not None and fault.place.file == path.as_posix() for fault in error.diagnostics)
        return
    assert {column_length(column) for column in raw.columns} == {len(raw.file_rows)}


@pytest.fixture(
    params=[
        "csv",
        "tsv",
        "json",
        "npz",
        "parquet",
        "tum",
        "kitti",
        "euroc",
        "bal:cameras",
        "g2o:vertices",
        "g2o:edges",
        "bundler:observations",
    ]
)
def reader(request):
    name, _, part = request.param.partition(":")
    return READERS[name].part(part) if part else READERS[name]


SHARED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)


@SHARED
@given(content=st.binary(max_size=200))
def test_any_bytes(reader, tmp_path, content):
    outcome(reader, tmp_path / "fuzz", content)


@SHARED
@given(content=st.text('abx019.-+eE,;\t\n\r"# \ufeffnN{}[]:', max_size=80))
def test_any_text_of_the_characters_that_matter(reader, tmp_path, content):
    outcome(reader, tmp_path / "fuzz", content.encode())


TAGS = st.sampled_from(
    ["VERTEX_SE2", "EDGE_SE2", "VERTEX3", "EDGE_SE3:QUAT", "FIX", "EDGE2", "1", "0.5", "nan", "1e999"]
)


@SHARED
@given(words=st.lists(TAGS | st.sampled_from(["\n", "0", "1", "2", "3"]), max_size=40))
def test_any_line_of_records(reader, tmp_path, words):
    outcome(reader, tmp_path / "fuzz", " ".join(words).encode())


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["x", "data", "columns", "index"]), inner)
    ),
    max_leaves=20,
)


@SHARED
@given(content=VALUES)
def test_any_json(tmp_path, content):
    outcome(READERS["json"], tmp_path / "fuzz", json.dumps(content).encode())


def archive() -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, x=np.arange(20.0), name=np.array(["a"] * 20))
    return stream.getvalue()


ARCHIVE = archive()


@pytest.mark.filterwarnings("ignore")  # NumPy warns of headers as Python 2 wrote them
@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=st.lists(st.tuples(st.integers(0, len(ARCHIVE) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_archives(tmp_path, changes):
    content = bytearray(ARCHIVE)
    for position, byte in changes:
        content[position] = byte
    outcome(READERS["npz"], tmp_path / "fuzz", bytes(content))


def npy_archive(header: bytes) -> bytes:
    import zipfile

    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr("x.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    return stream.getvalue()


@pytest.mark.filterwarnings("ignore")
@SHARED
@given(
    descr=st.sampled_from(["'<f8'", "'|O'", "'<U3'", "'|V0'", "'zz'", "('<f8', (2,))", "[('a', '<f8')]", "3", "("]),
    shape=st.sampled_from(["(0,)", "()", "(-1,)", "(99999999999999999999,)", "(True,)", "(2, 0)", "5", "('a',)", "L"]),
)
def test_damaged_headers_of_arrays(tmp_path, descr, shape):
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    outcome(READERS["npz"], tmp_path / "fuzz", npy_archive(header))


@SHARED
@given(table=VALUES)
def test_any_python_value(table):
    try:
        raw = table_from_given("d", table)
    except MbmError as error:
        assert all(fault.place.file == "<d>" for fault in error.diagnostics)
    else:
        assert {column_length(column) for column in raw.columns} == {len(raw.file_rows)}
