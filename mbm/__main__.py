"""The program ``mbm``, and ``python -m mbm``: the command line as a process of its own."""

from __future__ import annotations

import atexit
import os
import sys
from typing import NoReturn

from mbm.cli.main import main
from mbm.cli.output import flush


def process() -> NoReturn:
    """Runs the command line and ends the process, once threads are done and what is registered for the end was called.

    Modules, classes and functions are left to the system, not taken apart: that is a twentieth of a warm start.
    """
    ending: list[int] = []
    atexit.register(_leave, ending)  # first, so that it is called last
    ending.append(main())
    sys.exit(ending[0])


def _leave(ending: list[int]) -> None:
    """Ends the process with the status, if there is one: other ways out are left as they are."""
    if ending:
        flush()
        os._exit(ending[0])


if __name__ == "__main__":
    process()
