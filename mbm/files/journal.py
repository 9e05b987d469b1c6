"""Which files were read, noted where they are opened: results are never written onto one of them.

Readers are called from deep inside the stages, and more of them may come. What is read between the beginning and the
end of `noting` is therefore noted by whatever opens it, as a warning is; nothing else hangs on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path

from mbm.text.faults import shown
from mbm.values import dataclass

THE_PROBLEM = "the problem itself"
WRITTEN = "what was written just now"
"""The role of a file that `mbm.files.writing` has written: in the same call it is as precious as one that was read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """A file that was read: its absolute ``path`` (links as they were named), and its ``name`` as it was given.

    ``roles`` say in words what it was read for; empty where nobody said.
    """

    path: str
    name: str
    roles: tuple[str, ...] = ()


class Journal:
    """The files that were read on one behalf, each once, in their order."""

    def __init__(self) -> None:
        self._reads: dict[str, Read] = {}

    def note(self, path: str, name: str, role: str | None) -> None:
        """The file at the absolute ``path``, called ``name``, is about to be read, for what ``role`` says."""
        known = self._reads.setdefault(path, Read(path=path, name=name))
        if role is not None and role not in known.roles:
            self._reads[path] = replace(known, roles=(*known.roles, role))

    def reads(self) -> tuple[Read, ...]:
        """What was read so far."""
        return tuple(self._reads.values())


_journals: ContextVar[tuple[Journal, ...]] = ContextVar("journals", default=())


@contextmanager
def noting(journal: Journal) -> Iterator[None]:
    """Inside, what this thread reads is noted in ``journal``, and in those of the calls around it."""
    token = _journals.set((*_journals.get(), journal))
    try:
        yield
    finally:
        _journals.reset(token)


def note(path: Path, role: str | None = None) -> None:
    """``path`` is about to be read: for the table, option or form that ``role`` says in words, if the caller knows."""
    journals = _journals.get()
    if not journals:
        return
    try:
        place = str(path.absolute())
    except OSError:  # the working folder is gone: no relative path can be read
        return
    for journal in journals:
        journal.note(place, path.as_posix(), role)


def table_role(name: str) -> str:
    """The role of the file of a table."""
    return f"the file that table `{shown(name)}` reads"


def option_role(option: str) -> str:
    """The role of the file that an option of the command line names."""
    return f"the file of `{option}`"
