"""Static columns: only the rows that are used decide what equations there are, and a gap among them is an error."""

from __future__ import annotations

import math

import pytest

import mbm

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""

PROBLEM = "(problem p (data t external) (unknowns (a (array 2))) (observe t (= y (a j)) :sigma 1{}))"


def test_rows_that_when_leaves_out_need_no_element(solve):
    answer = solve(PROBLEM.format(" :when (< j 3)"), data={"t": {"j": [1, 2, 3, 1], "y": [1, 2, 90, 3]}})
    assert answer["a"].value == pytest.approx([2, 2], rel=EXACT)


def test_a_gap_in_a_static_column_may_be_left_out(solve):
    answer = solve(PROBLEM.format(" :when (finite j)"), data={"t": {"j": [1, 2, math.nan], "y": [1, 2, 90]}})
    assert answer["a"].value == pytest.approx([1, 2], rel=EXACT)


def test_when_may_need_a_static_column_itself(solve):
    text = (
        "(problem p (data t external) (unknowns (a (array 2)))"
        " (observe t (= y (a j)) :sigma 1 :when (< ([1 5 1] k) 2)))"
    )
    answer = solve(text, data={"t": {"j": [1, 9, 2], "k": [1, 2, 3], "y": [4, 90, 6]}})
    assert answer["a"].value == pytest.approx([4, 6], rel=EXACT)


@pytest.mark.parametrize("cell", [math.nan, math.inf])
def test_a_static_value_that_is_no_number_is_named_by_its_cell(faults, cell):
    found = faults(PROBLEM.format(""), data={"t": {"j": [1, 2, cell], "y": [1, 2, 3]}})
    assert [d.code.name for d in found] == ["not-finite-cell"]
    assert (found[0].place.row, found[0].place.column) == (3, "j")


def test_an_observation_that_leaves_out_all_rows_says_so():
    found = mbm.loads(PROBLEM.format(" :when (< j 0)")).check(data={"t": {"j": [1, 2], "y": [1, 2]}})
    assert "no-rows" in [d.code.name for d in found]


def test_other_data_may_keep_other_rows(solve):
    compiled = mbm.loads(PROBLEM.format(" :when (< j 3)")).compile(data={"t": {"j": [1, 3], "y": [1, 90]}})
    answer = compiled.solve(data={"t": {"j": [2, 1, 3], "y": [7, 8, 90]}})
    assert answer["a"].value == pytest.approx([8, 7], rel=EXACT)
