"""Rows by key: the groups are those that a dictionary of the cells gives, in the order in which they first occur."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mbm.equations.selection import divided, groups
from mbm.problem.provenance import Provenance
from mbm.problem.tables import Column, Table


def table(name="t", **columns):
    made = {}
    for column, cells in columns.items():
        if cells and isinstance(cells[0], str):
            made[column] = Column(name=column, texts=tuple(cells))
        else:
            made[column] = Column(name=column, numbers=np.array(cells, dtype=float))
    rows = np.arange(1, len(next(iter(columns.values()))) + 1)
    provenance = Provenance(path="t.csv", sha256=None, rows=len(rows), file_rows=rows + 1)
    return Table(name=name, columns=made, rows=rows, provenance=provenance)


def by_dictionary(*columns):
    found = {}
    for position, cells in enumerate(zip(*columns, strict=True)):
        found.setdefault(cells, []).append(position)
    return found


CELLS = st.lists(
    st.tuples(st.sampled_from([0.0, -0.0, 1.0, 2.5]), st.sampled_from(["a", "b", "c"])), min_size=1, max_size=40
)


@given(cells=CELLS)
def test_groups_are_those_of_a_dictionary(cells):
    numbers, texts = (list(column) for column in zip(*cells, strict=True))
    found = groups(table(x=numbers, k=texts), ["x", "k"])
    expected = by_dictionary(numbers, texts)
    assert list(found.cells) == list(expected)
    assert [found.positions(i).tolist() for i in range(len(found.cells))] == list(expected.values())


def test_a_row_without_a_number_is_a_group_of_its_own():
    found = groups(table(x=[1.0, np.nan, 1.0, np.nan]), ["x"])
    assert [found.positions(i).tolist() for i in range(len(found.cells))] == [[0, 2], [1], [3]]


def test_a_table_without_rows_has_no_groups():
    found = groups(table(x=[]), ["x"])
    assert list(found.cells) == []


@pytest.mark.parametrize("columns", [("x",), ("x", "k"), ("k", "x")])
def test_tables_with_some_of_the_columns_give_each_solve_its_rows(columns):
    whole = table("w", x=[2.0, 1.0, 2.0, 1.0], k=["a", "a", "b", "a"])
    part = table("p", x=[1.0, 3.0, 2.0, 1.0])
    found = divided(columns, {"w": whole, "p": part})
    each = {c: i for i, c in enumerate(found.combinations)}
    for cells, number in each.items():
        x = cells[columns.index("x")]
        own = [i for i, cell in enumerate([1.0, 3.0, 2.0, 1.0]) if cell == x]
        assert found.parts["p"].positions(number).tolist() == own
    assert found.parts["p"].sizes.tolist() == [len(found.parts["p"].positions(i)) for i in range(len(each))]


def test_where_no_table_has_all_columns_every_combination_is_tried():
    found = divided(("x", "k"), {"a": table("a", x=[1.0, 2.0, 1.0]), "b": table("b", k=["u", "v"])})
    assert list(found.combinations) == [(1.0, "u"), (1.0, "v"), (2.0, "u"), (2.0, "v")]
    assert found.parts["a"].positions(1).tolist() == [0, 2]
