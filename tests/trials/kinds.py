"""What a trial is: bytes decide a command line and the files that it reads; the answer is then judged."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mbm.kernels.store import VARIABLE
from tests.trials.choices import Choices
from tests.trials.outcome import SLOWEST, Outcome, faults_of, outcome
from tests.trials.processes import outcome_of_process
from tests.trials.watching import digests, watched


@dataclass(frozen=True, kw_only=True)
class Case:
    """One command line, and the files from which it can be repeated elsewhere.

    Those ``kept`` must be afterwards what they were before; those ``closed`` must not even be read. ``work`` adds to
    the seconds that any answer may take: what the command line asks for by a number within its bound.
    """

    arguments: tuple[str, ...]
    files: tuple[Path, ...] = ()
    kept: tuple[Path, ...] = ()
    closed: tuple[Path, ...] = ()
    work: float = 0.0

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices that the command line names."""
        return tuple(part for word in self.arguments for part in (word, word.partition("=")[2]) if part[:5] == "/dev/")


@dataclass(frozen=True, kw_only=True)
class Home:
    """A folder in which cases write what they like, and sound problem files that they may take and change.

    With ``processes`` each command line is run as a process of its own.
    """

    folder: Path
    examples: tuple[Path, ...] = ()
    processes: bool = False

    def cleared(self, name: str) -> Path:
        """A folder inside that is empty."""
        path = self.folder / name
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        return path


def _nothing(_home: Home, _case: Case, _found: Outcome) -> list[str]:
    return []


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Cases of one kind: its share of all, how many bytes decide one, how they do, and what else must hold after it.

    ``slowest`` is how many seconds an answer may take.
    """

    name: str
    share: float
    size: int
    make: Callable[[Home, Choices], Case]
    after: Callable[[Home, Case, Outcome], list[str]] = field(default=_nothing)
    slowest: float = SLOWEST


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A case, what was answered, and what is wrong with that."""

    case: Case
    found: Outcome
    wrong: tuple[str, ...]
    slow: bool
    """It took too long, whatever else is wrong: to make it small would take longer still."""

    def __str__(self) -> str:
        texts = [f"{'; '.join(self.wrong)}", "mbm " + " ".join(map(repr, self.case.arguments))]
        for path in self.case.files:
            content = path.read_bytes()[:4000] if path.is_file() else b""
            texts.append(f"--- {path.name}\n{content.decode('utf-8', errors='backslashreplace')}")
        return "\n".join([*texts, "---", self.found.err[-2000:]])


def attempt(kind: Kind, home: Home, decisions: bytes) -> Trial:
    """Makes the case that the bytes decide, runs it, and judges the answer.

    An answer that took too long is judged by a second run, as cold as the first: what else a machine does at a moment
    says nothing of mbm. One that never came is not tried again.
    """
    trial = _tried(kind, home, decisions)
    if trial.found.status is None or not trial.slow:
        return trial
    with _empty_cache(home):
        return _tried(kind, home, decisions)


@contextmanager
def _empty_cache(home: Home) -> Iterator[None]:
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(home.cleared("cache-of-second-run"))
    try:
        yield
    finally:
        del os.environ[VARIABLE]
        if before is not None:
            os.environ[VARIABLE] = before


def _tried(kind: Kind, home: Home, decisions: bytes) -> Trial:
    case = kind.make(home, Choices(decisions))
    before, slowest = digests(case.kept), kind.slowest + case.work
    if home.processes:
        inside = case.files[0].parent if case.files else home.folder
        found, wrong = outcome_of_process(
            *case.arguments, folder=inside, devices=case.devices, closed=case.closed, work=case.work
        )
    else:
        with watched(home.folder, case.devices, case.closed) as wrong:
            found = outcome(*case.arguments)
    wrong += [f"{path.name} was changed" for path, digest in digests(case.kept).items() if digest != before[path]]
    wrong += faults_of(found, case.arguments, case.files[0].parent if case.files else home.folder, slowest)
    if not wrong:
        wrong += kind.after(home, case, found)
    slow = found.status is None or found.seconds > slowest
    return Trial(case=case, found=found, wrong=tuple(wrong), slow=slow)
