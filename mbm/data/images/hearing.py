"""What decoders say: libjpeg and libpng tell of damage by lines on standard error, and in no other way."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile

STANDARD_ERROR = 2
MOST_HEARD = 100_000
"""Bytes of what was said that are looked at."""

OF_DECODERS = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid", "Unsupported", "libpng ", "[ WARN", "[ERROR")
_lock = threading.Lock()


@contextmanager
def listening() -> Iterator[list[str]]:
    """Inside, lines on standard error are kept back; behind it, the list holds those of decoders.

    Lines of anybody else, in another thread, are passed on then. Where there is no standard error nothing is heard.
    """
    heard: list[str] = []
    with _lock:
        try:
            before = os.dup(STANDARD_ERROR)
        except OSError:
            yield heard
            return
        with TemporaryFile() as said:
            os.dup2(said.fileno(), STANDARD_ERROR)
            try:
                yield heard
            finally:
                os.dup2(before, STANDARD_ERROR)
                os.close(before)
                said.seek(0)
                lines = said.read(MOST_HEARD).decode(errors="replace").splitlines()
                heard.extend(line for line in lines if line.startswith(OF_DECODERS))
                others = [line for line in lines if not line.startswith(OF_DECODERS)]
                if others:
                    os.write(STANDARD_ERROR, ("\n".join(others) + "\n").encode())
