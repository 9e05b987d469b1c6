"""Ctrl-C while a problem is solved: the first one asks for the best point so far, the second one ends the program."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

    from mbm.solution.interruption import Interruption

MESSAGE = "interrupted: ending with the best point so far (Ctrl-C again to abort)"


@contextmanager
def interruptible(interruption: Interruption) -> Iterator[None]:
    """Inside, Ctrl-C requests the ``interruption`` once somebody listens; before that, and a second time, it raises.

    Only the main thread hears of signals: in others this changes nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(_number: int, _frame: FrameType | None) -> None:
        if interruption.requested or not interruption.listening:
            raise KeyboardInterrupt
        interruption.request()
        print(MESSAGE, file=sys.stderr, flush=True)

    before = signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
