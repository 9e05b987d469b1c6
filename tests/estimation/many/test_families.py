"""Solves with families, made together, say what solves made one by one say, under the names of their own members."""

from __future__ import annotations

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
from mbm.text.types import Severity
from tests.estimation.many.families import BIASES, PROBLEMS, drifting
from tests.estimation.many.test_together import DRAWN, numbers_apart

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

LEFT_ALONE = {"levelling without a datum", "windows that do not fit"}
"""Of which more is to be said than numbers, solve by solve."""


def one_by_one(problem, data, **options):
    """The solves of a problem as they are made when there are too few to make them together."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mbm.estimation.batches.together.FEW_SOLVES", 10_000)
        made = problem.solve(data=data, **options)
    assert not isinstance(made.result.solves, ManyReports)
    return made


@functools.cache
def solved(name):
    """The solves of a problem, made once for all that is said of them here."""
    text, data = PROBLEMS[name]
    return mbm.loads(text).solve(data=data)


@pytest.mark.parametrize("name", PROBLEMS)
def test_documents_agree_with_those_of_solves_one_by_one(name):
    text, data = PROBLEMS[name]
    made = solved(name)
    plain = one_by_one(mbm.loads(text), data, backend="auto" if DRAWN & set(text.split()) else "numpy")
    # tolerances as `numbers_apart` argues them
    assert list(numbers_apart(plain.document(), made.document())) == []


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in LEFT_ALONE])
def test_these_are_made_together(name):
    solves = solved(name).result.solves
    assert isinstance(solves, ManyReports)
    held = [block.block.columns.limits for block in solves.blocks]
    free = len(solves) - sum(each.pushed.any(axis=1).sum() for each in held if each is not None)
    assert sum(block.block.columns.clean.sum() for block in solves.blocks) > free / 2


@pytest.mark.parametrize("name", ["biases, unequal", "own bounds", "poses, unequal", "windows, groups come and go"])
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
    assert documents[1:] == documents[:-1]


@pytest.mark.parametrize(
    "name", ["biases, unequal", "biases, some unused", "poses, unequal", "levelling", "levelling, limits", "own limits"]
)
def test_documents_from_columns_are_those_of_the_reports(name):
    made = [solve_document(solve) for solve in solved(name).result.solves]
    written = solved(name).document()["solves"]
    assert [list(solve) for solve in written] == [list(solve) for solve in made]
    assert written == made


@pytest.mark.parametrize("name", ["biases, unequal", "biases, some unused", "windows, groups come and go", "poses"])
def test_tables_have_the_same_columns_in_the_same_order(name):
    text, data = PROBLEMS[name]
    made = solve_columns(solved(name).result.solves)
    plain = solve_columns(one_by_one(mbm.loads(text), data).result.solves)
    assert [dict(key) for key in made.keys] == [dict(key) for key in plain.keys]
    assert made.statuses == plain.statuses
    assert [scalar.name for scalar in made.scalars] == [scalar.name for scalar in plain.scalars]
    for one, other in zip(made.scalars, plain.scalars, strict=True):
        np.testing.assert_array_equal(one.there, other.there)
        # as in documents: both end within 1e-10 standard deviations, of 0.1 at most here
        np.testing.assert_allclose(one.values, other.values, rtol=1e-9, atol=1e-11)


def test_solves_are_the_least_squares_of_their_rows():
    """Of numpy, epoch by epoch; members in the order in which an epoch has them first."""
    data = PROBLEMS["biases, unequal"][1]
    columns = {name: np.asarray(column) for name, column in data["d"].items()}
    solves = solved("biases, unequal").solves
    assert [solve.key["epoch"] for solve in solves] == list(dict.fromkeys(data["d"]["epoch"]))
    for solve in solves:
        mine = columns["epoch"] == solve.key["epoch"]
        keys = list(dict.fromkeys(columns["group"][mine].tolist()))
        design = np.column_stack([columns["x"][mine], *(columns["group"][mine] == key for key in keys)])
        expected, *_ = np.linalg.lstsq(design, columns["y"][mine], rcond=None)
        sigma = 0.1 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
        slope, offsets = solve.estimates
        assert offsets.keys == tuple(keys)
        # a few roundings of normal equations with a condition below 100
        np.testing.assert_allclose([slope.value, *offsets.value], expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose([slope.sigma, *offsets.sigma], sigma, rtol=1e-12)


def test_a_text_that_equations_look_at_may_be_missing_in_a_solve():
    """Of numpy, epoch by epoch: rows of one group, which every second epoch lacks, weigh a quarter of others."""
    data = PROBLEMS["biases"][1]
    columns = {name: np.asarray(column) for name, column in data["d"].items()}
    text = BIASES.format(when="", sigma='(if (= group "g0") 0.2 0.1)', more="")
    for solve in mbm.loads(text).solve(data=data).solves:
        mine = columns["epoch"] == solve.key["epoch"]
        group, slope, offsets = columns["group"][mine], *solve.estimates
        design = np.column_stack([columns["x"][mine], *(group == key for key in offsets.keys)])
        root = np.where(group == "g0", 5.0, 10.0)
        expected, *_ = np.linalg.lstsq(root[:, None] * design, root * columns["y"][mine], rcond=None)
        # a few roundings of normal equations with a condition below 100
        np.testing.assert_allclose([slope.value, *offsets.value], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("init", [{"slope": 0.2}, None])
def test_starts_may_come_from_outside(init):
    """One for all solves, or the document of another run, member by member."""
    text, data = PROBLEMS["own starts"]
    problem = mbm.loads(text)
    begun = problem.solve(data=data).document() if init is None else init
    made = problem.solve(data=data, init=begun)
    assert isinstance(made.result.solves, ManyReports)
    plain = one_by_one(problem, data, init=begun)
    assert list(numbers_apart(plain.document(), made.document())) == []


def test_windows_begin_where_members_of_the_same_name_were():
    """The start leads to the frequencies of the first windows only."""
    text, data = PROBLEMS["windows with several minima"]
    solves = mbm.loads(text).solve(data=data).solves
    times = np.array([solve.key["time"] for solve in solves])
    found = np.array([solve.estimates[0].value for solve in solves])
    assert len(drifting()["d"]["x"]) > 24 * len(solves) > 0
    np.testing.assert_allclose(found, 1 + 0.03 * times, atol=0.02)  # 5 sigma of 24 values, σ(w) below 0.004


def test_csv_has_the_solves_in_their_order():
    text, data = PROBLEMS["biases, unequal"]
    stream = io.StringIO()
    write_solves(mbm.loads(text).solve(data=data).result, stream)
    lines = stream.getvalue().splitlines()
    assert lines[0].startswith('epoch,status,cost,dof,sigma0,chi2_p,v,v.sigma,"b[""')
    assert [line.split(",")[0] for line in lines[1:]] == [str(epoch) for epoch in dict.fromkeys(data["d"]["epoch"])]


def test_rows_of_residuals_are_those_of_the_solve():
    text, data = PROBLEMS["biases, unequal"]
    for solve in mbm.loads(text).solve(data=data).solves[5:9]:
        assert sum(row.residual**2 for row in solve.rows()) == pytest.approx(solve.cost, rel=1e-9)  # another order


def test_a_key_that_is_no_member_in_its_solve_is_the_fault_of_that_solve():
    text, data = PROBLEMS["own starts"]
    days = list(data["stations"]["day"])
    days[data["stations"]["station"].index("5-1")] = 6
    moved = {**data, "stations": {**data["stations"], "day": days}}
    solves = mbm.loads(text).solve(data=moved).solves
    faulty = [[d for d in solve.diagnostics if d.severity is Severity.ERROR] for solve in solves]
    wrong = [solve.key["day"] for solve, faults in zip(solves, faulty, strict=True) if faults]
    assert wrong == [5]
    assert [d.code.name for faults in faulty for d in faults] == ["dangling-key"]


def test_many_members_are_left_to_the_general_path():
    """More unknowns than dense native algebra is for."""
    rows = [(epoch, f"g{group}", 0.1 * k, group) for epoch in range(10) for group in range(81) for k in range(2)]
    data = {"d": {name: [row[i] for row in rows] for i, name in enumerate(("epoch", "group", "x", "y"))}}
    solves = mbm.loads(PROBLEMS["biases"][0]).solve(data=data).result.solves
    assert not isinstance(solves, ManyReports)
    assert len(solves) == 10


class After(Interruption):
    """Requested once it has been asked so many times."""

    def __init__(self, count):
        super().__init__()
        self._left = count

    @property
    def requested(self):
        self._left -= 1
        return self._left < 0


def test_what_was_made_before_an_interruption_is_said():
    text, data = PROBLEMS["biases, unequal"]
    compiled = mbm.loads(text).compile(data=data)
    result = compiled.result(SolveSettings(interruption=After(3), workers=1))
    assert not result.complete
    assert 0 < len(result.solves) < 40
    order = list(dict.fromkeys(data["d"]["epoch"]))
    keys = [order.index(solve.key["epoch"]) for solve in result.solves]
    assert keys == sorted(keys)
    assert len(solve_columns(result.solves).keys) == len(keys)


def test_a_positive_member_with_a_start_that_is_not_is_the_fault_of_its_solve():
    text, data = PROBLEMS["own starts"]
    guess = list(data["stations"]["guess"])
    guess[data["stations"]["station"].index("5-1")] = -1.0
    begun = {**data, "stations": {**data["stations"], "guess": guess}}
    solves = mbm.loads(text.replace("(o :per", "(o positive :per")).solve(data=begun).solves
    assert {solve.key["day"]: str(solve.status) for solve in solves if str(solve.status) != "converged"} == {
        5: "not-converged"
    }
    assert [d.code.name for d in solves[5].diagnostics] == ["bad-bounds"]
