"""A solve that is interrupted answers with the best point so far, never worse than its start, and says so."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import mbm
from mbm.equations.interruption import Interruption
from mbm.equations.types import Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.report.options import SolveSettings
from tests.estimation.classics import CLASSICS, Functions

METHODS = (Method.MARQUARDT, Method.DOGLEG, Method.GAUSS_NEWTON)
DECAY = """
(problem decay
  (data d (table (e x y) {rows}))
  (unknowns (a :init 1 :in (-5 5)) (b :init 0.3 :in (-2 2)))
  {clause}
  (observe d (= y (* a (exp (* b x)))) :sigma 0.1)
  (solve {option}))"""
ROWS = " ".join(f"({e} {x} {(e + 1) * np.exp(0.8 * x) + 0.01 * (-1) ** x:.6f})" for e in range(4) for x in range(5))


class After(Interruption):
    """Requested once it has been asked so many times: an impatient person, without a clock."""

    __slots__ = ("_left",)

    def __init__(self, count):
        super().__init__()
        self._left = count

    @property
    def requested(self):
        self._left -= 1
        return self._left < 0


def solved(clause="", option="", after=3):
    text = DECAY.format(rows=ROWS, clause=clause, option=option)
    return mbm.loads(text).compile().result(SolveSettings(interruption=After(after)))


@settings(max_examples=40)
@given(st.sampled_from(sorted(CLASSICS)), st.sampled_from(METHODS), st.integers(0, 8), st.integers(0, 2**32 - 1))
def test_never_worse_than_the_start_and_regions_without_values_are_survived(name, method, count, seed):
    """Residuals have no value beyond a random plane through the neighbourhood of the start."""
    function, standard, _, _ = CLASSICS[name]
    start = np.array(standard, dtype=float)
    random = np.random.default_rng(seed)
    normal = random.normal(size=len(start))
    limit = start @ normal + abs(random.normal()) * np.abs(normal).sum() * 0.1 * (1 + np.abs(start).max())

    def partly(x):
        values = np.asarray(function(x))
        return values if (x @ normal).real <= limit else np.full_like(values, np.nan)

    equations = Functions(function=partly, start=standard)
    with np.errstate(all="ignore"):
        before = np.square(equations.residuals(start)).sum()
        found = minimise(equations, start, Settings(method=method, interruption=After(count)))
    assert found.cost <= before
    assert np.isfinite(found.point).all()
    assert found.iterations <= count
    assert found.reason is Reason.INTERRUPTED or found.iterations < count or found.reason is not Reason.MAX_ITERATIONS


def test_one_solve_is_reported_as_it_is():
    result = solved(clause="(for-each e)", after=4)
    # Asked before each solve, and before each iteration: the first solve ends after three, and no other is begun.
    (solve,) = result.solves
    assert solve.status == "not-converged"
    assert "interrupted" in solve.message
    assert not result.complete
    assert result.status.value == "attention"
    (diagnostic,) = [d for d in result.diagnostics if d.code.name == "interrupted"]
    assert "1 of 4 solves" in diagnostic.message


def test_solves_that_were_finished_stay():
    whole = mbm.loads(DECAY.format(rows=ROWS, clause="(for-each e)", option="")).solve().result
    iterations = sum(s.iterations for s in whole.solves[:2])
    result = solved(clause="(for-each e)", after=iterations + 4)
    assert 2 <= len(result.solves) < 4
    for done, expected in zip(result.solves[:2], whole.solves, strict=False):
        assert done.status == "converged"
        assert done.cost == expected.cost


@pytest.mark.parametrize("after", [1, 2, 5, 20])
@pytest.mark.parametrize("option", [":starts (random 30)", ":starts (given ((a 2)) ((a 3)) ((b 0)))"])
def test_a_search_answers_with_the_best_of_what_it_reached(option, after):
    (solve,) = solved(option=option, after=after).solves
    at_start = mbm.loads(DECAY.format(rows=ROWS, clause="", option="")).compile()
    before = np.square(at_start.residuals(np.zeros(2))).sum()
    assert solve.cost <= before
    assert solve.status == "not-converged" or solve.starts.tried == (30 if "random" in option else 3)


def test_a_consensus_of_many_ends_between_data_sets(monkeypatch):
    """What was made by then is what a run to the end says of it."""
    pytest.importorskip("llvmlite")
    from mbm.estimation.consensus import native as consensus

    monkeypatch.setattr(consensus, "AT_A_TIME", 1.0)  # one data set at a time
    generator = np.random.default_rng(5)
    epochs, count = 30, 8
    values = generator.normal(size=(epochs, count)) + np.where(np.arange(count) < 2, 50.0, 0.0)
    rows = {"e": np.repeat(np.arange(epochs, dtype=float), count), "y": values.ravel()}
    text = (
        "(problem p (data d external) (unknowns (a :init 1)) (observe d (= y (log (exp a))) :sigma 1)"
        " (for-each e) (solve :robust lmeds))"
    )
    compiled = mbm.loads(text).compile(data={"d": rows})
    whole = compiled.result(SolveSettings(workers=1))
    assert len(whole.solves) == epochs
    cut = compiled.result(SolveSettings(workers=1, interruption=After(12)))
    assert not cut.complete
    assert len(cut.solves) < epochs
    for mine, theirs in zip(cut.solves, whole.solves, strict=False):
        assert np.array_equal(mine.estimates[0].value, theirs.estimates[0].value)


def lines(count, wrong):
    """A line whose noise is stated or not, with some rows that are wrong."""
    generator = np.random.default_rng(3)
    x = np.linspace(0, 1, count)
    y = np.exp(0.3 + x) + 0.01 * generator.normal(size=count)
    y[:wrong] += generator.uniform(1, 2, wrong)
    return {"d": {"x": x, "y": y}}


@pytest.mark.parametrize("kind", ["lmeds", "ransac", "gnc"])
@pytest.mark.parametrize("noise", [":sigma 0.01", ""])
def test_a_consensus_of_one_data_set_in_portions_is_that_in_one_go(monkeypatch, kind, noise):
    pytest.importorskip("llvmlite")
    from mbm.estimation.consensus import native as consensus

    text = (
        "(problem p (data d external) (unknowns (a :init 0) (b :init 0.5))"
        f" (observe d (= y (exp (+ a (* b x)))) {noise}) (solve :robust {kind}))"
    )
    compiled = mbm.loads(text).compile(data=lines(40, 12), backend="native")
    whole = compiled.result(SolveSettings(interruption=After(10**9)))
    asked = []

    class Patient(After):
        @property
        def requested(self):
            asked.append(1)
            return False

    monkeypatch.setattr(consensus, "AT_A_TIME", 1.0)  # one trial at a time
    parts = compiled.result(SolveSettings(interruption=Patient(0)))
    alone = compiled.result(SolveSettings())  # nobody can interrupt it: all trials at once
    for found in (parts, alone):
        for mine, theirs in zip(found.solves[0].estimates, whole.solves[0].estimates, strict=True):
            assert mine.value == theirs.value
        assert found.solves[0].cost == whole.solves[0].cost
    assert kind == "gnc" or len(asked) > 20  # that many trials there are at least


def test_an_interrupted_consensus_answers_with_the_best_of_its_trials(monkeypatch):
    """With five rows of forty that are wrong, one of the first ten trials is good."""
    pytest.importorskip("llvmlite")
    from mbm.estimation.consensus import native as consensus

    monkeypatch.setattr(consensus, "AT_A_TIME", 1.0)
    text = (
        "(problem p (data d external) (unknowns (a :init 0) (b :init 0.5))"
        " (observe d (= y (exp (+ a (* b x))))) (solve :robust lmeds))"
    )
    compiled = mbm.loads(text).compile(data=lines(40, 5), backend="native")
    asked = []

    class Once(After):
        @property
        def requested(self):
            asked.append(1)
            return len(asked) > 11

    result = compiled.result(SolveSettings(interruption=Once(0)))
    (solve,) = result.solves
    assert solve.status == "not-converged"
    assert "interrupted" in solve.message
    assert len(asked) < 20  # there would be a hundred trials
    # Four deviations of the fit to 35 rows with errors of 0.01.
    assert [e.value for e in solve.estimates] == pytest.approx([0.3, 1.0], abs=0.02)


def test_starts_that_never_began_are_not_counted(monkeypatch):
    """Asked after each part of the batch: those behind the request were not tried."""
    pytest.importorskip("llvmlite")
    from mbm.estimation.minimise.native import system

    monkeypatch.setattr(system, "AT_A_TIME", 1.0)
    text = DECAY.format(rows=ROWS, clause="", option=":starts (random 30)")
    compiled = mbm.loads(text).compile(backend="native")
    (whole,) = compiled.result(SolveSettings(interruption=After(10**9))).solves
    assert whole.starts.tried == 30
    counts = []
    for after in (4, 30, 90):
        (solve,) = compiled.result(SolveSettings(interruption=After(after))).solves
        assert solve.status == "not-converged"
        assert solve.starts is None or solve.starts.best_found <= solve.starts.converged <= solve.starts.tried
        counts.append(0 if solve.starts is None else solve.starts.tried)
    assert counts == sorted(counts)
    assert counts[-1] < 30


def test_the_native_consensus_of_many_asks_before_each_part(monkeypatch):
    """Data sets behind the request do not agree, and nothing of them is made up."""
    pytest.importorskip("llvmlite")
    from mbm.estimation.consensus import native as consensus

    monkeypatch.setattr(consensus, "AT_A_TIME", 1.0)
    asked, ends, whole = [], [], consensus.consensus_many

    def stop():
        asked.append(1)
        return len(asked) > 5

    def cut_short(*given, stopped, **named):
        found = whole(*given, stopped=stop, **named)
        ends.append(found.agreed)
        return found

    monkeypatch.setattr(consensus, "consensus_many", cut_short)
    rows = {"e": np.repeat(np.arange(20.0), 5), "y": np.random.default_rng(1).normal(size=100)}
    text = (
        "(problem p (data d external) (unknowns (a :init 1)) (observe d (= y (log (exp a))) :sigma 1)"
        " (for-each e) (solve :robust lmeds))"
    )
    found = mbm.loads(text).compile(data={"d": rows}).result(SolveSettings(workers=1))
    assert ends[0].tolist() == [True] * 5 + [False] * 15
    assert len(found.solves) == 20  # nobody has asked for an end: the others are solved by themselves
