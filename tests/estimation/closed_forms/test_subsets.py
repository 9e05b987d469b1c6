"""Subsets of units → points in closed form, and how rows are shared out: counted by hand and by NumPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mbm.estimation.starts.closed_forms.completion import _by_member, _plans_of
from mbm.estimation.starts.closed_forms.minimal import MinimalSolver
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import Plan, _distinct


def plan_of(form):
    """Of two unknown numbers."""
    candidate = SimpleNamespace(places=np.array([[2, 0]]))
    return Plan(form=form, candidate=candidate, rows=Rows.without_numbers(50, 1), minimal=2, data=None)


@pytest.mark.parametrize("joint", [False, True])
def test_a_singular_matrix_of_one_subset_is_no_solution_of_it_alone(joint):
    """Equal rows have no solution; others two, or one if their sum is odd."""

    def solve(_, rows):
        matrices = np.stack([[np.ones(2), row] for row in rows])
        found = np.linalg.solve(matrices, np.ones((len(rows), 2, 1)))[..., 0]
        return np.stack([found, -found], axis=1)[:, : 1 if int(rows.sum()) % 2 else 2]

    plan = plan_of(SimpleNamespace(solve=solve, joint=joint))
    found = plan.solved(np.array([[3, 1], [5, 5], [1, 2]]))
    np.testing.assert_allclose(found[0], [[0, 1], [0, -1]], atol=1e-15)  # x + y = 1, 3 x + y = 1
    assert np.isnan(found[1]).all()
    np.testing.assert_allclose(found[2], [[1, 0], [np.nan, np.nan]], atol=1e-15)
    assert np.isnan(plan.solved(np.array([[5, 5]]))).all()


def test_a_singular_matrix_where_a_form_looks_is_no_plan_of_it_alone():
    def looking(_, candidate):
        np.linalg.inv(np.zeros((2, 2)))

    candidate = SimpleNamespace(situation=None, coupled=False, paired=False, places=np.array([[2, 0]]))
    sound = SimpleNamespace(recognises=lambda *_: plan_of(None), joint=False)
    found = list(_plans_of(candidate, (SimpleNamespace(recognises=looking, joint=False), sound)))
    assert [len(plan.rows) for plan in found] == [50]


def test_each_subset_of_known_units_has_its_point():
    """A closed form that adds its rows: subsets with the first unit, with one that is not known, with none."""
    form = SimpleNamespace(solve=lambda _, rows: rows.sum(axis=1)[:, None, None] * np.ones((1, 1, 2)))
    plan = plan_of(form)
    solver = SimpleNamespace(row_of=np.array([10, 20, -1, 40]), plan=plan, base=np.array([7.0, 8.0, 9.0]))
    points, owners = MinimalSolver.points(solver, np.array([[0, 1], [1, 2], [3, 0], [1, -1], [1, 4], [1, 3]]))
    assert owners.tolist() == [0, 2, 5]
    assert points.tolist() == [[30, 8, 30], [50, 8, 50], [60, 8, 60]]


def test_rows_of_each_member():
    found = _by_member(np.array([2, 0, 2, 3, 0, 2]), 5)
    assert [rows.tolist() for rows in found] == [[1, 4], [], [0, 2, 5], [3], []]


def test_lines_that_differ():
    lines = np.random.default_rng(1).integers(0, 3, (60, 3))
    np.testing.assert_array_equal(_distinct(lines), np.unique(lines, axis=0))
    assert _distinct(lines[:1].repeat(4, axis=0)).tolist() == lines[:1].tolist()
