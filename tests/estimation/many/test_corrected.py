"""Solves with errors in measured columns made together: documents of solves one by one, corrections, York's lines."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.report.solve_columns import solve_columns
from mbm.report.solve_document import solve_document
from tests.estimation.many.measured import PROBLEMS
from tests.estimation.many.test_together import numbers_apart

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

ONE_BY_ONE = {
    *("more equations than values", "used twice", "marks seen twice"),
    *("beside unknown noise", "a circle, a loss that is not convex", "a circle, consensus"),
}
LEFT_APART = {"noise that is too large", "an inequality"}
"""Solves made together of which each is looked at by itself."""

DRAWN = {"a circle, consensus", "a circle, a loss that is not convex"}
TOGETHER = [name for name in PROBLEMS if name not in ONE_BY_ONE]


def one_by_one(problem, data, **options):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mbm.estimation.batches.together.FEW_SOLVES", 1_000)
        made = problem.solve(data=data, **options)
    assert not isinstance(made.result.solves, ManyReports)
    return made


def split(document):
    """The document without the corrections, and these by solve, table and column."""
    found = [solve.pop("corrections", {}) for solve in document["solves"]]
    flat = {}
    for number, tables in enumerate(found):
        for table, columns in tables.items():
            flat |= {(number, table, column): each for column, each in columns.items()}
    return document, flat


@functools.cache
def solved(name):
    """The solves of a problem, made once for all that is said of them here."""
    text, data = PROBLEMS[name]
    return mbm.loads(text).solve(data=data)


@pytest.mark.parametrize("name", PROBLEMS)
def test_documents_agree_with_those_of_solves_one_by_one(name):
    """Of the general path in Python; tolerances as `numbers_apart` argues them."""
    text, data = PROBLEMS[name]
    problem = mbm.loads(text)
    made = solved(name)
    plain = one_by_one(problem, data, backend="auto" if name in DRAWN else "numpy")
    assert isinstance(made.result.solves, ManyReports) == (name not in ONE_BY_ONE)
    (expected, theirs), (found, ours) = split(plain.document()), split(made.document())
    assert list(numbers_apart(expected, found)) == []
    assert theirs.keys() == ours.keys()
    for key, column in theirs.items():
        own = ours[key]
        assert {**own, "value": None} == {**column, "value": None}
        # the searches for the nearest points end before a step of 1e-10 standard deviations as extrapolated, in rows
        # together; far from the curve the extrapolation is a guess
        np.testing.assert_allclose(own["value"], column["value"], rtol=0, atol=1e-7 * max(column["sigma"]))


@pytest.mark.parametrize("name", [name for name in TOGETHER if name not in LEFT_APART])
def test_these_are_made_together(name):
    solves = solved(name).result.solves
    assert isinstance(solves, ManyReports)
    held = [block.block.columns.limits for block in solves.blocks]
    free = len(solves) - sum(each.pushed.any(axis=1).sum() for each in held if each is not None)
    assert sum(block.block.columns.clean.sum() for block in solves.blocks) > free / 2


@pytest.mark.parametrize("name", TOGETHER)
def test_documents_from_columns_are_those_of_the_reports(name):
    made = [solve_document(solve) for solve in solved(name).result.solves]
    written = solved(name).document()["solves"]
    assert [list(solve) for solve in written] == [list(solve) for solve in made]
    assert written == made


@pytest.mark.parametrize(
    "name", ["a line", "a circle, a loss", "points at the centre", "windows", "marks of all solves"]
)
def test_any_number_of_workers_gives_the_same_document(name, monkeypatch):
    """With so few rows in a slice that there are several."""
    monkeypatch.setattr("mbm.estimation.batches.stack.ROWS_AT_ONCE", 60)
    text, data = PROBLEMS[name]
    compiled = mbm.loads(text).compile(data=data)
    documents = []
    for workers in (1, 3):
        document = compiled.solve(workers=workers).document()
        for solve in document["solves"]:
            solve.pop("seconds")
        documents.append(document)
    assert all(document == documents[0] for document in documents)


@pytest.mark.parametrize("name", ["a line", "points at the centre"])
def test_columns_say_what_the_reports_say(name):
    result = solved(name).result
    columns, plain = solve_columns(result.solves), solve_columns(tuple(result.solves))
    assert columns.statuses == plain.statuses
    assert columns.fits == plain.fits
    for one, other in zip(columns.scalars, plain.scalars, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.sigmas, other.sigmas)


def test_lines_are_those_of_york():
    """York's cost (1966) is stationary there; corrections lead onto the line, along the covariance of the points."""
    columns = PROBLEMS["a line"][1]["d"]
    for solve in solved("a line").document()["solves"]:
        mine = columns["k"] == solve["key"]["k"]
        x, y = columns["x"][mine], columns["y"][mine]
        m, c = (solve["estimates"][name]["value"] for name in "mc")
        # the gradient of York's cost Σ (y - c - m x)² / (0.2² + 0.1² m²) is zero
        gap, weight = y - c - m * x, 1 / (0.2**2 + 0.1**2 * m**2)
        slopes = [-2 * weight * gap.sum(), -2 * (weight * gap @ x + weight**2 * 0.1**2 * m * gap @ gap)]
        scale = 2 * weight * np.abs(gap) @ (1 + np.abs(x))
        np.testing.assert_allclose(slopes, 0.0, atol=1e-9 * scale)  # 1e-10 of the steps of Newton's method
        assert solve["cost"] == pytest.approx(weight * gap @ gap, rel=1e-12)
        corrections = solve["corrections"]["d"]
        assert corrections["x"]["rows"] == (np.flatnonzero(mine) + 1).tolist()
        # Lagrange: v = Σ Bᵀ (B Σ Bᵀ)⁻¹ times what is left, of a plane condition at once
        np.testing.assert_allclose(corrections["x"]["value"], 0.1**2 * m * weight * gap, atol=1e-13)
        np.testing.assert_allclose(corrections["y"]["value"], -(0.2**2) * weight * gap, atol=1e-13)


def test_errors_of_a_column_that_no_equation_has_are_no_hindrance() -> None:
    problem = mbm.loads("""(problem p (data d (table (id x y) (1 0 1) (1 1 3) (2 0 4) (2 1 8)))
      (unknowns (a :init 1)) (observe d (= y a) :sigma 1 :errors ((x 0.1))) (for-each id))""")
    for backend in ("numpy", "native"):
        found = [float(solve.estimates[0].value) for solve in problem.solve(backend=backend).solves]
        assert found == pytest.approx([2.0, 6.0])
