"""CSV and TSV: what is a number, a text, a gap; how cells and rows are told apart; which row is named."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mbm.data.readers import READERS
from mbm.data.readers.delimited import plain_columns


def read(folder: Path, content: str | bytes, ending: str = "csv"):
    path = folder / f"d.{ending}"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return READERS[ending].read(path)


def cells(raw) -> dict[str, list]:
    return {c.name: list(c.texts) if c.texts is not None else c.numbers.tolist() for c in raw.columns}


def test_numbers_texts_and_their_rows(tmp_path):
    raw = read(tmp_path, "path,X\nboard/vertex/1,203.6\nleg1/origin,-192.5\n")
    assert cells(raw) == {"path": ["board/vertex/1", "leg1/origin"], "X": [203.6, -192.5]}
    assert raw.file_rows.tolist() == [2, 3]
    assert raw.path == (tmp_path / "d.csv").as_posix()


def test_the_digest_is_that_of_the_bytes_of_the_file(tmp_path):
    content = b"\xef\xbb\xbfx\r\n1\r\n"
    assert read(tmp_path, content).sha256 == hashlib.sha256(content).hexdigest()


@pytest.mark.parametrize(
    "content",
    [
        "a,b\n1,2\n3,4\n",
        "a,b\n1,2\n3,4",
        "a,b\r\n1,2\r\n3,4\r\n",
        "a,b\r1,2\r3,4\r",
        "\ufeffa,b\n1,2\n3,4\n",
        " a , b\n 1, 2\n3 ,4 \n",
        "a,b\n1,2\n3,4\n\n\n",
        "a,b\n1,2\n3,4\n   \n\r\n",
        '"a","b"\n"1","2"\n3,4\n',
        'a, "b"\n1, "2"\n3,4\n',
    ],
)
def test_layout_does_not_matter(tmp_path, content):
    raw = read(tmp_path, content)
    assert cells(raw) == {"a": [1.0, 3.0], "b": [2.0, 4.0]}
    assert raw.file_rows.tolist() == [2, 3]


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("5", 5.0),
        ("+5", 5.0),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("2.5e-3", 0.0025),
        ("1E3", 1000.0),
        ("007", 7.0),
        ("0.1", 0.1),
        ("inf", math.inf),
        ("-Infinity", -math.inf),
        ("1e999", math.inf),
        ("1e-999", 0.0),
    ],
)
@pytest.mark.parametrize("quote", ["", '"'])  # quotes take the general way through the reader
def test_numbers(tmp_path, cell, value, quote):
    assert cells(read(tmp_path, f"x,y\n{quote}{cell}{quote},1\n"))["x"] == [value]


@pytest.mark.parametrize(
    "cell", ["1_000", "0x10", "1e", "5mm", "1.5.2", "1d5", "٣", "１", "--1", "1 000", "true", "1/3", "#N/A", "1j", "e"]
)
@pytest.mark.parametrize("quote", ["", '"'])
def test_texts(tmp_path, cell, quote):
    assert cells(read(tmp_path, f"x,y\n{quote}{cell}{quote},1\n2,1\n"))["x"] == [cell, "2"]


@pytest.mark.parametrize("cell", ["", "  ", "nan", "NaN", "NAN", "-nan", "NA", " NA "])
@pytest.mark.parametrize("quote", ["", '"'])
def test_gaps_among_numbers_are_nan(tmp_path, cell, quote):
    raw = read(tmp_path, f"x,y\n1,2\n{quote}{cell}{quote},3\n")
    assert raw.columns[0].numbers[0] == 1.0
    assert math.isnan(raw.columns[0].numbers[1])


def test_gaps_among_texts_stay_texts(tmp_path):
    assert cells(read(tmp_path, "x,y\nred,1\n,2\nNA,3\n"))["x"] == ["red", "", "NA"]


def test_a_column_of_gaps_is_one_of_numbers(tmp_path):
    raw = read(tmp_path, "x,y\n,1\n,2\n")
    assert np.isnan(raw.columns[0].numbers).all()


def test_a_header_alone_is_a_table_without_rows(tmp_path):
    for content in ("x,y", "x,y\n", "x,y\r\n\r\n", '"x","y"\n'):
        raw = read(tmp_path, content)
        assert cells(raw) == {"x": [], "y": []}
        assert len(raw.file_rows) == 0


def test_quotes_hold_separators_quotes_and_line_breaks(tmp_path):
    raw = read(tmp_path, 'name,v\n"a, b",1\n"5"" pipe",2\n"two\nlines",3\nlast,4\n')
    assert cells(raw)["name"] == ["a, b", '5" pipe', "two\nlines", "last"]
    assert raw.file_rows.tolist() == [2, 3, 4, 5]  # rows of cells, as a spreadsheet shows them


def test_a_key_may_start_with_a_number_sign(tmp_path):
    assert cells(read(tmp_path, "tag,x\n#1,2\n#2,3\n"))["tag"] == ["#1", "#2"]


def test_tabs(tmp_path):
    raw = read(tmp_path, "name\tx\ty\na, b\t1\t\nc\t2\t3\n", "tsv")
    assert cells(raw)["name"] == ["a, b", "c"]
    assert math.isnan(raw.columns[2].numbers[0])
    assert raw.columns[2].numbers[1] == 3.0


def test_an_empty_last_cell_of_a_last_row_of_tabs_is_kept(tmp_path):
    raw = read(tmp_path, "x\ty\n1\t2\n3\t\n", "tsv")
    assert math.isnan(raw.columns[1].numbers[1])


def test_numbers_are_read_only(tmp_path):
    numbers = read(tmp_path, "x\n1\n").columns[0].numbers
    with pytest.raises(ValueError, match="read-only"):
        numbers[0] = 2.0


def test_more_rows_than_are_split_at_once(tmp_path):
    content = "n,name\n" + "".join(f"{i},t{i}\n" for i in range(1234))
    raw = read(tmp_path, content)
    assert cells(raw) == {"n": [float(i) for i in range(1234)], "name": [f"t{i}" for i in range(1234)]}


NUMBERS = st.floats(allow_nan=False)
TEXTS = st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1).map(str.strip).filter(bool)


@given(st.data())
def test_what_the_csv_module_writes_is_read_back(tmp_path_factory, data):
    rows = data.draw(st.integers(1, 6))
    names = data.draw(st.lists(st.sampled_from("abcdefgh"), min_size=1, max_size=4, unique=True))
    numeric = data.draw(st.lists(st.booleans(), min_size=len(names), max_size=len(names)))
    one = lambda strategy: data.draw(st.lists(strategy, min_size=rows, max_size=rows))  # noqa: E731
    # a letter in front keeps a text from reading as a number or as a gap
    table = [one(NUMBERS) if is_numeric else [f"t{t}" for t in one(TEXTS)] for is_numeric in numeric]
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow(names)
    writer.writerows(zip(*table, strict=True))
    raw = read(tmp_path_factory.mktemp("csv"), stream.getvalue())
    assert cells(raw) == dict(zip(names, table, strict=True))  # repr of a float reads back to the same float


@given(
    st.lists(
        st.lists(st.text("0123456789.-+eEinfaNA_x \t", max_size=6), min_size=2, max_size=2), min_size=1, max_size=4
    )
)
def test_the_fast_way_and_the_general_way_agree(tmp_path_factory, rows):
    lines = [",".join(row) for row in rows]
    if any(not line.strip(", \t") for line in lines):  # blank rows are another test
        return
    folder = tmp_path_factory.mktemp("csv")
    fast = read(folder, "\n".join(["x,y", *lines]))
    general = read(folder, "\n".join(['"x",y', *lines]))  # a quote rules out the fast way
    for a, b in zip(fast.columns, general.columns, strict=True):
        assert a.texts == b.texts
        np.testing.assert_array_equal(a.numbers, b.numbers)


def test_columns_that_become_texts_are_told_beforehand():
    told = []
    columns = plain_columns(b"1,ab,x\n2,cd,y\n3,ef,z", (0, 20), ",", ["n", "t", "u"], told.append)
    assert told == [3 * 2]
    assert [column.texts for column in columns] == [None, ("ab", "cd", "ef"), ("x", "y", "z")]
