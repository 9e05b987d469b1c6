"""The progress bar: only for those who watch, only after a while."""

from __future__ import annotations

import pytest

from mbm.cli import progress
from mbm.cli.progress import ProgressBar


def test_nothing_in_a_pipe(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    with ProgressBar(shown=False) as bar:
        bar.advance(1, 10)
    assert capfd.readouterr() == ("", "")


def test_nothing_for_quick_work(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 1e9)
    with ProgressBar(shown=True) as bar:
        bar.advance(1, 10)
    assert capfd.readouterr() == ("", "")


def test_a_bar_on_standard_error(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with ProgressBar(shown=True) as bar:
        bar.advance(3, 10)
        bar.advance(7, 10)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert "solving" in captured.err
    assert "7/10" in captured.err
