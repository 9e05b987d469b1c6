"""Ctrl-C: the first ends a solve with what is there, the second and one that nobody would hear end the program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from mbm.cli.interrupts import interruptible
from mbm.equations.interruption import Interruption

DEAF = """
import hashlib, os, signal, threading, time
from mbm.cli.interrupts import interruptible
from mbm.equations.interruption import Interruption

interruption = Interruption()

def press_twice():
    os.kill(os.getpid(), signal.SIGINT)
    while not interruption.requested:
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGINT)

with interruptible(interruption):
    interruption.listen()
    threading.Thread(target=press_twice, daemon=True).start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
"""
"""The main thread is in native code for many minutes."""


EARLY = """
import os, signal, sys

class Pressed:
    def find_spec(self, name, *_rest):
        if name == "mbm.cli.main":
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, {handler})
sys.meta_path.insert(0, Pressed())
from mbm.__main__ import process
process()
"""
"""While the modules of the command line are loaded. The tests may have been started where nobody hears it."""


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


def test_nothing_of_it_is_left() -> None:
    threads = threading.active_count()
    with interruptible(Interruption()):
        pass
    assert threading.active_count() == threads
    assert signal.set_wakeup_fd(-1) == -1


def test_both_are_heard_while_the_main_thread_is_in_native_code() -> None:
    """The second one is sent once the first was heard."""
    # It takes a second; where the main thread had to come back first, some ten minutes.
    done = subprocess.run([sys.executable, "-c", DEAF], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 130
    first, second = done.stderr.splitlines()
    assert "best point so far" in first
    assert second == "interrupted"


def test_before_a_solve_listens_it_ends_the_program() -> None:
    interruption = Interruption()
    with pytest.raises(KeyboardInterrupt), interruptible(interruption):
        press()
    assert not interruption.requested


def test_one_that_comes_while_modules_are_loaded_ends_the_program_without_words() -> None:
    command = [sys.executable, "-c", EARLY.format(handler="signal.default_int_handler")]
    found = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (found.returncode, found.stderr) == (130, "")


def test_one_that_is_not_to_be_heard_is_not() -> None:
    """A shell without job control starts what goes to the background so."""
    command = [sys.executable, "-c", EARLY.format(handler="signal.SIG_IGN"), "--version"]
    found = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.startswith("mbm")
