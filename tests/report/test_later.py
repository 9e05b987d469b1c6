"""Reports are written when they are asked for: what was solved in between changes nothing in them."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, RLock
from time import sleep
from typing import Any

import numpy as np
import pytest

import mbm
from mbm.estimation.solve import estimate
from mbm.report import from_solution
from mbm.report.later import LaterByNumber, LaterReports
from mbm.report.types import SolveReport, SolveStatus

X = np.linspace(0.5, 4.0, 24)
WAVE = 0.3 * np.sin(X)
"""Neighbouring residuals are alike: there is something to doubt."""

KINDS = {
    "line": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05)",
    "unknown noise": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma unknown)",
    "loss": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05 :loss (huber 1.5))",
    "curved": """(unknowns (a :init 1) (b :init 0.5)) (observe d (= y (* a (exp (* b x)))) :sigma 0.5)
        (derive (half (/ (log 2) b)))""",
    "bound": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05) (constraints (>= a 1.2) (<= b 0.4))",
    "prior": "(unknowns (a) (b :prior (normal 0 0.01))) (observe d (= y (+ a (* b x))) :sigma 0.05)",
    "errors": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05 :errors ((x 0.02)))",
    "consensus": "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05) (solve :robust lmeds)",
}


def table(seed: int, rows: int) -> dict[str, Any]:
    noise = np.random.default_rng(seed).normal(size=rows)
    return {"d": {"x": X[:rows], "y": (1.0 + 0.4 * X + WAVE)[:rows] + 0.02 * noise}}


def said(solved: Any) -> Any:
    document = copy.deepcopy(solved.document())
    for solve in document["solves"]:
        solve.pop("seconds", None)
    return document


@pytest.mark.parametrize("kind", KINDS)
def test_later_solves_change_no_report(kind: str) -> None:
    text = f"(problem p (data d external) {KINDS[kind]})"
    first, second, fewer = table(1, 24), table(2, 24), table(3, 15)
    at_once = said(mbm.loads(text).compile(data=second).solve(data=first))
    compiled = mbm.loads(text).compile(data=second)
    kept = compiled.solve(data=first)
    for other in (second, fewer):
        compiled.solve(data=other).document()
    assert said(kept) == at_once


def test_what_is_doubted_is_said_after_other_solves() -> None:
    compiled = mbm.loads(f"(problem p (data d external) {KINDS['line']})").compile(data=table(1, 24))
    kept = compiled.solve(data=table(1, 24))
    compiled.solve(data=table(2, 15))
    assert "autocorrelated-residuals" in {each.code.name for each in kept.diagnostics}
    again = pickle.loads(pickle.dumps(kept))  # noqa: S301 - its own
    assert said(again) == said(kept)


def test_estimates_are_read_without_a_look_around(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[str] = []
    for name in ("curvature", "doubts", "unexamined"):
        found = getattr(estimate, name)
        monkeypatch.setattr(estimate, name, lambda *given, f=found, n=name: (looked.append(n), f(*given))[1])
    compiled = mbm.loads(
        "(problem p (data d external) (unknowns (a :init 1)) (observe d (= y (exp (* a x)))))"
    ).compile(data={"d": {"x": [1.0, 2.0], "y": [2.0, 4.0]}})
    solved = compiled.solve(data={"d": {"x": [1.0, 2.0, 3.0], "y": [2.1, 4.2, 7.9]}})
    assert solved.status == "ok"
    assert 0.6 < float(solved["a"].value) < 0.8
    assert float(solved["a"].sigma) > 0
    assert looked == []
    assert solved.diagnostics == solved.diagnostics
    assert solved.first.not_examined == {}
    assert sorted(looked) == ["curvature", "doubts", "unexamined"]  # once each


def test_each_report_is_made_once() -> None:
    made: list[int] = []

    def maker(number: int) -> SolveReport:
        made.append(number)
        return SolveReport(status=SolveStatus.CONVERGED, message=str(number))

    reports = LaterReports([lambda k=k: maker(k) for k in range(3)], RLock())  # type: ignore[misc]
    assert len(reports) == 3
    assert made == []
    assert reports[-1] is reports[2]
    assert [each.message for each in reports[1:]] == ["1", "2"]
    assert made == [2, 1]
    assert [each.message for each in reports] == ["0", "1", "2"]
    with pytest.raises(IndexError):
        reports[3]
    assert made == [2, 1, 0]


def test_reports_of_some_solves_are_made_by_their_numbers() -> None:
    made: list[int] = []

    def maker(number: int) -> SolveReport:
        made.append(number)
        return SolveReport(status=SolveStatus.CONVERGED, message=str(number))

    reports = LaterByNumber({k: lambda k=k: maker(k) for k in (7, 4)}, RLock())  # type: ignore[misc]
    assert list(reports) == [7, 4]
    assert (4 in reports, 5 in reports, reports.get(5), made) == (True, False, None, [])
    assert reports[4] is reports[4]
    assert reports[4].message == "4"
    assert made == [4]
    with pytest.raises(KeyError):
        reports[0]


@pytest.fixture
def hasty() -> Iterator[None]:
    """Threads give way to one another all the time."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def read(solved: Any) -> list[float]:
    """Numbers that are worked out when they are read."""
    found = [prior.value for prior in solved.priors] + solved.residuals("d")["raw"].tolist()
    if solved.derived:
        found += np.ravel(solved["half"].interval()).tolist()
    return found


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("kind", ["prior", "curved"])
def test_threads_read_the_numbers_of_their_own_solves(kind: str) -> None:
    compiled = mbm.loads(f"(problem p (data d external) {KINDS[kind]})").compile(data=table(0, 24))
    tables = [table(seed, 24) for seed in range(8)]
    wanted = [read(compiled.solve(data=each)) for each in tables] * 2
    kept = [compiled.solve(data=each) for each in tables * 2]
    with ThreadPoolExecutor(8) as pool:
        found = [pool.submit(read, each) for each in kept]
        meanwhile = [read(compiled.solve(data=each)) for each in tables]
    assert [each.result() for each in found] == wanted
    assert meanwhile == wanted[:8]


@pytest.mark.usefixtures("hasty")
def test_threads_read_solves_that_were_made_together() -> None:
    keyed = {"g": np.repeat(np.arange(8), 24), "x": np.tile(X, 8)}
    keyed["y"] = np.concatenate([table(seed, 24)["d"]["y"] for seed in range(8)])
    solved = mbm.loads(f"(problem p (data d external) {KINDS['prior']} (for-each g))").solve(data={"d": keyed})
    wanted = [read(each) for each in solved.solves] * 8
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda k: read(solved.solves[k % 8]), range(64))) == wanted


def test_threads_that_ask_at_once_wait_for_one_examination(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def examined(*given: Any) -> Any:
        made.append(given)
        sleep(0.05)  # so that the others ask meanwhile
        return original(*given)

    original = from_solution._examined
    monkeypatch.setattr(from_solution, "_examined", examined)
    solve = mbm.loads(f"(problem p (data d external) {KINDS['curved']})").compile().solve(data=table(1, 24)).first
    together = Barrier(4)

    def ask(_: int) -> Any:
        together.wait()
        return solve.record.examined()

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(ask, range(4)))
    assert len(made) == 1
    assert all(each is answers[0] for each in answers)
