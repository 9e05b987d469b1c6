"""Every diagnostic of the data stage: what calls it forth, the place it names and what it says."""

from __future__ import annotations

import ast
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mbm.data import faults as table_faults
from mbm.data.loader import load, load_all
from mbm.data.readers import READERS, faults as format_faults
from mbm.text.faults import MOST_FAULTS
from mbm.text.types import Code, DataPlace

CODES = {
    code.name for module in (table_faults, format_faults) for code in vars(module).values() if isinstance(code, Code)
}

# code, format, content, row, column, what the message says
IN_FILES = [
    ("empty-file", "csv", b"", None, None, "is empty"),
    ("empty-file", "csv", b" \n\r\n\t\n", None, None, "is empty"),
    ("empty-file", "csv", b"\xef\xbb\xbf", None, None, "is empty"),
    ("empty-file", "json", b"", None, None, "is empty"),
    ("empty-file", "npz", b"", None, None, "is empty"),
    ("not-text", "csv", b"x,y\n1,2\n3,\0\n", 3, None, "in row 3 it holds NUL bytes"),
    ("not-text", "csv", "x,y\n1,2\n".encode("utf-16"), 1, None, "UTF-16"),
    ("not-text", "csv", "x,w\n1,2\n3,20°\n".encode("latin-1"), 3, None, "byte 0xb0 is not UTF-8"),
    ("not-text", "csv", b"\xef\xbb\xbfx\n\xff\n", 2, None, "byte 0xff"),
    ("not-text", "json", b"\x89PNG\r\n\x1a\n\0", 3, None, "NUL"),
    ("missing-header", "csv", b"1,2\n3,4\n", 1, None, "holds only numbers"),
    ("missing-header", "tsv", b"1.5\t-2e3\n3\t4\n", 1, None, "holds only numbers"),
    ("missing-header", "csv", b"\nx,y\n1,2\n", 1, None, "is blank"),
    ("wrong-separator", "csv", b"x;y\n1,5;2\n", 1, None, "semicolons, where commas"),
    ("wrong-separator", "tsv", b"x,y\n1,2\n", 1, None, "commas, where tabulators"),
    ("comment-line", "csv", b"# x,y\n1,2\n", 1, None, "row 1 starts with `#`"),
    ("comment-line", "csv", b"x,y\n1,2\n# all\n3,4\n", 3, None, "row 3 starts with `#`"),
    ("short-row", "csv", b"x,y,z\n1,2,3\n4,5\n", 3, "z", "row 3 has 2 cells, but there are 3 columns"),
    ("short-row", "csv", b"x,y\n1,2\n\n3,4\n", 3, None, "row 3 is blank"),
    ("short-row", "csv", b"x\n1\n\n3\n", 3, None, "row 3 is blank"),
    ("short-row", "json", b'{"columns": ["x", "y"], "data": [[1, 2], [3]]}', 2, None, "row 2 has 1 cells"),
    ("long-row", "csv", b"x,y\n1,2\n3,4,5\n", 3, None, "row 3 has 3 cells, but there are only 2 columns"),
    ("long-row", "csv", b"x\n1\n2,3\n", 3, None, "row 3 has 2 cells"),
    ("long-row", "json", b'{"columns": ["x"], "data": [[1, 2]]}', 1, None, "row 1 has 2 cells"),
    ("bad-quotes", "csv", b'x,y\n1,2\n"3,4\n5,6\n', 3, None, "row 3 cannot be split"),
    ("bad-quotes", "csv", b'x,y\n"3"4,5\n', 2, None, "row 2 cannot be split"),
    ("bad-quotes", "csv", b"x,y\n1," + b"2" * 200_000 + b"z\n", 2, None, "row 2 cannot be split"),
    ("bad-quotes", "csv", b"x" * 200_000 + b"\n1\n", 1, None, "row 1 cannot be split"),
    ("bad-column-name", "csv", b'"","x"\n"1",2\n', 1, None, "column 1 has no name"),
    ("bad-column-name", "csv", b"x,y,\n1,2,3\n", 1, None, "column 3 has no name"),
    ("bad-column-name", "json", b'{"columns": ["x", 3], "data": []}', None, None, "column 2 is called 3"),
    ("duplicate-column", "csv", b"x,y, x\n1,2,3\n", 1, None, "two columns are called `x`"),
    ("duplicate-column", "json", b'[{"x": 1, "x": 2}]', None, None, "two columns are called `x`"),
    ("no-columns", "json", b"[]", None, None, "no columns"),
    ("no-columns", "json", b"[{}, {}]", None, None, "no columns"),
    ("malformed-json", "json", b'[{"x": 1},\n {"x" 2}]', 2, None, "line 2, column 7"),
    ("malformed-json", "json", b"[" * 100_000, None, None, "nested too deeply"),
    ("malformed-json", "json", b'{"x": [' + b"1" * 5000 + b"]}", None, None, "digits"),
    ("malformed-json", "json", rb'{"x": ["\ud83d"]}', None, None, "half a character"),
    ("malformed-json", "json", rb'{"\uDE00": [1]}', None, None, "half a character"),
    ("wrong-json-shape", "json", b"3", None, None, "a single value"),
    ("wrong-json-shape", "json", b'[{"x": 1}, 2]', 2, None, "item 2 of the list is not an object"),
    ("wrong-json-shape", "json", b'{"x": 1}', None, "x", "`x` is not an array"),
    ("wrong-json-shape", "json", b'{"columns": 3, "data": []}', None, None, "`columns` is not an array"),
    ("bad-cell", "json", b'{"x": [1, true]}', 2, "x", "row 2, column `x` holds the truth value `true`"),
    ("bad-cell", "json", b'[{"x": 1}, {"x": [2]}]', 2, "x", "a value of type `list`"),
    ("unequal-lengths", "json", b'{"x": [1, 2], "y": [3]}', None, None, "`y` has 1 cells, column `x` has 2"),
    ("malformed-npz", "npz", b"PK\x03\x04 not an archive", None, None, "no archive"),
    ("malformed-npz", "npz", b"\x93NUMPY", None, None, "no archive"),
]


@pytest.mark.parametrize(("code", "source", "content", "row", "column", "words"), IN_FILES)
def test_faults_in_files(load_text, faults_of, code, source, content, row, column, words):
    first = faults_of(load_text, content, source)[0]
    assert first.code.name == code
    assert isinstance(first.place, DataPlace)
    assert first.place.file.endswith(f"/d.{source}")
    assert (first.place.row, first.place.column) == (row, column)
    assert words in first.message
    assert [label.message for label in first.labels] == ["table `d` is declared here"]


def test_the_first_few_bad_rows_are_reported_together(load_text, faults_of):
    found = faults_of(load_text, "x,y\n1\n1,2\n1,2,3\n#\n" + "1\n" * 9)
    assert [(fault.code.name, fault.place.row) for fault in found] == [
        ("short-row", 2),
        ("long-row", 4),
        ("comment-line", 5),
        ("short-row", 6),
        ("short-row", 7),
    ]


def npz(**arrays) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def archive(name: str, content: bytes, method: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file:
        file.writestr(name, content)
    return stream.getvalue()


def npy(header: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header


@pytest.mark.parametrize(
    ("code", "content", "words"),
    [
        ("malformed-npz", npz(x=np.arange(9.0))[:-40], "no archive"),
        ("malformed-npz", archive("x.txt", b"1 2 3"), "`x.txt` in it is no array"),
        ("malformed-npz", archive("x.npy", b"1 2 3"), "`x` is damaged"),
        ("malformed-npz", archive("x.npy", npy(b"{'descr': '<f8', 'shape': (9,)}")), "`x` is damaged"),
        (
            "malformed-npz",
            archive("x.npy", npy(b"{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000000,)}")),
            "`x` is damaged",
        ),
        ("malformed-npz", archive("x.npy", b"", zipfile.ZIP_BZIP2), "unusual way"),
        ("no-columns", npz(), "no columns"),
        ("bad-column-name", archive(".npy", b""), "column 1 has no name"),
        ("bad-array", npz(x=np.zeros((3, 2))), "shape (3, 2)"),
        ("bad-array", npz(x=np.float64(3)), "shape ()"),
        ("bad-array", npz(x=np.array([1, "a"], dtype=object)), "Python objects"),
        ("bad-array", npz(x=np.array([1j])), "complex"),
        ("bad-array", npz(x=np.array([b"a"])), "bytes"),
        ("bad-array", npz(x=np.zeros(2, dtype=[("a", "f8")])), "structured"),
        ("unequal-lengths", npz(x=np.zeros(3), y=np.zeros(2)), "`y` has 2 cells, column `x` has 3"),
    ],
)
def test_faults_in_archives(load_text, faults_of, code, content, words):
    (fault,) = faults_of(load_text, content, "npz")
    assert fault.code.name == code
    assert fault.place.file.endswith("/d.npz")
    assert words in fault.message


def test_an_archive_that_unpacks_to_too_much(load_text, faults_of):
    content = bytearray(archive("x.npy", b"0" * 100))
    directory = content.rindex(b"PK\x01\x02")
    content[directory + 24 : directory + 28] = (3_000_000_000).to_bytes(
        4, "little"
    )  # the size it claims (APPNOTE 4.3.12)
    (fault,) = faults_of(load_text, bytes(content), "npz")
    assert fault.code.name == "file-too-large"


@pytest.mark.parametrize(
    ("code", "given", "row", "column", "words"),
    [
        ("not-a-table", "ranges.csv", None, None, "type `str`"),
        ("not-a-table", 3, None, None, "type `int`"),
        ("not-a-table", None, None, None, "type `NoneType`"),
        ("not-a-table", [1, 2], None, None, "a list that holds a value of type `int`"),
        ("not-a-table", np.zeros((3, 2)), None, None, "an array of shape (3, 2), whose columns have no names"),
        ("no-columns", {}, None, None, "no columns"),
        ("no-columns", [], None, None, "no columns"),
        ("bad-column-name", {"x": [1], 2: [3]}, None, None, "column 2 is called 2"),
        ("bad-column-name", pd.DataFrame([[1, 2]], columns=["x", ""]), None, None, "column 2 has no name"),
        ("bad-column-name", [{None: 1}], None, None, "column 1 is called None"),
        ("duplicate-column", pd.DataFrame([[1, 2]], columns=["x", "x"]), None, None, "two columns are called `x`"),
        ("unequal-lengths", {"x": [1, 2], "y": np.zeros(3)}, None, None, "`y` has 3 cells, column `x` has 2"),
        ("bad-array", {"x": np.zeros((2, 2))}, None, "x", "shape (2, 2)"),
        ("bad-array", {"x": 3.0}, None, "x", "type `float`"),
        ("bad-array", {"x": "abc"}, None, "x", "type `str`"),
        ("bad-array", {"x": iter([1])}, None, "x", "type `list_iterator`"),
        ("bad-array", np.zeros(2, dtype=[("v", "f8", 3)]), None, "v", "shape (2, 3)"),
        ("bad-cell", {"x": [1, True]}, 2, "x", "truth value `true`"),
        ("bad-cell", {"x": np.array([1, [2]], dtype=object)}, 2, "x", "type `list`"),
        ("bad-cell", {"x": [1, 2j]}, 2, "x", "type `complex`"),
        ("bad-cell", [{"x": 1}, {"x": b"a"}], 2, "x", "type `bytes`"),
    ],
)
def test_faults_in_given_tables(load_given, faults_of, code, given, row, column, words):
    (fault,) = faults_of(load_given, given)
    assert fault.code.name == code
    assert fault.place == DataPlace(file="<d>", row=row, column=column)
    assert words in fault.message


def test_rows_in_the_problem_that_do_not_fit(tmp_path, declare, inline, faults_of, span):
    declaration = declare("table", None, inline=inline(("k", "v"), (1.0,), (1.0, 2.0, 3.0)))
    found = faults_of(load, declaration, base=tmp_path, given={}, paths={}, sandbox=None, readers=READERS)
    assert [(fault.code.name, fault.place) for fault in found] == [
        ("short-row", span("(1 2)")),
        ("long-row", span("(3 4)")),
    ]


def test_columns_in_the_problem_with_one_name(tmp_path, declare, inline, faults_of):
    declaration = declare("table", None, inline=inline(("k", "k"), (1.0, 2.0)))
    (fault,) = faults_of(load, declaration, base=tmp_path, given={}, paths={}, sandbox=None, readers=READERS)
    assert (fault.code.name, fault.place) == ("duplicate-column", declaration.span)


def test_an_undeclared_table(tmp_path, declare, inline, faults_of):
    declaration = declare("table", None, name="ranges", inline=inline(("k",)))
    (fault,) = faults_of(
        load_all, [declaration], base=tmp_path, given={}, paths={"range": "x"}, sandbox=None, readers=READERS
    )
    assert fault.code.name == "undeclared-table"
    assert fault.hint == "did you mean `ranges`?"


def test_no_more_tables_are_looked_at_when_enough_is_wrong(tmp_path, declare, faults_of):
    declarations = [declare(path=f"none{i}.csv", name=f"d{i}") for i in range(3 * MOST_FAULTS)]
    found = faults_of(load_all, declarations, base=tmp_path, given={}, paths={}, sandbox=None, readers=READERS)
    assert len(found) == MOST_FAULTS + 1
    assert {fault.code.name for fault in found[:-1]} == {"missing-file"}
    assert found[-1].code.name == "more-faults"


def test_a_missing_column(load_text, faults_of, column):
    (fault,) = faults_of(load_text, "range,y\n1,2\n", columns=(column("r", "rnage"),))
    assert fault.code.name == "missing-column"
    assert fault.place.line == 2
    assert "has no column `rnage`; it has `range`, `y`" in fault.message
    assert fault.hint == "did you mean `range`?"


def test_a_missing_key_column(load_text, faults_of, column):
    (fault,) = faults_of(load_text, "id,y\n1,2\n", columns=(column("nr", "id"),), key="id")
    assert fault.code.name == "missing-column"
    assert "has no column `id`; it has `nr`, `y`" in fault.message


def test_many_columns_are_not_all_listed(load_text, faults_of):
    header = ",".join(f"column{i}" for i in range(100))
    (fault,) = faults_of(load_text, header + "\n", key="id")
    assert fault.message.endswith("`column11` and 88 more")


@pytest.mark.parametrize("columns", [[("a", "b")], [("c", "a"), ("c", "b")]])
def test_renaming_to_a_name_that_is_taken(load_text, faults_of, column, columns):
    (fault,) = faults_of(load_text, "a,b\n1,2\n", columns=tuple(column(*names) for names in columns))
    assert fault.code.name == "duplicate-column"
    assert fault.place.line == 2


@pytest.mark.parametrize("cell", ["n/a", "1,5", "12mm", "1_000"])
def test_a_text_in_a_column_with_a_unit(load_text, faults_of, column, cell):
    content = f'r,y\n1500,1\n,2\nNA,3\n"{cell}",4\nx,5\n'
    (fault,) = faults_of(load_text, content, columns=(column("range", "r", "mm", 0.001),))
    assert fault.code.name == "not-a-number"
    assert (fault.place.row, fault.place.column) == (5, "r")
    assert f"holds the text `{cell}`" in fault.message
    assert [(label.message, label.place.line) for label in fault.labels] == [("read in `mm` here", 2)]


def test_long_cells_are_cut_short(load_text, faults_of, column):
    (fault,) = faults_of(load_text, "r\n" + "x" * 5000 + "\n", columns=(column("r", "r", "mm", 0.001),))
    assert f"`{'x' * 39}…`" in fault.message


def test_control_characters_do_not_reach_the_terminal(load_text, faults_of, column):
    (fault,) = faults_of(load_text, 'r\n"a\nb\x1b[2J"\n', columns=(column("r", "r", "mm", 0.001),))
    assert "`a b\N{REPLACEMENT CHARACTER}[2J`" in fault.message


def test_faults_of_several_columns_are_reported_together(load_text, faults_of, column):
    columns = (column("a", "a", "m"), column("q", "z"), column("b", "b", "m"))
    assert [fault.code.name for fault in faults_of(load_text, "a,b\nx,y\n", columns=columns)] == [
        "not-a-number",
        "missing-column",
        "not-a-number",
    ]


def test_a_column_without_any_value_where_gaps_are_skipped(load_text, faults_of):
    (fault,) = faults_of(load_text, "x,note\n1,\n2,\n", skip_missing=True)
    assert fault.code.name == "empty-column"
    assert (fault.place.row, fault.place.column) == (None, "note")


@pytest.mark.parametrize(("content", "row"), [("id,x\na,1\n,2\n", 3), ("id,x\n1,1\n,2\nNA,3\n", 3)])
def test_a_row_without_a_key(load_text, faults_of, content, row):
    fault = faults_of(load_text, content, key="id")[0]
    assert fault.code.name == "missing-key"
    assert (fault.place.row, fault.place.column) == (row, "id")


@pytest.mark.parametrize(("key", "shown"), [("a", "a"), ("7", "7"), ("0.1", "0.10000000000000001")])
def test_two_rows_with_one_key(load_text, faults_of, column, key, shown):
    content = f"nr,x\n{key},1\n8,2\n{key},3\n8,4\n"
    found = faults_of(load_text, content, columns=(column("id", "nr"),), key="id")
    assert [fault.code.name for fault in found] == ["duplicate-key"] * 2
    assert found[0].message == f"rows 2 and 4 have the same key `{shown}` in column `nr`"
    assert (found[0].place.row, found[0].place.column) == (4, "nr")
    assert [label.message for label in found[0].labels] == ["first here", "`id` is the key of `d` here"]
    assert found[0].labels[0].place.row == 2


def test_few_of_many_double_keys_are_reported(load_text, faults_of):
    assert len(faults_of(load_text, "id\n" + "1\n" * 1000, key="id")) == 5


def test_every_code_has_its_test():
    sources = [path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*diagnostics.py")]
    texts = {
        node.value
        for source in sources
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert texts >= CODES
    assert len(CODES) == 37


def test_every_message_fits_a_line_of_the_document(load_text, faults_of):
    """Diagnostics go into JSON: no message may hold what it cannot."""
    for _, source, content, *_ in IN_FILES:
        for fault in faults_of(load_text, content, source):
            assert json.loads(json.dumps(fault.message)) == fault.message
            assert len(fault.message) < 400
