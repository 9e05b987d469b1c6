"""Which unknowns are left without an equation of their own: against the rank of random matrices of the structure."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.problem.structure import _unmatched


def structural_rank(mentions, scalars, generator):
    """The rank of a matrix with random entries where an equation mentions a number: the structural rank."""
    matrix = np.zeros((len(mentions), len(scalars)))
    for row, each in enumerate(mentions):
        for scalar in each:
            matrix[row, scalars.index(scalar)] = generator.normal()
    return int(np.linalg.matrix_rank(matrix))


@pytest.mark.parametrize("seed", range(60))
def test_as_many_are_left_as_the_structural_rank_lacks(seed):
    generator = np.random.default_rng(seed)
    count, equations = int(generator.integers(1, 12)), int(generator.integers(1, 14))
    scalars = [("a", float(i), ()) for i in range(count)]
    mentions = [
        frozenset(scalars[i] for i in generator.integers(0, count, int(generator.integers(0, 4))))
        for _ in range(equations)
    ]
    left = _unmatched(mentions, scalars)
    assert len(left) == count - structural_rank(mentions, scalars, generator)
    assert set(left) <= set(scalars)


@pytest.mark.parametrize(
    ("fixed", "codes"),
    [
        ('(= id "nort")', ["fixed-nowhere"]),
        ("(< z 0)", ["fixed-nowhere"]),
        ("[false (= z 7)]", ["fixed-nowhere"]),
        ('(= id "north")', []),
        ("(< z 2)", []),
        ("[false (= z 1)]", []),
        ("false", []),
        ("true", []),
    ],
)
def test_a_condition_that_fixes_no_member_is_said(fixed, codes):
    text = f"""(problem p
      (data stations (table (id z) (north 1) (south 2)) :key id)
      (data t (table (at x y) (north 1 5) (south 2 6)))
      (unknowns (h (vector 2) :per stations :init [1 1] :fixed {fixed}))
      (observe t (= [x y] (h at)) :sigma 1))"""
    assert [d.code.name for d in mbm.loads(text).check()] == codes


def test_members_that_begin_outside_their_bounds_are_counted():
    text = """(problem p (data s (table (id at) (1 0.5) (2 7) (3 -1)) :key id) (data t (table (id y) (1 1) (2 2) (3 3)))
      (unknowns (h :per s :init at :in (0 5)) (k :init 5 :in (0 5)) (v (vector 2) :init [1 2] :in (0 5)))
      (observe t (= y (+ (h id) k (v 1) (v 2))) :sigma 1) (observe (= [1 1] v) :sigma 1) (observe (= 5 k) :sigma 1))"""
    found = [each.message for each in mbm.loads(text).check() if each.code.name == "start-outside-bounds"]
    assert found == ["the `:init` of 2 members of `h` lies outside `:in`"]
