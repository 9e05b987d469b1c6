"""Subsets of units → points in closed form, and how rows are shared out: counted by hand and by NumPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mbm.estimation.starts.closed_forms.completion import _by_member
from mbm.estimation.starts.closed_forms.minimal import MinimalSolver
from mbm.estimation.starts.closed_forms.types import _distinct


def test_each_subset_of_known_units_has_its_point():
    """A closed form that adds its rows: subsets with the first unit, with one that is not known, with none."""
    form = SimpleNamespace(solve=lambda _, rows: rows.sum(axis=1)[:, None, None] * np.ones((1, 1, 2)))
    plan = SimpleNamespace(form=form, minimal=2, candidate=SimpleNamespace(places=np.array([[2, 0]])))
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
