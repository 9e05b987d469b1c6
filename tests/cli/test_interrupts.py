"""Ctrl-C: the first ends a solve with what is there, the second and one that nobody would hear end the program."""

from __future__ import annotations

import os
import signal

import pytest

from mbm.cli.interrupts import interruptible
from mbm.solution.interruption import Interruption


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_the_first_is_a_request_once_somebody_listens(capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    interruption = Interruption()
    with interruptible(interruption):
        interruption.listen()
        press()
        assert interruption.requested
        assert "best point so far" in capsys.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is before


def test_before_a_solve_listens_it_ends_the_program() -> None:
    interruption = Interruption()
    with pytest.raises(KeyboardInterrupt), interruptible(interruption):
        press()
    assert not interruption.requested
