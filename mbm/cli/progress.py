"""A progress bar on standard error, for work that takes a while and a person who watches."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, TextIO, cast

from mbm.cli.output import ErrorStream

if TYPE_CHECKING:
    from types import TracebackType

    from rich.progress import Progress, TaskID

PATIENCE = 0.4
"""Seconds before a bar appears: quick work shows none, and does not load the library for it."""


class ProgressBar:
    """Shows the advance that it is told of, if ``shown``; used as a context."""

    def __init__(self, *, shown: bool) -> None:
        self._shown = shown
        self._began = time.monotonic()
        self._open = ExitStack()
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def advance(self, done: int, total: int) -> None:
        """``done`` of ``total`` parts of the work are finished."""
        if not self._shown or total < 2 or time.monotonic() - self._began < PATIENCE:
            return
        if self._bar is None:
            self._bar = self._start()
        if self._task is None:
            self._task = self._bar.add_task("solving", total=total)
        self._bar.update(self._task, completed=done, total=total)

    def _start(self) -> Progress:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        return self._open.enter_context(
            Progress(*columns, console=Console(file=cast("TextIO", ErrorStream())), transient=True)
        )
