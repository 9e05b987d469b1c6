"""Runs a command line as a process of its own, and measures the whole of it: its start, its work, its end."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.trials.outcome import KINDS_OF_BYTES, PATIENCE, STANDSTILL, Outcome
from tests.trials.seeds import ROOT

SPACE = 4 << 30
"""Bytes of address space that a process may take, so that the machine outlives it. What is judged is the largest memory
that it ever had resident: address space says little, for a reader of Parquet files reserves 1.5 GB before it reads the
first, of which it uses 0.1."""
MOST_SAID = 100_000_000
"""Bytes that are looked at of each output: a document of 100,000 windows, which is the bound, has 80 million."""


def outcome_of_process(
    *arguments: str, folder: Path, devices: Iterable[str], closed: Iterable[Path], work: float = 0.0
) -> tuple[Outcome, list[str]]:
    """Runs ``python -m mbm`` in ``folder``: what it answered, and what it touched that it should not have.

    Time is that of the processor, which other work on the machine does not lengthen, of the process and all that it
    waited for; one that waits itself is ended after `STANDSTILL`. Both bounds are longer by ``work`` seconds. Its
    standard input never ends.
    """
    with TemporaryDirectory(prefix="mbm-said-") as place:
        out, err, heard, measured = (Path(place) / name for name in ("out", "err", "heard", "measured"))
        heard.touch()
        measured.touch()
        asked = {
            "folder": str(folder.parent),
            "devices": list(devices),
            "closed": [str(path) for path in closed],
            "heard": str(heard),
            "measured": str(measured),
            "space": SPACE,
            "seconds": math.ceil(PATIENCE + work),
        }
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        command = [sys.executable, "-m", "tests.trials.child", json.dumps(asked), *arguments]
        with Path("/dev/zero").open("rb") as endless, out.open("wb") as first, err.open("wb") as second:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env={**environment, "PYTHONPATH": str(ROOT)},
                stdin=endless,
                stdout=first,
                stderr=second,
                start_new_session=True,
            )
        status, used = _ended(process, STANDSTILL + work)
        found = Outcome(
            status=status,
            out=_said(out),
            err=_said(err),
            seconds=used.ru_utime + used.ru_stime,
            grown=_largest(measured.read_text(encoding="utf-8"), used),
            aside=0,
        )
        return found, heard.read_text(encoding="utf-8").splitlines()


def _ended(process: subprocess.Popen[bytes], standstill: float) -> tuple[int | None, os.struct_rusage]:
    """Waits for a process: its exit status (None: it was given up) and what it used."""
    given_up = threading.Event()

    def give_up() -> None:
        given_up.set()
        _kill(process.pid)

    clock = threading.Timer(standstill, give_up)
    clock.start()
    try:
        _, status, used = os.wait4(process.pid, 0)
    finally:
        clock.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    _kill(process.pid)  # whatever it left behind in its session
    over = given_up.is_set() or process.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
    return None if over else process.returncode, used


def _largest(status: str, used: os.struct_rusage) -> int:
    """Bytes of the largest memory of a program, by its own ``status`` if it came to write one.

    Linux counts in what was ``used`` all that the process held that started it, whose copy it is until its program is
    loaded: 2 GB of a run of all tests.
    """
    for line in status.splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return used.ru_maxrss * KINDS_OF_BYTES.get(sys.platform, 1)


def _kill(session: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(session, signal.SIGKILL)


def _said(path: Path) -> str:
    """What stands in an output; bytes that are no UTF-8 become characters that nobody can print."""
    with path.open("rb") as stream:
        return stream.read(MOST_SAID).decode("utf-8", "surrogateescape")
