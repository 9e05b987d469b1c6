"""Data clauses: where a table is read from, and what the clause does to its columns and rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbm.data.loader import load, load_all
from mbm.data.readers import READERS
from mbm.text.types import MbmError


def loaded(declaration, base, *, given=None, paths=None, sandbox=None):
    return load(declaration, base=base, given=given or {}, paths=paths or {}, sandbox=sandbox, readers=READERS)


def test_a_path_is_relative_to_the_problem_and_shown_as_it_was_said(tmp_path, monkeypatch, declare):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "d.csv").write_text("x\n1\n")
    monkeypatch.chdir(tmp_path)
    assert loaded(declare(), Path("sub")).provenance.path == "sub/d.csv"
    monkeypatch.chdir(tmp_path / "sub")
    assert loaded(declare(), Path()).provenance.path == "d.csv"


def test_a_given_table_goes_before_a_path_and_a_path_before_the_clause(tmp_path, monkeypatch, declare, inline):
    (tmp_path / "d.csv").write_text("x\n1\n")
    (tmp_path / "e.csv").write_text("x\n2\n")
    monkeypatch.chdir(tmp_path)
    x = lambda **more: loaded(declare(), tmp_path, **more).numbers("x").tolist()  # noqa: E731
    assert x() == [1.0]
    assert x(paths={"d": "e.csv"}) == [2.0]
    assert x(paths={"d": "e.csv"}, given={"d": {"x": [3]}}) == [3.0]
    table = loaded(declare("table", None, inline=inline(("x",), (4.0,))), tmp_path, paths={"d": "e.csv"})
    assert table.numbers("x").tolist() == [2.0]


def test_a_path_on_the_command_line_is_relative_to_the_working_folder(tmp_path, monkeypatch, declare):
    (tmp_path / "e.csv").write_text("x\n2\n")
    monkeypatch.chdir(tmp_path)
    assert loaded(declare("external", None), tmp_path / "elsewhere", paths={"d": "e.csv"}).provenance.path == "e.csv"


@pytest.mark.parametrize(
    ("source", "file", "content"),
    [
        ("external", "e.tsv", "x\ty\n1\t2\n"),
        ("external", "E.CSV", "x,y\n1,2\n"),
        ("csv", "e.json", '{"x": [1], "y": [2]}'),
        ("csv", "e.txt", "x,y\n1,2\n"),
        ("tsv", "e", "x\ty\n1\t2\n"),
        ("tum", "e.csv", "x,y\n1,2\n"),
    ],
)
def test_the_ending_tells_the_format_or_else_the_clause_does(tmp_path, declare, source, file, content):
    (tmp_path / file).write_text(content)
    table = loaded(declare(source, "unused"), tmp_path, paths={"d": str(tmp_path / file)})
    assert table.numbers("y").tolist() == [2.0]


def test_a_reader_that_is_not_there_is_an_internal_error(tmp_path, declare):
    with pytest.raises(ValueError, match="no reader `sqlite`"):
        loaded(declare("sqlite"), tmp_path)


def test_columns_are_renamed_and_read_in_their_units(load_text, column):
    table = load_text(
        "r,phi,t\n1500,180,7\n-20,90,8\n",
        columns=(column("range", "r", "mm", 0.001), column("phi", None, "deg", np.pi / 180)),
    )
    assert list(table.columns) == ["range", "phi", "t"]
    np.testing.assert_allclose(table.numbers("range"), [1.5, -0.02], rtol=1e-15)  # one product, one rounding
    np.testing.assert_allclose(table.numbers("phi"), [np.pi, np.pi / 2], rtol=4e-16)
    assert table.numbers("t").tolist() == [7.0, 8.0]
    assert [c.unit for c in table.columns.values()] == ["mm", "deg", None]
    assert [name == c.name for name, c in table.columns.items()] == [True] * 3


def test_columns_may_change_places(load_text, column):
    table = load_text("a,b\n1,2\n", columns=(column("b", "a"), column("a", "b")))
    assert {name: table.numbers(name).tolist() for name in "ab"} == {"a": [2.0], "b": [1.0]}


def test_a_column_may_be_read_under_two_names(load_text, column):
    table = load_text("a\n1\n", columns=(column("x", "a"), column("y", "a", "mm", 0.001)))
    assert (table.numbers("x").tolist(), table.numbers("y").tolist()) == ([1.0], [0.001])


def test_a_text_column_may_be_renamed(load_text, column):
    assert load_text("a\nred\n", columns=(column("colour", "a"),)).columns["colour"].texts == ("red",)


def test_places_are_those_of_the_file(load_text, column):
    table = load_text("r\n1\n2\n", columns=(column("range", "r"),))
    place = table.place(1, "range")
    assert (place.row, place.column) == (3, "r")
    assert place.file.endswith("/d.csv")


def test_rows_keep_their_numbers_when_others_are_left_out(load_text):
    table = load_text("name,x,y\na,1,\nb,2,3\n,4,5\nd,nan,6\ne,7,8\n", skip_missing=True)
    assert table.rows.tolist() == [2, 3, 5]  # an empty text is no gap in a column of numbers
    assert table.numbers("x").tolist() == [2.0, 4.0, 7.0]
    assert table.columns["name"].texts == ("b", "", "e")
    assert table.provenance.rows == 5
    assert [table.place(i).row for i in range(3)] == [3, 4, 6]


def test_infinite_numbers_are_no_gaps(load_text):
    assert load_text("x\ninf\n1\n", skip_missing=True).rows.tolist() == [1, 2]


def test_gaps_stay_without_skip(load_text):
    np.testing.assert_array_equal(load_text("x,y\n,1\n2,2\n").numbers("x"), [np.nan, 2.0])


def test_the_key_is_named_as_in_the_problem(load_text, column):
    table = load_text("nr,x\n1,2\n3,4\n", columns=(column("id", "nr"),), key="id")
    assert table.key == "id"
    assert list(table.keys()) == [1.0, 3.0]


def test_a_key_of_a_row_left_out_may_occur_again(load_text):
    assert load_text("id,x\n1,\n1,2\n", key="id", skip_missing=True).rows.tolist() == [2]


def test_rows_written_in_the_problem(tmp_path, declare, inline):
    table = loaded(declare("table", None, inline=inline(("k", "v"), ("a", 2.0), (3.0, 4.5))), tmp_path)
    assert table.columns["k"].texts == ("a", "3")
    assert table.numbers("v").tolist() == [2.0, 4.5]
    assert table.provenance.path == "tag.mbm"
    assert [table.place(i).row for i in range(2)] == [4, 5]  # the lines of the rows


@pytest.mark.parametrize("gap", ["NA", ""])
def test_gaps_in_rows_written_in_the_problem(tmp_path, declare, inline, gap):
    rows = inline(("k", "v"), ("a", 2.0), ("", gap))
    table = loaded(declare("table", None, inline=rows), tmp_path)
    np.testing.assert_array_equal(table.numbers("v"), [2.0, np.nan])
    assert table.columns["k"].texts == ("a", "")


def test_words_in_rows_written_in_the_problem_are_texts(tmp_path, declare, inline):
    table = loaded(declare("table", None, inline=inline(("k", "v"), (1.0, ""), ("none", "NA"))), tmp_path)
    assert [table.columns[name].texts for name in ("k", "v")] == [("1", "none"), ("", "NA")]


def test_an_inline_table_may_have_no_rows(tmp_path, declare, inline):
    assert len(loaded(declare("table", None, inline=inline(("k",))), tmp_path)) == 0


def test_files_in_the_sandbox_are_read(tmp_path, declare):
    (tmp_path / "sub").mkdir()
    (tmp_path / "d.csv").write_text("x\n1\n")
    assert loaded(declare(path="sub/../d.csv"), tmp_path, sandbox=tmp_path).numbers("x").tolist() == [1.0]


def test_a_pattern_that_leads_out_of_the_sandbox_is_named_whole(tmp_path, declare):
    (tmp_path / "inner").mkdir()
    with pytest.raises(MbmError, match=r"the file `[^`]*/run-\*\.csv` lies outside"):
        loaded(declare(path="run-*.csv"), tmp_path, sandbox=tmp_path / "inner")


def test_a_link_within_the_sandbox_is_followed(tmp_path, declare):
    (tmp_path / "e.csv").write_text("x\n1\n")
    (tmp_path / "d.csv").symlink_to(tmp_path / "e.csv")
    assert loaded(declare(), tmp_path, sandbox=tmp_path).numbers("x").tolist() == [1.0]


def test_all_tables_load_in_their_order(tmp_path, declare):
    (tmp_path / "d.csv").write_text("x\n1\n")
    declarations = [declare("external", None, name="e"), declare()]
    tables = load_all(declarations, base=tmp_path, given={"e": {"y": [2]}}, paths={}, sandbox=None, readers=READERS)
    assert list(tables) == ["e", "d"]


def test_faults_of_several_tables_are_reported_together(tmp_path, declare, faults_of):
    declarations = [declare("external", None, name="ranges"), declare()]
    found = faults_of(
        load_all, declarations, base=tmp_path, given={"range": {}}, paths={}, sandbox=None, readers=READERS
    )
    assert [fault.code.name for fault in found] == ["undeclared-table", "missing-table", "missing-file"]
    assert found[0].hint == "did you mean `ranges`?"
