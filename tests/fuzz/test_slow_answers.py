"""A slow answer is a fault where it is slow a second time, as cold as the first."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mbm.kernels.store import VARIABLE
from tests.trials import kinds
from tests.trials.blocks import Block, run_block
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


def test_slow_cases_are_told_and_those_behind_them_are_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None is made small: that would take the time of a hundred more."""
    ran = []

    def timed(*_: str) -> Outcome:
        ran.append(1)
        return Outcome(status=0, out="", err="", seconds=2.0 * SLOWEST if len(ran) < 3 else 0.1, grown=0, aside=0)

    monkeypatch.setattr(kinds, "outcome", timed)
    found = run_block(Block(kind=HELP, number=0, count=20, base=1), Home(folder=tmp_path))
    assert found.ran == 20
    assert found.fault is not None
    assert found.fault.startswith(f"slow: {2.0 * SLOWEST:.1f} s\n")
    assert len(ran) == 21  # the slow one twice
