"""Several images at a time, in threads: OpenCV and NumPy let others work meanwhile. Together they take what one may."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Condition
from typing import TypeVar

from mbm.files.memory import allowed

T = TypeVar("T")
R = TypeVar("R")

MOST_TOGETHER = 8
"""Images at a time: decoding, of which only one is done at once, would hold more of them up."""


class Room:
    """Memory that images share: one waits until the others leave what it needs, or until it is alone."""

    def __init__(self) -> None:
        self._most = allowed()
        self._taken = 0
        self._changed = Condition()

    @contextmanager
    def of(self, needed: int) -> Iterator[None]:
        """Inside, so many bytes are taken."""
        with self._changed:
            self._changed.wait_for(lambda: not self._taken or self._taken + needed <= self._most)
            self._taken += needed
        try:
            yield
        finally:
            with self._changed:
                self._taken -= needed
                self._changed.notify_all()


def in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """What ``work`` makes of each item, in their order; raises what the first of them raises."""
    from concurrent.futures import ThreadPoolExecutor  # loads what logs; one image needs no threads

    workers = min(len(items), os.cpu_count() or 1, MOST_TOGETHER)
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        try:
            return list(pool.map(work, items))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
