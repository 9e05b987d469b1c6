"""Where something is to be written: links resolved, what stands there looked at, and whether it may be replaced."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from stat import S_ISBLK, S_ISDIR, S_ISREG

from mbm.files import faults
from mbm.files.journal import Read
from mbm.text.types import MbmError
from mbm.values import dataclass

SOURCE_ENDING = ".mbm"
"""The ending of problem files, which no result ever replaces."""

WRITABLE = 0o222
"""Without any of these bits a file is not to be changed, whoever asks."""

_MOST_LINKS = 40
_STREAMS = ((1, "standard output"), (2, "standard error"))
_DESCRIPTORS = re.compile(r"/dev/fd|/proc/(?P<process>\d+)(?:/task/\d+)?/fd")


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A place that can be written to.

    ``name`` is how it was called, ``path`` what that leads to. ``descriptor`` is that of a stream which is open already
    (``/dev/stdout``, ``/dev/fd/3``). ``status`` tells what stands there; None: nothing does.
    """

    name: str
    path: Path
    descriptor: int | None
    status: os.stat_result | None

    @property
    def is_ordinary(self) -> bool:
        """An ordinary file, or one that is yet to be made: it can be replaced as a whole."""
        return self.descriptor is None and (self.status is None or S_ISREG(self.status.st_mode))

    def is_file(self, path: str | Path) -> bool:
        """Whether ``path`` leads to the very file that stands here, by whatever name."""
        if self.status is None or not S_ISREG(self.status.st_mode):
            return False
        try:
            other = Path(path).stat()
        except (OSError, ValueError):
            return False
        return os.path.samestat(self.status, other)


def target_of(name: str | os.PathLike[str]) -> Target:
    """What is written to if ``name`` is; nothing is touched.

    Raises:
        MbmError: not-writable: a folder, a disk, a file or folder that is read-only, no folder, no name.

    """
    text = os.fspath(name)
    try:
        found = _found(text)
    except OSError as error:
        raise MbmError(faults.not_writable(text, faults.reason_of(error))) from None
    except (ValueError, OverflowError):
        raise MbmError(faults.not_writable(text, "no file can have this name")) from None
    objection = _objection(found)
    if objection is not None:
        raise MbmError(faults.not_writable(text, objection))
    return found


def _found(name: str) -> Target:
    number = _descriptor(name) if name else None
    if number is not None:
        return Target(name=name, path=Path(name), descriptor=number, status=os.fstat(number))
    try:
        status = Path(name).stat()
    except (FileNotFoundError, NotADirectoryError):
        status = None
    ordinary = status is None or S_ISREG(status.st_mode)
    *_, place = _places(name)
    return Target(name=name, path=place if ordinary else Path(name), descriptor=None, status=status)


def _descriptor(name: str) -> int | None:
    """N if ``name`` leads to ``/dev/fd/N`` of this process, through whatever links.

    Opened anew, a file that the shell has opened would be written from its beginning, beside what is there already.
    """
    for at in _places(name):
        listed = _DESCRIPTORS.fullmatch(str(at.parent)) if at.name.isdecimal() else None
        if listed is not None and listed["process"] in (None, str(os.getpid())):
            return int(at.name)
    return None


def _places(name: str) -> Iterator[Path]:
    """What ``name`` leads to from link to link, each in its real folder; the last one in a folder that may not exist.

    Links are followed as the system does it: through a folder that does not exist, ``..`` leads nowhere. Shortened to
    what it looks like, ``missing/../data.csv`` would be a file that nobody named.
    """
    at = Path(name)
    for _ in range(_MOST_LINKS):
        if not at.parent.is_dir():
            yield at
            return
        at = Path(os.path.realpath(at.parent)) / at.name
        yield at
        if not at.is_symlink():
            return
        at = at.parent / at.readlink()


def _objection(target: Target) -> str | None:
    """Why a target cannot be written; None where nothing speaks against it yet."""
    name, status = target.name, target.status
    if not name:
        return "its name is empty"
    if status is not None and S_ISDIR(status.st_mode):
        return "it is a folder"
    if status is not None and S_ISBLK(status.st_mode):
        return "it is a disk"
    if not target.is_ordinary:
        return None
    folder = target.path.parent
    if not folder.is_dir():
        return "its folder does not exist"
    if name.endswith(("/", os.sep)):
        return "it names a folder"
    if status is not None and not (status.st_mode & WRITABLE and _allowed(target.path, os.W_OK)):
        return "it is read-only"
    if not _allowed(folder, os.W_OK | os.X_OK):
        return "no file can be made in its folder, which is read-only"
    return None


def _allowed(path: Path, mode: int) -> bool:
    return os.access(path, mode, effective_ids=os.access in os.supports_effective_ids)


def refuse_read(target: Target, reads: Iterable[Read], allowed: Iterable[str] = ()) -> None:
    """Refuse a file that was read, whatever it is called there; files that were read for ``allowed`` roles alone go.

    Raises:
        MbmError: would-overwrite.

    """
    if target.status is None:
        return
    excused = set(allowed)
    for read in reads:
        roles = [role for role in read.roles if role not in excused]
        if (roles or not read.roles) and target.is_file(read.path):
            raise MbmError(faults.would_overwrite(target.name, read.name, roles[0] if roles else None))


def refuse_source(target: Target) -> None:
    """Refuse a problem file, be it one that this call reads or not.

    Raises:
        MbmError: would-overwrite.

    """
    names = (Path(target.name), target.path, Path(os.path.realpath(target.path)))
    called_so = SOURCE_ENDING in (name.suffix.lower() for name in names)
    if target.status is not None and S_ISREG(target.status.st_mode) and called_so:
        raise MbmError(faults.would_replace_source(target.name))


def is_source(path: Path) -> bool:
    """Whether a path, and what it leads to, are called as problem files are."""
    return path.suffix.lower() == SOURCE_ENDING == Path(os.path.realpath(path)).suffix.lower()


def refuse_streamed(target: Target) -> None:
    """Refuse a file that standard output or standard error goes to: what they say would be lost.

    Raises:
        MbmError: would-overwrite.

    """
    if target.status is None or not target.is_ordinary:
        return
    for number, name in _STREAMS:
        with suppress(OSError):  # closed: nothing is said there
            if os.path.samestat(target.status, os.fstat(number)):
                raise MbmError(faults.written_twice(name, target.name))


def refuse_twice(targets: Iterable[Target]) -> None:
    """Refuse two targets that are one file, whatever they are called.

    Raises:
        MbmError: would-overwrite.

    """
    seen: list[Target] = []
    for target in targets:
        for other in seen:
            if target.is_file(other.path) or (target.is_ordinary and target.path == other.path):
                raise MbmError(faults.written_twice(other.name, target.name))
        seen.append(target)
