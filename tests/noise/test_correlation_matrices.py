"""Correlation along the rows that a file states, against dense covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.cli.main import run
from tests.noise.peer import linear, sigmas, table, values
from tests.noise.test_shared_noise import COMMON, DATA, DAY, LINE, SHARED, UNKNOWNS, N, X, Y, check


def _with_matrix(folder, matrix, options=":sigma 0.3", rest=""):
    folder.mkdir(exist_ok=True)
    np.savetxt(folder / "matrix.csv", matrix, delimiter=",", fmt="%.17g")
    text = f"""(problem p {DATA} {UNKNOWNS}
      (observe r (= y (+ a (* b x))) {options} :correlation (matrix "matrix.csv") {rest}))"""
    (folder / "p.mbm").write_text(text, encoding="utf-8")
    return folder / "p.mbm"


MATRIX = 0.7 * np.exp(-np.abs(np.subtract.outer(X, X))) + 0.3 * np.eye(N)


def test_stated_correlation_matrix(tmp_path):
    check(mbm.load(_with_matrix(tmp_path, MATRIX)).solve(), 0.09 * MATRIX)
    check(mbm.load(_with_matrix(tmp_path, MATRIX, f":sigma 0.3 {COMMON}")).solve(), 0.09 * MATRIX + SHARED)


def test_correlation_matrix_of_rows_that_are_used(tmp_path):
    path = _with_matrix(tmp_path, MATRIX, ":sigma unknown", ":when (not (= day 2))")
    used = np.flatnonzero(DAY != 2)
    fit = linear(LINE[used], Y[used], MATRIX[np.ix_(used, used)])
    result = mbm.load(path).solve()
    factor = np.sqrt(fit.cost / (len(used) - 2))
    assert result.noise["r"] == pytest.approx(factor, rel=1e-9)
    np.testing.assert_allclose(values(result, "a", "b"), fit.x, rtol=1e-9)
    np.testing.assert_allclose(sigmas(result, "a", "b"), factor * fit.sigma, rtol=1e-9)


def test_simulated_problem_with_a_correlation_matrix_reads_its_own_copy(tmp_path):
    path = _with_matrix(tmp_path / "first", MATRIX)
    made = mbm.load(path).simulate(at={"a": 1.0, "b": 2.0}, seed=1)
    assert np.asarray(made["r"]["y"]).shape == (N,)
    (tmp_path / "at.json").write_text('{"a": 1, "b": 2}')
    assert (
        run(["simulate", str(path), "--at", str(tmp_path / "at.json"), "--seed", "1", "-o", str(tmp_path / "s")]) == 0
    )
    again = mbm.load(tmp_path / "s" / "p.mbm").solve()
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "s" / "matrix.csv", delimiter=","), MATRIX)
    np.testing.assert_allclose(sigmas(again, "a", "b"), linear(LINE, Y, 0.09 * MATRIX).sigma, rtol=1e-9)


def test_simulation_draws_a_stated_correlation(tmp_path):
    near = np.kron(np.eye(500), 0.2 * np.eye(4) + 0.8)
    np.savetxt(tmp_path / "near.csv", near, delimiter=",", fmt="%g")
    text = f"""(problem p {table("r", y=np.zeros(2000))} (unknowns (a :init 0))
      (observe r (= y a) :sigma 1 :correlation (matrix "near.csv")))"""
    (tmp_path / "p.mbm").write_text(text, encoding="utf-8")
    drawn = np.asarray(mbm.load(tmp_path / "p.mbm").simulate(at={"a": 0.0}, seed=2)["r"]["y"]).reshape(500, 4)
    # 4 standard errors of a covariance of 500 pairs, at most sqrt(2/500) each
    assert (np.abs(drawn.T @ drawn / 500 - (0.2 * np.eye(4) + 0.8)) < 4 * np.sqrt(2 / 500)).all()


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (np.eye(3), "has 3 rows, and `r` 24"),
        (2 * np.eye(N), "diagonal"),
        (np.eye(N) + np.diag(np.full(N - 1, 0.1), 1), "not symmetric"),
        (np.eye(N) + 2 * (np.ones((N, N)) - np.eye(N)), "not positive definite"),
        (np.full((N, N), np.nan), "not symmetric"),
    ],
)
def test_what_is_no_correlation_matrix_is_refused(tmp_path, matrix, said):
    with pytest.raises(mbm.MbmError, match=said):
        mbm.load(_with_matrix(tmp_path, matrix)).solve()


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "empty-file"),
        (b"1,0\n0", "short-row"),
        (b"1,0\n0,1,0\n", "long-row"),
        (b"1,x\n0,1\n", "malformed-record"),
        (b"# nothing\n", "malformed-record"),
        (b"1\n" * 2001, "malformed-record"),
        (b"\xff\xfe", "not-text"),
    ],
)
def test_files_that_are_no_matrices(tmp_path, content, code):
    path = _with_matrix(tmp_path, MATRIX)
    (tmp_path / "matrix.csv").write_bytes(content)
    with pytest.raises(mbm.MbmError) as error:
        mbm.load(path).solve()
    assert {d.code.name for d in error.value.diagnostics} == {code}
