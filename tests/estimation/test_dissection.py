"""What can be solved before what: the stick figure, chains, rings, and problems that cannot be taken apart."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from mbm.estimation.search.dissection import Mention, dissected


def mention(*columns, size=1):
    return Mention(columns=frozenset(columns), size=size)


def test_the_stick_figure():
    """Six points on the trunk for its pose and the waist; then each limb in two steps, and the head in one."""
    pose, waist = range(6), 6
    trunk = [mention(3, 4, 5, size=2)]
    trunk += [mention(*pose, size=2)] * 3 + [mention(*pose, waist, size=2)] * 2
    head = [mention(*pose, waist, 7, 8, size=2)]
    limb = [mention(*pose, waist, 10, 11, size=2), mention(*pose, waist, 9, 10, 11, 12, size=2)]
    found = dissected([*limb, *head, *trunk], 13)
    assert [p.columns for p in found.trunk] == [(0, 1, 2, 3, 4, 5), (6,)]
    assert [p.equations for p in found.trunk] == [(3, 4, 5, 6), (7, 8)]
    branches = sorted(tuple(p.columns for p in branch) for branch in found.branches)
    assert branches == [((7, 8),), ((10, 11), (9, 12))]
    assert {p.equations for branch in found.branches for p in branch} == {(2,), (0,), (1,)}


def test_a_chain_is_solved_link_by_link():
    found = dissected([mention(0), mention(0, 1), mention(1, 2), mention(2, 3)], 4)
    assert found.trunk == ()
    assert [[p.columns for p in branch] for branch in found.branches] == [[(0,), (1,), (2,), (3,)]]


def test_unrelated_unknowns_are_branches_of_their_own():
    found = dissected([mention(0), mention(1), mention(2, 3), mention(2, 3)], 4)
    assert sorted(tuple(p.columns for p in b) for b in found.branches) == [((0,),), ((1,),), ((2, 3),)]


@pytest.mark.parametrize(
    ("equations", "count"),
    [
        ([mention(0, 1, 2)] * 7, 3),  # a curve: every point has to do with every parameter
        ([mention(0, 1), mention(1, 2), mention(2, 0)], 3),  # a ring
        ([mention(0), mention(1), mention(0, 1)], 3),  # an unknown that nothing mentions
        ([mention(0, 1, 2), mention(0)], 3),  # too few equations
        ([], 0),
    ],
)
def test_what_is_solved_all_together(equations, count):
    assert dissected(equations, count) is None


@given(st.lists(st.frozensets(st.integers(0, 7), min_size=1, max_size=4), min_size=1, max_size=24))
def test_every_unknown_and_equation_has_its_place(columns):
    equations = [Mention(columns=c, size=1) for c in columns]
    found = dissected(equations, 8)
    matrix = np.zeros((len(columns), 8), dtype=int)
    for i, c in enumerate(columns):
        matrix[i, sorted(c)] = 1
    rank = int((maximum_bipartite_matching(csr_matrix(matrix), perm_type="column") >= 0).sum())
    if found is None:
        return
    assert rank == 8
    solved: set[int] = set()
    parts = [*found.trunk, *itertools.chain.from_iterable(found.branches)]
    for part in parts:
        assert not solved & set(part.columns)
        solved |= set(part.columns)
        assert len(part.equations) >= len(part.columns) or part in found.trunk
        assert all(equations[i].columns <= solved for i in part.equations)
        assert all(equations[i].columns & set(part.columns) for i in part.equations)
    assert solved == set(range(8))
    assert sorted(i for p in parts for i in p.equations) == list(range(len(columns)))
    for branch in found.branches:
        assert sum(len(p.equations) for p in branch) == sum(len(p.columns) for p in branch)
