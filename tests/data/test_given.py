"""Tables from the Python API."""

from __future__ import annotations

import math
from datetime import date, datetime, time, timedelta
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest

import mbm
from mbm.data.cells import mixed_column
from mbm.text.types import MbmError


def cells(table) -> dict[str, list]:
    return {name: list(c.texts) if c.texts is not None else c.numbers.tolist() for name, c in table.columns.items()}


class PolarsLike:
    """As much of a polars frame as is used: names of columns, and columns that convert to arrays."""

    def __init__(self, **arrays):
        self.arrays = arrays

    @property
    def columns(self):
        return list(self.arrays)

    def __getitem__(self, name):
        return pd.Series(self.arrays[name])


RECORD = np.array([(1.5, "a"), (2.0, "b")], dtype=[("x", "f8"), ("name", "U3")])


@pytest.mark.parametrize(
    "given",
    [
        {"x": [1.5, 2], "name": ["a", "b"]},
        {"x": np.array([1.5, 2]), "name": np.array(["a", "b"])},
        {"x": pd.Series([1.5, 2]), "name": ("a", "b")},
        [{"x": 1.5, "name": "a"}, {"x": 2, "name": "b"}],
        ({"x": np.float32(1.5), "name": np.str_("a")}, {"x": np.int8(2), "name": "b"}),
        RECORD,
        RECORD.view(np.recarray),
        pd.DataFrame({"x": [1.5, 2], "name": ["a", "b"]}),
        pd.DataFrame({"x": [1.5, 2], "name": pd.Categorical(["a", "b"])}, index=[7, 9]),
        pd.DataFrame({"x": pd.array([1.5, 2], dtype="Float64"), "name": pd.array(["a", "b"], dtype=object)}),
        PolarsLike(x=[1.5, 2.0], name=["a", "b"]),
        {"x": [Decimal("1.5"), Decimal(2)], "name": ["a", "b"]},
    ],
)
def test_every_kind_of_table(load_given, given):
    table = load_given(given)
    assert cells(table) == {"x": [1.5, 2.0], "name": ["a", "b"]}
    assert table.rows.tolist() == [1, 2]
    assert table.provenance.path == "<d>"
    assert table.provenance.sha256 is None
    assert table.place(1, "x").row == 2


@pytest.mark.parametrize(
    "given",
    [
        {"x": [1, None]},
        {"x": [1, math.nan]},
        {"x": np.ma.masked_array([1, 2], mask=[False, True])},
        {"x": np.array([1, pd.NA], dtype=object)},
        [{"x": 1, "y": 0}, {"y": 0}],
        pd.DataFrame({"x": pd.array([1, None], dtype="Int64")}),
        pd.DataFrame({"x": [1, None]}),
    ],
)
def test_gaps(load_given, given):
    numbers = load_given(given).columns["x"].numbers
    assert numbers[0] == 1.0
    assert math.isnan(numbers[1])


@pytest.mark.parametrize(
    "given",
    [
        {"x": np.array([True, False, True])},
        {"x": [True, False, True]},
        {"x": [np.True_, np.False_, True]},
        {"x": np.array([True, False, True], dtype=object)},
        [{"x": True}, {"x": False}, {"x": True}],
        np.array([(True,), (False,), (True,)], dtype=[("x", "?")]),
        pd.DataFrame({"x": [True, False, True]}),
        pd.DataFrame({"x": pd.array([True, False, True], dtype="boolean")}),
    ],
)
def test_truth_values_are_one_and_zero(load_given, given):
    assert cells(load_given(given)) == {"x": [1.0, 0.0, 1.0]}


@pytest.mark.parametrize("gap", [None, math.nan, pd.NA])
def test_gaps_among_truth_values(load_given, gap):
    numbers = load_given({"x": [True, gap, False]}).columns["x"].numbers
    np.testing.assert_array_equal(numbers, [1.0, math.nan, 0.0])


def test_the_table_keeps_its_numbers_when_the_array_changes(load_given):
    array = np.array([1.0, 2.0])
    table = load_given({"x": array})
    array[0] = 9.0
    assert table.columns["x"].numbers.tolist() == [1.0, 2.0]
    assert array.flags.writeable


def test_units_key_and_gaps_are_treated_as_in_files(load_given, column):
    table = load_given(
        {"id": ["a", "b", "c"], "r": [1500.0, None, 2500.0]},
        columns=(column("range", "r", "mm", 0.001),),
        key="id",
        skip_missing=True,
    )
    assert cells(table) == {"range": pytest.approx([1.5, 2.5], rel=1e-15), "id": ["a", "c"]}  # one rounding
    assert table.columns["range"].unit == "mm"
    assert table.rows.tolist() == [1, 3]
    assert table.place(1, "range").column == "r"
    assert table.place(1, "range").row == 3


def test_whole_numbers_among_texts_are_keys_without_a_point():
    found = mixed_column("k", [1000.0, "a", 0.5, -123456789.0, 7, None]).texts
    assert found == ("1000", "a", "0.5", "-123456789", "7", "")


def test_tables_of_arrow_and_their_gaps(load_given):
    arrow = pytest.importorskip("pyarrow")
    columns = {"x": [1.5, None, 2.5], "n": [1, None, 3], "on": [True, False, True], "name": ["a", "b", None]}
    wanted = load_given({name: list(values) for name, values in columns.items()})
    table = arrow.table(columns)
    for given in (table, table.to_batches()[0], arrow.concat_tables([table.slice(0, 1), table.slice(1)])):
        found = load_given(given)
        np.testing.assert_array_equal(found.columns["x"].numbers, [1.5, np.nan, 2.5])
        assert repr(cells(found)) == repr(cells(wanted))


def test_a_range_is_a_column(load_given):
    assert cells(load_given({"k": range(2, 5)})) == {"k": [2.0, 3.0, 4.0]}


@pytest.mark.parametrize(
    "dates",
    [
        pd.to_datetime(["2020-01-02", None, "2020-01-03"]),
        pd.Series(pd.to_datetime(["2020-01-02", None, "2020-01-03"])),
        np.array(["2020-01-02", "NaT", "2020-01-03"], "M8[D]"),
        [date(2020, 1, 2), None, date(2020, 1, 3)],
    ],
    ids=["index", "frame", "array", "list"],
)
def test_dates_are_texts_as_in_files(load_given, dates):
    """Columns that nothing uses may hold them, and so may keys."""
    table = load_given({"x": [1.0, 2.0, 3.0], "day": dates})
    assert table.columns["day"].texts == ("2020-01-02", "", "2020-01-03")


def test_times_of_day_and_differences_are_texts(load_given):
    table = load_given(
        {"a": [time(12, 30), time(13)], "b": [timedelta(days=1), None], "c": [datetime(2020, 1, 2, 3, 4, 5)] * 2}
    )
    assert table.columns["a"].texts == ("12:30:00", "13:00:00")
    assert table.columns["b"].texts == ("1 day, 0:00:00", "")
    assert table.columns["c"].texts == ("2020-01-02T03:04:05",) * 2


def test_dates_are_no_numbers_and_what_to_give_is_said():
    text = "(problem p (data d external) (unknowns (a)) (observe d (= y (* a when)) :sigma 1))"
    given = {"d": {"y": [1.0, 2.0], "when": pd.date_range("2020", periods=2)}}
    with pytest.raises(MbmError, match="text-in-number-column") as caught:
        mbm.loads(text).solve(data=given)
    assert caught.value.diagnostics[0].hint == "give times as numbers, in seconds since some start"


ODD = {
    "mixed": [1, True, 3],
    "nested": [{"a": 1}, [2], None],
    "wide": np.zeros((3, 2)),
    "complex": np.array([1j, 2j, 3j]),
}
"""Columns of three rows that are neither numbers nor texts."""

LINE = "(problem p (data d external) (unknowns (a)) (observe d (= y {}) :sigma 1))"


def test_columns_that_nobody_uses_may_hold_anything():
    """The mean of 1, 2, 3: frames of measurements often carry pictures, lists or truth values with gaps."""
    result = mbm.loads(LINE.format("a")).solve(data={"d": {"y": [1.0, 2.0, 3.0], **ODD}})
    assert result["a"].value == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("name", ODD)
def test_columns_of_odd_cells_are_refused_where_they_are_used(name):
    with pytest.raises(MbmError) as caught:
        mbm.loads(LINE.format(f"(* a {name})")).solve(data={"d": {"y": [1.0, 2.0, 3.0], **ODD}})
    (fault,) = caught.value.diagnostics
    assert fault.code.name in {"bad-cell", "bad-array"}
    assert f"column `{name}`" in fault.message


@pytest.mark.parametrize("name", ODD)
def test_columns_of_odd_cells_are_no_keys(name):
    text = f"(problem p (data d external :key {name}) (unknowns (a)) (observe d (= y a) :sigma 1))"
    with pytest.raises(MbmError, match=r"bad-(cell|array): .*neither a number|bad-array: .* not a one-dimensional"):
        mbm.loads(text).solve(data={"d": {"y": [1.0, 2.0, 3.0], **ODD}})


@pytest.mark.parametrize("clause", ["for-each nested", "for-each wide"])
def test_columns_of_odd_cells_divide_no_table(clause):
    text = f"(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma 1) ({clause}))"
    with pytest.raises(MbmError, match=r"bad-(cell|array)"):
        mbm.loads(text).solve(data={"d": {"y": [1.0, 2.0, 3.0], **ODD}})


def test_columns_of_odd_cells_pass_through_unions_and_joins():
    """Rows of two tables end to end, with a row of a third beside each: the mean of 1 to 4 beside 0, 0, 1, 1 is 2."""
    text = """(problem p (data one external) (data two external) (data far external :key k)
        (data both (union one two) :with (far k)) (unknowns (a)) (observe both (= y (+ a {})) :sigma 1))"""
    data = {
        "one": {"y": [1.0, 2.0], "k": ["u", "u"], "odd": [[1], [2]]},
        "two": {"y": [3.0, 4.0], "k": ["v", "v"], "odd": ["x", "y"]},
        "far": {"k": ["u", "v"], "h": [0.0, 1.0], "odd": [b"1", b"2"]},
    }
    assert mbm.loads(text.format("far.h")).solve(data=data)["a"].value == pytest.approx(2.0, rel=1e-12)
    for odd in ("odd", "far.odd"):
        with pytest.raises(MbmError, match=r"bad-cell: row 1, column `odd` holds a value of type `(list|bytes)`"):
            mbm.loads(text.format(odd)).solve(data=data)
