"""Solves with constraints made together: their documents, and closed forms of small ones."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from scipy.linalg import null_space

import mbm
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.report.many import many_solves
from mbm.report.solve_columns import solve_columns
from mbm.report.solve_document import solve_document
from mbm.text.shown import Paint
from tests.estimation.many.constrained import PLANES, PROBLEMS, lines
from tests.estimation.many.test_together import numbers_apart

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

PUSHED = {  # in some solves, and not in others
    *("an inequality", "an inequality, unknown noise", "both", "both, unknown noise", "said twice", "of rows"),
    *("affine", "affine, unknown noise", "affine without a start", "a prior", "a loss", "rotations", "bounds"),
    *("windows", "windows of unknown noise", "exact"),
}
MADE_TOGETHER = sorted(
    PUSHED | {"an equation", "an equation, unknown noise", "an unknown that an equation alone determines"}
)
LEFT_APART = {"everything held", "far from the data", "a contradiction"}
"""Solves made together of which each is looked at by itself."""

DRAWN = {"consensus", "a loss that is not convex"}
"""Whose subsets native code draws otherwise than the general path."""


REPEATED = {"windows of unknown noise", "both, unknown noise", "affine, unknown noise", "affine without a start"}
"""What others show part by part: windows, unknown noise, both kinds of constraints, no start. Each takes seconds."""


@functools.cache
def solved(name):
    """The solves of a problem, made once for all that is said of them here."""
    text, data = PROBLEMS[name]
    return mbm.loads(text).solve(data=data)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in REPEATED else n for n in PROBLEMS])
def test_documents_agree_with_those_of_solves_one_by_one(name):
    """Of the general path in Python, tolerances as `numbers_apart` argues them."""
    text, data = PROBLEMS[name]
    made = solved(name)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mbm.estimation.batches.together.FEW_SOLVES", 1_000)
        plain = mbm.loads(text).solve(data=data, backend="auto" if name in DRAWN else "numpy")
    assert not isinstance(plain.result.solves, ManyReports)
    assert isinstance(made.result.solves, ManyReports) == (name in {*MADE_TOGETHER, *LEFT_APART})
    assert list(numbers_apart(plain.document(), made.document())) == []


@pytest.mark.parametrize("name", MADE_TOGETHER)
def test_these_are_made_together(name):
    """Most are answered in columns of those that no inequality holds: where one lets go is looked for one by one.

    Nothing is derived here: near a limit what is derived is looked at one by one, too.
    """
    text, data = PROBLEMS[name]
    solves = mbm.loads(re.sub(r"\n *\(derive .*\)(?=\n)", "", text)).solve(data=data).result.solves
    clean = np.concatenate([block.block.columns.clean for block in solves.blocks])
    pushed = np.concatenate([block.block.columns.limits.pushed.any(axis=1) for block in solves.blocks])
    assert clean.sum() > (~pushed).sum() / 2
    assert not (clean & pushed).any()
    assert bool(pushed.any()) == (name in PUSHED)


@pytest.mark.parametrize("name", MADE_TOGETHER)
def test_documents_from_columns_are_those_of_the_reports(name):
    made = [solve_document(solve) for solve in solved(name).result.solves]
    written = solved(name).document()["solves"]
    assert [list(solve) for solve in written] == [list(solve) for solve in made]
    assert written == made


@pytest.mark.parametrize("name", ["both", "windows", "of rows", "a loss"])
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


@pytest.mark.parametrize("name", ["both", "affine, unknown noise"])
def test_tables_and_texts_are_those_of_the_reports(name):
    """The warning that constraints hold the estimates counts the solves that have it."""
    solves = solved(name).result.solves
    columns, plain = solve_columns(solves), solve_columns(tuple(solves))
    assert columns.statuses == plain.statuses
    assert columns.fits == plain.fits
    shown = [list(many_solves(each, 100, Paint(False), True)) for each in (solves, tuple(solves))]
    assert shown[0] == shown[1]
    assert "more like it" in " ".join(" ".join(shown[0]).split())


@pytest.mark.parametrize("sigma", ["0.1", "unknown"])
def test_affine_solves_are_those_of_linear_algebra(sigma):
    """On ``A x = b``, x is ``x₀ + Z w`` with Z the null space of A; ``b <= 0.5`` holds where it is missed without."""
    data = lines()
    text = PLANES.format(start="", sigma=sigma, constraints="(= (+ b e) 0.5 :name total) (<= b 0.5 :name most)")
    solves = mbm.loads(text).solve(data=data).solves
    held = 0
    for group, solve in enumerate(solves):
        mine = data["d"]["g"] == group
        x, y, z = (data["d"][name][mine] for name in "xyz")
        design, rows, values = np.column_stack([np.ones(len(x)), x, y]) / 0.1, [[0, 1, 1]], [0.5]
        estimates, covariance, cost, freedom = on_surface(design, z / 0.1, rows, values)
        if estimates[1] > 0.5:
            estimates, covariance, cost, freedom = on_surface(design, z / 0.1, [*rows, [0, 1, 0]], [*values, 0.5])
            held += 1
            assert [c.active for c in solve.constraints] == [True, True]
            assert solve.constraints[1].value == pytest.approx(0.0, abs=1e-9)  # 1e-8 standard deviations of 0.05
        else:
            assert solve.constraints[1].value == pytest.approx(0.5 - estimates[1], abs=1e-10)
        if sigma == "unknown":
            covariance, cost = covariance * cost / freedom, cost * 0.1**2
        # the next step is below 1e-10 standard deviations of some hundredths; costs follow to second order
        np.testing.assert_allclose([e.value for e in solve.estimates], estimates, rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            [e.sigma for e in solve.estimates], np.sqrt(np.diag(covariance)), rtol=1e-9, atol=1e-14
        )
        assert solve.cost == pytest.approx(cost, rel=1e-9)
        assert solve.dof == freedom
        assert solve.derived[0].sigma == pytest.approx(0.0, abs=1e-14)
    assert 5 < held < 25


def on_surface(design, right, rows, values):
    """Estimates, covariance, cost and degrees of freedom of ``design @ x ≈ right`` with ``rows @ x = values``."""
    free = null_space(np.array(rows, dtype=float))
    some = np.linalg.lstsq(np.array(rows, dtype=float), np.array(values), rcond=None)[0]
    along = design @ free
    moved = np.linalg.lstsq(along, right - design @ some, rcond=None)[0]
    estimates = some + free @ moved
    cost = float(np.square(design @ estimates - right).sum())
    return estimates, free @ np.linalg.inv(along.T @ along) @ free.T, cost, len(right) - free.shape[1]


def test_what_no_equation_feels_is_left_to_the_general_path():
    """A derivative that vanishes beside the curvature is none, though machine code finds a minimum of full rank."""
    rows = np.repeat(np.arange(12), 6)
    text = "(problem s (data d external) (unknowns (t :init 1e-12)) (observe d (= y (cos t)) :sigma 0.01) (for-each k))"
    solves = mbm.loads(text).solve(data={"d": {"k": rows, "y": np.ones(72)}}).solves
    assert {solve.status for solve in solves} == {"unobservable"}
