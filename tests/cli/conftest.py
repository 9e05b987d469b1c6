"""A stand-in for the Python API: the command line is tested for what it hands over and what it makes of the answer."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from mbm.cli.main import run
from mbm.report.row_data import ResidualRow
from mbm.report.types import Estimate, Quantity, Result, SolveReport, SolveStatus
from mbm.text.types import Code, Diagnostic, Severity, Source, Span

UNKNOWN_NAME = Code("unknown-name", "A name that nothing defines.", "Check the spelling.")
SOURCE = Source(name="desk.mbm", text="(board (rotat 0))\n")
SPAN = Span(source=SOURCE, start=8, end=13)


def diagnostic(severity: Severity = Severity.ERROR) -> Diagnostic:
    return Diagnostic(
        code=UNKNOWN_NAME,
        message="`rotat` is not a function here",
        place=SPAN,
        hint="did you mean `rotate`?",
        severity=severity,
    )


def a_result(status: SolveStatus = SolveStatus.CONVERGED, **changes: Any) -> Result:
    estimate = Estimate(
        quantity=Quantity(name="h", unit="m"), value=np.array(0.75), sigma=np.array(0.002), fixed=np.array(False)
    )
    row = ResidualRow(clause="d", row=1, file_row=2, component=1, value=0.001, residual=0.5, weight=1.0, used=True)
    solve = SolveReport(
        status=status, message=status.sentence, cost=1.5, dof=2, estimates=(estimate,), rows=lambda: (row,)
    )
    return Result(version="0.1.0", file="desk.mbm", problem="desk", seed=1, solves=(solve,), **changes)


@dataclass
class FakeApi:
    """Records the calls; each function answers, or raises, what ``answers`` holds under its name."""

    answers: dict[str, Any] = field(default_factory=dict)
    calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = field(default_factory=list)

    def function(self, name: str) -> Callable[..., Any]:
        def call(*positional: Any, **named: Any) -> Any:
            self.calls.append((name, positional, named))
            answer = self.answers[name]
            if isinstance(answer, BaseException):
                raise answer
            return answer

        return call


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch) -> FakeApi:
    fake = FakeApi(
        answers={
            "solve_file": a_result(),
            "check": (),
            "sequences": (),
            "explain": "h = 1 + x\n",
            "expand": "(subvv 2 a b)",
        }
    )
    module = ModuleType("mbm.api")
    for name in fake.answers:
        setattr(module, name, fake.function(name))
    monkeypatch.setitem(sys.modules, "mbm.api", module)
    return fake


@dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str


@pytest.fixture
def mbm(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs a command line in this process."""

    def call(*arguments: object) -> Outcome:
        capfd.readouterr()
        status = run([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return call


@pytest.fixture
def result_of() -> Callable[..., Result]:
    return a_result


@pytest.fixture
def diagnostic_of() -> Callable[..., Diagnostic]:
    return diagnostic
