"""Matrices that stand in the columns of a row: as a whole, by element, renamed, joined, paired, as information."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

GRAPH = """VERTEX_SE2 4 0 0 0
VERTEX_SE2 9 1 2 0.5
EDGE_SE2 4 9 1 2 0 5 1 0 7 2 9
EDGE_SE2 9 4 1 2 0 6 0 1 8 1 7
"""
"""Edges that do not turn: their information is that of the file with the rotation first."""
MATRICES = np.array([[[9, 0, 2], [0, 5, 1], [2, 1, 7]], [[7, 1, 1], [1, 6, 0], [1, 0, 8]]], dtype=float)
EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""


@pytest.fixture
def solve(tmp_path):
    (tmp_path / "d.g2o").write_text(GRAPH)

    def call(text):
        return mbm.loads(text, base=tmp_path).solve()

    return call


def problem(observe, data="", unknowns="(a :init 0)"):
    edges = f'(data edges (g2o "d.g2o" :edges) {data})'
    return f'(problem p (data nodes (g2o "d.g2o" :vertices)) {edges} (unknowns {unknowns}) {observe})'


def test_elements_and_columns_are_the_same_numbers(solve):
    observe = "(observe edges (= (information 3 2) a) :sigma 1) (observe e edges (= information23 a) :sigma 1)"
    assert float(solve(problem(observe))["a"].value) == pytest.approx(MATRICES[:, 1, 2].mean(), rel=EXACT)


def test_the_whole_is_a_matrix(solve):
    observe = "(observe edges (= (@ information [1 10 100]) v) :sigma 1)"
    solved = solve(problem(observe, unknowns="(v (vector 3) :init 0)"))
    wanted = (MATRICES @ [1, 10, 100]).mean(axis=0)
    np.testing.assert_allclose(solved["v"].value, wanted, rtol=EXACT)


def test_it_weighs_observations(solve):
    observe = "(observe edges (= [dtheta dx dy] (+ v [0 (* row 1) 0])) :information information)"
    solved = solve(problem(observe, unknowns="(v (vector 3) :init 0)"))
    measured = np.array([[0, 1 - 1, 2], [0, 1 - 2, 2]], dtype=float)
    whole = MATRICES.sum(axis=0)
    wanted = np.linalg.solve(whole, np.einsum("nij,nj->i", MATRICES, measured))
    np.testing.assert_allclose(solved["v"].value, wanted, atol=1e-14)
    np.testing.assert_allclose(solved.covariance.matrix, np.linalg.inv(whole), atol=1e-14)


def test_renamed_columns_stay_in_their_places(solve):
    observe = "(observe edges (= (+ (information 1 3) corner) a) :sigma 1)"
    text = problem(observe, data=":columns ((corner information13))")
    assert float(solve(text)["a"].value) == pytest.approx(2 * MATRICES[:, 0, 2].mean(), rel=EXACT)


def test_it_comes_along_when_tables_are_joined_and_paired(solve):
    text = """
    (problem p
      (data edges (g2o "d.g2o" :edges) :key from)
      (data seen (table (t edge y) (1 4 3) (2 9 5)) :with (edges edge))
      (data other (table (t z) (1 0) (2 0)))
      (pair both (seen other) :by t)
      (unknowns (a :init 0) (b :init 0))
      (observe seen (= (edges.information 2 2) a) :sigma 1)
      (observe both (= (seen.edges.information 3 3) b) :sigma 1))
    """
    solved = solve(text)
    assert float(solved["a"].value) == pytest.approx(MATRICES[:, 1, 1].mean(), rel=EXACT)
    assert float(solved["b"].value) == pytest.approx(MATRICES[:, 2, 2].mean(), rel=EXACT)


def test_the_key_that_the_format_has_is_there_and_may_be_renamed(solve):
    text = """
    (problem p
      (data nodes (g2o "d.g2o" :vertices) :columns ((node id)))
      (unknowns (h :per nodes :init theta))
      (observe nodes (= x (h node)) :sigma 1)
      (derive (second (h 9))))
    """
    solved = solve(text)
    assert solved["h"].keys == (4, 9)
    assert float(solved["second"].value) == pytest.approx(1, rel=EXACT)


def test_a_name_that_is_an_unknown_too_is_ambiguous(solve):
    with pytest.raises(mbm.MbmError, match="ambiguous-name"):
        solve(problem("(observe edges (= dx (information 1 1)))", unknowns="(information :init 0)"))
