"""The rows of many solves one below the other, and their members numbered within each solve."""

from __future__ import annotations

import numpy as np

import mbm
from mbm.estimation.batches.parts import shapes
from mbm.estimation.batches.sets import Span, sets_of
from mbm.estimation.batches.stack import arranged
from mbm.problem.provenance import Provenance
from mbm.problem.tables import Column, Table

TEXT = """
(problem p
  (data d (table (day site y) (1 b 1.0) (2 a 2.0) (1 a 1.5) (2 a 2.5) (1 b 1.2) (2 c 0.5)))
  (unknowns (h :per d.site :init 0))
  (observe d (= y (h site)) :sigma 1)
  (for-each day))
"""


def table():
    cells = [(1, "b", 1.0), (2, "a", 2.0), (1, "a", 1.5), (2, "a", 2.5), (1, "b", 1.2), (2, "c", 0.5)]
    day, site, y = zip(*cells, strict=True)
    columns = {
        "day": Column(name="day", numbers=np.array(day, dtype=float), texts=None),
        "site": Column(name="site", numbers=None, texts=site),
        "y": Column(name="y", numbers=np.array(y), texts=None),
    }
    rows = np.arange(1, 7)
    provenance = Provenance(path="d", sha256="", rows=6, file_rows=rows + 1)
    return Table(name="d", columns=columns, rows=rows, provenance=provenance)


def made():
    problem = mbm.loads(TEXT).compile().elaborated.problem
    sets = sets_of(problem, {"d": table()})
    return problem, sets, arranged(problem, sets)


def test_members_are_the_distinct_cells_of_each_solve_in_the_order_met():
    _, sets, found = made()
    assert sets.keys == [(1.0,), (2.0,)]
    (members,) = found.families.values()
    assert list(members.keys) == ["b", "a", "a", "c"]
    assert members.first.tolist() == [0, 2, 4]
    assert found.tables["d"].columns["y"].numbers.tolist() == [1.0, 1.5, 1.2, 2.0, 2.5, 0.5]
    assert found.owners["d"].tolist() == [0, 0, 0, 1, 1, 1]


def test_keys_are_looked_up_in_their_solve():
    _, _, found = made()
    (members,) = found.families.values()
    codes = members.codes(["a", "a", "b", "b", "c", "nowhere"])
    assert members.numbers(np.array([0, 1, 0, 1, 1, 0]), codes).tolist() == [1, 0, 0, -1, 1, -1]


def test_solves_with_as_many_members_have_one_shape():
    problem, _, found = made()
    alike, apart = shapes(problem, found, 2)
    assert [part.tolist() for part in alike] == [[0, 1]]
    assert len(apart) == 0


def test_rows_of_some_solves_leave_out_those_of_the_others():
    span = Span(order=np.array([4, 2, 0, 1, 3]), first=np.array([0, 1, 3, 3]), last=np.array([2, 3, 5, 3]))
    some = span.some(np.array([0, 2, 3]))
    assert [some.positions(k).tolist() for k in range(3)] == [[2, 4], [1, 3], []]
    assert sorted(some.order.tolist()) == [1, 2, 3, 4]
