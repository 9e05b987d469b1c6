"""Solves made together say what solves made one by one say: documents, tables, CSV, for any number of threads."""

from __future__ import annotations

import copy
import functools
import io

import numpy as np
import pytest

import mbm
from mbm.equations.interruption import Interruption
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.report.exports import write_solves
from mbm.report.options import SolveSettings
from mbm.report.solve_columns import solve_columns
from mbm.report.solve_document import solve_document
from tests.estimation.many.problems import PROBLEMS, RANGES

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

DRAWN = {"unknown", "(solve", "cauchy)", "cauchy", "tukey)"}
"""What tells that subsets are drawn, which native code does alike only."""

MADE_TOGETHER = [
    *("ranges", "unknown noise", "filtered", "fixed", "rotations", "scattered", "linear", "consensus"),
    *("a loss", "a loss that is wide", "a loss of vectors"),
    *("windows", "windows with few rows", "windows of unknown noise", "windows without a start", "windows of a loss"),
    *("without a start", "without a start, unknown noise", "without a start, a loss", "poses without a start"),
    *("lines without a start", "two kinds of rows", "a loss beside others", "two losses", "a loss that is not convex"),
    *("two losses that are not convex", "consensus of two kinds", "consensus with a prior"),
    *("consensus of unknown noise", "consensus of images", "windows of a loss that is not convex"),
    *("a loss of unknown noise", "a loss of unknown noise that is not convex"),
    *("two unknown noises", "one unknown noise of two", "unknown noise and a prior", "linear, two unknown noises"),
    *("windows of consensus", "windows of consensus without a start"),
    *("a loss of unknown noise beside others", "a loss of unknown noise that is not convex beside others"),
    *("a loss of unknown noise and a prior", "two losses of unknown noise", "losses of noise known and unknown"),
    *("losses of unknown noise and a prior", "a loss beside unknown noise"),
    *("a loss that is not convex beside unknown noise", "a loss of unknown noise beside unknown noise"),
    *("windows of two unknown noises", "windows of a loss of unknown noise"),
    *("windows of a loss of unknown noise and a prior", "windows of consensus of two unknown noises"),
    *("consensus of two unknown noises", "consensus of one unknown noise of two"),
]


def numbers_apart(first, second, path="", apart=1e-9):
    """Where two documents differ: texts anywhere, numbers by more than roundings in another order make of them."""
    if isinstance(first, dict) and isinstance(second, dict):
        if first.get("dof") == 0:  # whether residuals are zero or cannot get smaller is a matter of roundings
            first, second = {**first, "message": ""}, {**second, "message": ""}
        if first.keys() != second.keys():
            yield path, sorted(first), sorted(second)
            return
        for name in first:
            if name not in ("seconds", "backend", "iterations", "evaluations"):
                yield from numbers_apart(first[name], second[name], f"{path}/{name}", apart)
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for i, (one, other) in enumerate(zip(first, second, strict=True)):
            yield from numbers_apart(one, other, f"{path}/{i}", apart)
    elif isinstance(first, float) and isinstance(second, float):
        # Both paths end where the next step is below 1e-10 standard deviations, which here are 1e-3 to 1e-2; costs and
        # covariances follow from there to second and to first order.
        if abs(first - second) > apart * max(abs(first), abs(second)) + 1e-11:
            yield path, first, second
    elif first != second:
        yield path, first, second


@functools.cache
def solved(name):
    """The solves of a problem, made once for all that is said of them here."""
    text, data = PROBLEMS[name]
    return mbm.loads(text).solve(data=data)


@pytest.mark.parametrize("name", PROBLEMS)
def test_documents_agree_with_those_of_solves_one_by_one(name):
    text, data = PROBLEMS[name]
    made = solved(name)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mbm.estimation.batches.together.FEW_SOLVES", 1_000)
        # the subsets of consensus are drawn alike in native code only
        plain = mbm.loads(text).solve(data=data, backend="auto" if DRAWN & set(text.split()) else "numpy")
    assert not isinstance(plain.result.solves, ManyReports)
    # How much the rows kept say follows from residuals where consensus ends, within 1e-6 deviations of the fit.
    apart = 1e-7 if ":robust" in text else 1e-9
    assert list(numbers_apart(plain.document(), made.document(), apart=apart)) == []


@pytest.mark.parametrize("name", MADE_TOGETHER)
def test_these_are_made_together(name):
    """And not by the way that takes over where something is unusual."""
    solves = solved(name).result.solves
    assert isinstance(solves, ManyReports)
    assert sum(block.block.columns.clean.sum() for block in solves.blocks) > len(solves) / 2


@pytest.mark.parametrize("name", ["ranges", "gross errors", "rotations", "consensus"])
def test_columns_say_what_the_reports_say(name):
    result = solved(name).result
    columns, plain = solve_columns(result.solves), solve_columns(tuple(result.solves))
    assert [dict(key) for key in columns.keys] == [dict(key) for key in plain.keys]
    assert columns.statuses == plain.statuses
    assert columns.fits == plain.fits
    assert [s.name for s in columns.scalars] == [s.name for s in plain.scalars]
    for one, other in zip(columns.scalars, plain.scalars, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.sigmas, other.sigmas)


KINDS = ["gross errors", "windows", "windows of consensus", "two unknown noises", "poses without a start"]


LOSSES = [
    "a loss of unknown noise",
    "losses of unknown noise and a prior",
    "consensus of two unknown noises",
]


@pytest.mark.parametrize("name", [*KINDS, *LOSSES, "windows with several minima", "windows of two unknown noises"])
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


def test_a_window_is_the_problem_of_its_rows():
    """Rows picked by hand, each window solved as a problem of its own."""
    data = PROBLEMS["windows"][1]
    alone = mbm.loads(RANGES.format(more="", when="", sigma="10mm", top="2.7m").replace("(for-each epoch)", ""))
    ranges = {name: np.asarray(column) for name, column in data["ranges"].items()}
    compared = 0
    for solve in solved("windows").solves:
        end, tag = solve.key["epoch"], solve.key["tag"]
        mine = (ranges["tag"] == tag) & (ranges["epoch"] > end - 0.25 + 1e-9) & (ranges["epoch"] <= end + 1e-9)
        if solve.status == "skipped":
            assert mine.sum() < 3
            continue
        rows = {name: column[mine] for name, column in ranges.items()}
        other = alone.solve(data={"receivers": data["receivers"], "ranges": rows}).first
        # both end where the next step is below 1e-10 standard deviations of some millimetres
        np.testing.assert_allclose(solve.estimates[0].value, other.estimates[0].value, rtol=0, atol=1e-11)
        np.testing.assert_allclose(solve.estimates[0].sigma, other.estimates[0].sigma, rtol=1e-9)
        compared += 1
    assert compared > 60


@pytest.mark.parametrize("name", MADE_TOGETHER)
def test_documents_from_columns_are_those_of_the_reports(name):
    made = [solve_document(solve) for solve in solved(name).result.solves]
    written = solved(name).document()["solves"]
    assert [list(solve) for solve in written] == [list(solve) for solve in made]
    assert written == made


def test_documents_share_nothing():
    first, second = solved("ranges").document()["solves"][:2]
    first["observability"]["gauge"].append("mine")
    first["covariance"]["names"].clear()
    assert second["observability"]["gauge"] == []
    assert len(second["covariance"]["names"]) == 3


def test_slices_do_not_change_the_answers(monkeypatch):
    text, data = PROBLEMS["ranges"]
    compiled = mbm.loads(text).compile(data=data)
    one = compiled.solve().table()
    monkeypatch.setattr("mbm.estimation.batches.stack.ROWS_AT_ONCE", 30)
    several = compiled.solve()
    assert len(several.result.solves.blocks) > 5
    table = several.table()
    for name in one:
        assert list(one[name]) == list(table[name])


def test_solves_are_a_sequence_of_reports():
    solves = solved("ranges").solves
    assert len(solves) == 40
    assert solves[-1].key == solves[39].key
    assert [s.key for s in solves[3:5]] == [solves[3].key, solves[4].key]
    with pytest.raises(IndexError):
        solves[40]
    rows = solves[2].rows()
    assert sum(row.residual**2 for row in rows) == pytest.approx(solves[2].cost, rel=1e-9)  # summed in another order


def test_csv_has_a_row_for_each_solve_in_the_order_of_the_keys():
    data = PROBLEMS["too few"][1]
    stream = io.StringIO()
    write_solves(solved("too few").result, stream)
    lines = stream.getvalue().splitlines()
    order = dict.fromkeys(data["ranges"]["epoch"].tolist())
    assert [line.split(",")[0] for line in lines[1:]] == [str(epoch) for epoch in order]


class After(Interruption):
    """Requested once it has been asked so many times."""

    def __init__(self, count):
        super().__init__()
        self._left = count

    @property
    def requested(self):
        self._left -= 1
        return self._left < 0


def test_an_interrupted_run_keeps_the_solves_that_were_made(monkeypatch):
    monkeypatch.setattr("mbm.estimation.batches.stack.ROWS_AT_ONCE", 60)
    text, data = PROBLEMS["ranges"]
    compiled = mbm.loads(text).compile(data=data)
    whole = compiled.result(SolveSettings())
    part = compiled.result(SolveSettings(interruption=After(9), workers=1))
    assert not part.complete
    assert 0 < len(part.solves) < len(whole.solves)
    for i in range(len(part.solves)):
        np.testing.assert_array_equal(part.solves[i].estimates[0].value, whole.solves[i].estimates[0].value)


def test_a_row_that_spoils_its_solve_leaves_the_others():
    text, data = copy.deepcopy(PROBLEMS["ranges"])
    text = text.replace(":sigma 10mm", ":sigma s")
    data["ranges"]["s"] = np.full(len(data["ranges"]["range"]), 0.01)
    data["ranges"]["s"][5] = -1.0
    statuses = [s.status for s in mbm.loads(text).solve(data=data).solves]
    assert statuses.count("not-converged") == 1
    assert statuses.count("converged") == 39
