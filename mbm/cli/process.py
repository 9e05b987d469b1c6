"""The command line as a process of its own: from its first moment, in which an interrupt may come, to its end."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from typing import NoReturn

from mbm.cli.statuses import INTERRUPTED


def process() -> NoReturn:
    """Runs the command line and ends the process, once threads are done and what is registered for the end was called.

    Modules, classes and functions are left to the system, not taken apart: that is a twentieth of a warm start. While
    modules are loaded and at the very end, an interrupt ends the process where it is; between, `main` hears it.
    """
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not in the background of a script
    if heard:
        signal.signal(signal.SIGINT, _interrupted)
    from mbm.cli.main import main

    ending: list[int] = []
    atexit.register(_leave, ending)  # first, so that it is called last
    ending.append(main(heard=heard))
    if heard:
        signal.signal(signal.SIGINT, _interrupted)
    sys.exit(ending[0])


def _interrupted(_signal: int, _frame: object) -> NoReturn:
    os._exit(INTERRUPTED)


def _leave(ending: list[int]) -> None:
    """Ends the process with the status, if there is one: other ways out are left as they are."""
    if ending:
        from mbm.cli.output import flush

        flush()
        os._exit(ending[0])
