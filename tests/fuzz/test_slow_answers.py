"""A slow answer is a fault where it is slow a second time, as cold as the first."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mbm.kernels.store import VARIABLE
from tests.trials import kinds
from tests.trials.kinds import Case, Home, Kind, attempt
from tests.trials.outcome import SLOWEST, Outcome

HELP = Kind(name="help", share=1.0, size=1, make=lambda _home, _choices: Case(arguments=("--help",)))


@pytest.mark.parametrize(
    ("seconds", "status", "runs", "wrong"),
    [
        ((0.1,), 0, 1, ()),
        ((SLOWEST + 1.0, 0.1), 0, 2, ()),
        ((SLOWEST + 1.0, SLOWEST + 2.0), 0, 2, (f"{SLOWEST + 2.0:.1f} s",)),
        ((SLOWEST + 1.0,), None, 1, ("no end", f"{SLOWEST + 1.0:.1f} s")),
    ],
)
def test_runs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    seconds: tuple[float, ...],
    status: int | None,
    runs: int,
    wrong: tuple[str, ...],
) -> None:
    caches: list[str | None] = []

    def timed(*_: str) -> Outcome:
        caches.append(os.environ.get(VARIABLE))
        return Outcome(status=status, out="", err="", seconds=seconds[len(caches) - 1], grown=0, aside=0)

    before = os.environ.get(VARIABLE)
    monkeypatch.setattr(kinds, "outcome", timed)
    trial = attempt(HELP, Home(folder=tmp_path), b"\0")
    assert trial.wrong == wrong
    assert len(caches) == runs
    assert len(set(caches)) == runs
    assert os.environ.get(VARIABLE) == before
