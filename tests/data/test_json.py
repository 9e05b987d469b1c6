"""JSON: three shapes of a table, gaps, and texts that stay texts."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, strategies as st

from mbm.data.readers import READERS


def read(folder, content):
    path = folder / "d.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return READERS["json"].read(path)


def cells(raw) -> dict[str, list]:
    return {c.name: list(c.texts) if c.texts is not None else c.numbers.tolist() for c in raw.columns}


@pytest.mark.parametrize(
    "content",
    [
        [{"name": "a", "x": 1}, {"name": "b", "x": 2.5}],
        {"name": ["a", "b"], "x": [1, 2.5]},
        {"columns": ["name", "x"], "data": [["a", 1], ["b", 2.5]]},
        {"columns": ["name", "x"], "index": [0, 1], "data": [["a", 1], ["b", 2.5]]},
    ],
)
def test_the_three_shapes_make_the_same_table(tmp_path, content):
    raw = read(tmp_path, content)
    assert cells(raw) == {"name": ["a", "b"], "x": [1.0, 2.5]}
    assert raw.file_rows.tolist() == [1, 2]


def test_columns_called_columns_and_data_are_ordinary_ones(tmp_path):
    assert cells(read(tmp_path, {"columns": ["a", "b"], "data": [1, 2]})) == {"columns": ["a", "b"], "data": [1.0, 2.0]}


def test_null_nan_and_a_field_left_out_are_gaps(tmp_path):
    raw = read(tmp_path, '[{"x": true}, {"x": null}, {"x": false}]')
    assert [str(v) for v in raw.columns[0].numbers] == ["1.0", "nan", "0.0"]
    raw = read(tmp_path, '[{"x": 1, "t": "a"}, {"x": null}, {"t": "b"}, {"x": NaN, "t": null}]')
    x, t = raw.columns
    assert x.numbers[0] == 1.0
    assert all(math.isnan(v) for v in x.numbers[1:])
    assert t.texts == ("a", "", "b", "")


def test_fields_stand_in_the_order_of_their_first_use(tmp_path):
    assert list(cells(read(tmp_path, '[{"b": 1}, {"a": 2, "b": 3}]'))) == ["b", "a"]


def test_strings_are_texts_even_if_they_read_as_numbers(tmp_path):
    column = read(tmp_path, {"id": ["001", "2"]}).columns[0]
    assert column.texts == ("001", "2")
    assert column.first_text() == 0


def test_numbers_among_texts_become_texts(tmp_path):
    assert cells(read(tmp_path, {"k": [1, 2.0, 2.5, "a"]})) == {"k": ["1", "2", "2.5", "a"]}


def test_a_character_of_two_escapes(tmp_path):
    assert cells(read(tmp_path, r'{"k": ["\ud83d\ude00"]}')) == {"k": ["😀"]}


def test_numbers_beyond_the_range_are_infinite(tmp_path):
    assert cells(read(tmp_path, '{"x": [1e999, -1e999, Infinity, 1' + "0" * 400 + "]}")) == {
        "x": [math.inf, -math.inf, math.inf, math.inf]
    }


def test_no_records_but_names(tmp_path):
    assert cells(read(tmp_path, {"columns": ["x"], "data": []})) == {"x": []}
    assert cells(read(tmp_path, {"x": []})) == {"x": []}


@given(
    st.integers(0, 5).flatmap(
        lambda rows: st.dictionaries(
            st.text(min_size=1).filter(lambda name: name != "data"),
            st.one_of(
                st.lists(st.floats(allow_nan=False), min_size=rows, max_size=rows),
                st.lists(st.text(), min_size=rows, max_size=rows),
            ),
            min_size=1,
        )
    )
)
def test_what_the_json_module_writes_is_read_back(tmp_path_factory, table):
    # json escapes everything outside ASCII, lone surrogates too; a column without cells has no type
    expected = {name: list(values) for name, values in table.items()}
    assert cells(read(tmp_path_factory.mktemp("json"), table)) == expected
