"""Ctrl-C while a problem is solved: the first one asks for the best point so far, the second one ends the program.

Python hears of signals between two instructions of the main thread, which may be inside native code for seconds. So a
thread reads them as they come: it makes the request at once, and ends the program where the main thread does not.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mbm.cli.output import say_error
from mbm.cli.statuses import INTERRUPTED

if TYPE_CHECKING:
    from types import FrameType

    from mbm.equations.interruption import Interruption

MESSAGE = "interrupted: ending with the best point so far (Ctrl-C again to abort)"
ABORTED = "interrupted"

PATIENCE = 0.5
"""Seconds in which the main thread may end in order, once the program is to end."""


@contextmanager
def interruptible(interruption: Interruption, patience: float = PATIENCE) -> Iterator[None]:
    """Inside, Ctrl-C requests the ``interruption`` once somebody listens; before that, and a second time, it raises.

    Where that does not lead out within ``patience`` seconds, the process ends with status `INTERRUPTED`. Only the main
    thread hears of signals: in others this changes nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ear = _Ear(interruption, patience)
    handler = signal.signal(signal.SIGINT, ear.handle)
    wakeup = signal.set_wakeup_fd(ear.entrance, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGINT, handler)
        ear.close()


class _Ear:
    """Hears of each Ctrl-C twice: as a byte in a pipe, at once, and in the main thread, when that comes to it."""

    def __init__(self, interruption: Interruption, patience: float) -> None:
        self._interruption = interruption
        self._patience = patience
        self._exit, self.entrance = os.pipe()
        if sys.platform != "win32":  # there, pipes are as Python wants them
            os.set_blocking(self.entrance, False)
        self._first = threading.Lock()  # taken by whoever makes the request, the handler or the thread; nobody waits
        self._handled = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="ctrl-c", daemon=True)
        self._thread.start()

    def handle(self, _number: int, _frame: FrameType | None) -> None:
        """The signal handler, in the main thread."""
        if self._handled or not self._interruption.listening:
            raise KeyboardInterrupt
        self._handled = True
        self._request()

    def close(self) -> None:
        """Nothing is heard any more."""
        self._over.set()
        os.close(self.entrance)
        self._thread.join()
        os.close(self._exit)

    def _request(self) -> None:
        """Ask for the end, and say so, once."""
        if self._first.acquire(blocking=False):
            self._interruption.request()
            say_error(MESSAGE)

    def _listen(self) -> None:
        """Until the pipe is closed."""
        requested = False
        while signals := os.read(self._exit, 1):
            if signals[0] != signal.SIGINT:
                continue
            if self._interruption.listening and not requested:
                requested = True
                self._request()
            elif not self._over.wait(self._patience):
                say_error(ABORTED)
                os._exit(INTERRUPTED)
