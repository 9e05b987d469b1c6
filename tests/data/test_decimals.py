"""Decimal numbers read from bytes are those that ``float`` reads, to the last bit."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mbm.data.readers.delimited import AT_ONCE, decimals


def read(cells):
    content = np.frombuffer(",".join(cells).encode("ascii"), dtype=np.uint8)
    stops = np.cumsum([len(cell) + 1 for cell in cells]) - 1
    return decimals(content, stops - [len(cell) for cell in cells], stops)


def bits(number):
    return struct.pack("<d", number)


@given(
    cells=st.lists(
        st.from_regex(r"[+-]?([0-9]{1,9}(\.[0-9]{0,6})?|\.[0-9]{1,9})", fullmatch=True), min_size=1, max_size=30
    )
)
def test_plain_decimals_are_read_to_the_last_bit(cells):
    found = read(cells)
    assert found is not None
    assert [bits(x) for x in found.tolist()] == [bits(float(cell)) for cell in cells]


@given(text=st.text(alphabet="0123456789+-.eE _x", max_size=20))
def test_whatever_is_read_is_what_float_reads(text):
    found = read(["1", text])
    if found is not None:
        assert bits(found[1]) == bits(float(text))
        assert "_" not in text


@pytest.mark.parametrize(
    "cell", ["", ".", "-", "+-1", "1-", "1..2", "1.2.3", "1e3", "nan", "inf", " 1", "1 ", "0x1", "1234567890123456"]
)
def test_what_is_written_in_another_way_is_left_to_others(cell):
    assert read(["1", cell]) is None


def test_more_cells_than_are_read_together():
    numbers = np.round(np.random.default_rng(1).uniform(-1e4, 1e4, 2 * AT_ONCE + 3), 5)
    cells = [f"{x:.5f}" for x in numbers]
    np.testing.assert_array_equal(read(cells), [float(cell) for cell in cells])
