"""What bounds an evaluation: a problem file is data, and data may not make the compiler hang."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from mbm.files.faults import unreadable_file
from mbm.language import faults
from mbm.text.types import Form, MbmError, Place, Text
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bounds of one compilation. The defaults let any sensible problem through and end a runaway within a second.

    ``steps`` bounds one evaluation (of a clause, for one group of rows), ``total_steps`` all of them together,
    ``equations`` and ``operations`` bound what is derived, compiled and reported: an operation takes about a quarter
    of a millisecond, an equation as much as twenty, a condition as three, so that all of them take some five seconds;
    the environment variable `VARIABLE` allows more of them.
    """

    depth: int = 3000
    steps: int = 64_000
    total_steps: int = 10 * steps
    list_length: int = 100_000
    files: int = 200
    equations: int = 750
    operations: int = 16_000

    def written_out(self) -> tuple[int, int]:
        """The equations, and the operations in them, that may be written out, with what `VARIABLE` allows.

        Raises:
            MbmError: bad-work-bound, `VARIABLE` states no number, or one that makes no sense.

        """
        times = _stated_work()
        return int(self.equations * times), int(self.operations * times)


VARIABLE = "MBM_WORK"
"""Environment variable: how many times as much as usual may be written out, such as ``4``."""

LEAST_WORK, MOST_WORK = 0.01, 1e6
"""What `VARIABLE` may state."""

STEPS_PER_EVALUATION = 16
"""What it takes to evaluate a clause at all: to make its scope, its block of equations."""

ITEMS_PER_STEP = 4
"""Items that a form may have for its one step; longer forms take more."""

ELEMENTS_PER_STEP = 8
"""Elements of a list or vector that are looked at or copied in the time that one form takes."""

NUMBERS_PER_STEP = 3
"""Numbers that are made, or joined to expressions, in that time."""

FRAMES_PER_LEVEL = 12
"""Python frames that one level of evaluation may take, with room to spare."""


@contextmanager
def recursion_room(limits: Limits) -> Iterator[None]:
    """Let the evaluator reach its own depth limit before Python's; restored afterwards."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, limits.depth * FRAMES_PER_LEVEL))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


def _stated_work() -> float:
    text = os.environ.get(VARIABLE)
    if text is None or not text.strip():
        return 1.0
    try:
        stated = float(text)
    except ValueError:
        stated = math.nan
    if not LEAST_WORK <= stated <= MOST_WORK:
        raise MbmError(faults.bad_work_bound(VARIABLE, text, LEAST_WORK, MOST_WORK))
    return stated


def more_work() -> str:
    """What allows four times as much as now."""
    return f"{VARIABLE}={4 * _stated_work():g}"


class Budget:
    """Counts the steps and the depth of one evaluation, and the steps of all evaluations before it."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._steps = 0
        self._depth = 0
        self._allowed = limits.steps
        self._before = 0

    def reset(self, place: Place) -> None:
        """A new evaluation begins: of another clause, or of the same for other rows.

        Raises:
            MbmError: the evaluations so far took all steps that there are.

        """
        self._before += self._steps + STEPS_PER_EVALUATION
        self._allowed = min(self.limits.steps, self.limits.total_steps - self._before)
        if self._allowed <= 0:
            raise MbmError(faults.too_many_in_all(place, self.limits.total_steps))
        self._steps = 0
        self._depth = 0

    def enter(self, form: Form) -> None:
        """One step deeper, at ``form``."""
        self._steps += 1
        self._depth += 1
        if self._depth > self.limits.depth:
            raise MbmError(faults.too_deep(form.span, self.limits.depth))
        if self._steps > self._allowed:
            self._stop(form)

    def leave(self) -> None:
        """Back from ``enter``."""
        self._depth -= 1

    def spend(self, steps: int, form: Form) -> None:
        """Work done outside the evaluation of forms: calls made for a list's elements, products of matrices."""
        self._steps += steps
        if self._steps > self._allowed:
            self._stop(form)

    def _stop(self, form: Form) -> NoReturn:
        if self._steps > self.limits.steps:
            raise MbmError(faults.too_many_steps(form.span, self.limits.steps))
        raise MbmError(faults.too_many_in_all(form.span, self.limits.total_steps))

    def look(self, elements: int, form: Form) -> None:
        """Elements are looked at, which is cheaper than evaluating forms, but not free."""
        self.spend(elements // ELEMENTS_PER_STEP, form)

    def make(self, numbers: int, form: Form) -> None:
        """Numbers are made without forms of their own: the elements of a range, of a sum of vectors."""
        self.spend(numbers // NUMBERS_PER_STEP, form)

    def check_length(self, length: int, form: Form) -> None:
        """A list or vector of ``length`` is about to be made."""
        if length > self.limits.list_length:
            raise MbmError(faults.list_too_long(form.span, length, self.limits.list_length))


def resolved_inside(sandbox: Path | None, path: Path, written: Text) -> Path:
    """Where a path leads, links followed; ``written`` is the form that names it.

    Raises:
        MbmError: unreadable-file, outside-sandbox.

    """
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a name that no file can have
        raise MbmError(unreadable_file(path, str(error), written.span)) from None
    if sandbox is not None and not resolved.is_relative_to(sandbox.resolve()):
        raise MbmError(faults.outside_sandbox(written.span, written.value))
    return resolved
