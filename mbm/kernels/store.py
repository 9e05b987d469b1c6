"""What was derived or compiled once and is found again by its content: bytes under a kind and a key, in files.

Each entry is a file of its own, ``DIRECTORY/KIND/KEY.entry``: a line that names the format and mbm's version, the
SHA-256 of kind, key and content, then the content. An entry that does not check, because it is cut off, written to,
moved, or of another version, is as good as none, and removed. Entries appear under their names when they are whole
(they are renamed into place), so that any number of processes may read and write at once. Nothing here ever raises
for what the file system does: without a store everything is computed again.

Object code comes out of it, which is executed, so nothing is used that another user may have put there (`Doubt`): the
folder of the store and that of each kind must be real folders, no links, that belong to this user and that nobody else
may write to. So must the file of an entry, which is looked at once it is open, and which no second name may lead to.

Folders above that of the store are not looked at. Who may write to one of them can put another folder in the place of
the store's, but that one belongs to them, and is not used; nor is the file of an entry, if they change the folder after
it was looked at. Under ``sudo`` with the HOME of a user, root uses nothing of theirs, and leaves nothing there.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from enum import StrEnum
from hashlib import sha256
from pathlib import Path
from time import time

from mbm.values import dataclass
from mbm.version import __version__

VARIABLE = "MBM_CACHE"
"""Environment variable: the folder of the store, or ``off``."""

OFF = "off"
LIMIT = 512 * 2**20
"""Bytes that all entries may take together; those not used for longest go first."""

STALE = 3600.0
"""Seconds after which a file that was never renamed into place is left over from a process that died."""

_HEADER = f"mbm-cache 1 {__version__}\n".encode()
_LARGE = 1024
_SELDOM = 256
"""The folder is looked through after entries above this part of the limit, and after one of so many others: looking
takes 0.1 s where there are 14,000."""

_DIGEST = 32
_SUFFIX, _UNFINISHED = ".entry", ".part"
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)
"""A pipe that stands in the place of an entry is opened without waiting for who writes to it, and refused."""

_FOR_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class Doubt(StrEnum):
    """Why a folder is not used."""

    LINK = "it is a link"
    NO_FOLDER = "it is no folder"
    ANOTHERS = "it belongs to another user"
    OPEN = "others may write to it"
    ABOVE = "the folder above it belongs to another user, who could not use what root makes there"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A file of the store; ``used`` is when it was last read or written (seconds since 1970), ``size`` in bytes."""

    kind: str
    path: Path
    size: int
    used: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Store:
    """Entries in the folder ``directory``, ``limit`` bytes at most.

    Kinds are words of ``a-z 0-9 -``, keys SHA-256 digests in hexadecimal digits, which no file of anybody else has for
    its name.
    """

    directory: Path
    limit: int = LIMIT

    def get(self, kind: str, key: str) -> bytes | None:
        """The content that was put under this kind and key; None where there is none that can be trusted."""
        path = self._path(kind, key)
        if not self._uses(path.parent):
            return None
        whole = b""
        try:
            with os.fdopen(os.open(path, os.O_RDONLY | _NO_LINKS | _AT_ONCE), "rb") as stream:
                found = os.fstat(stream.fileno())
                if _is_our_file(found) and found.st_size <= self.limit:
                    whole = stream.read(found.st_size)
                    if os.utime in os.supports_fd:
                        os.utime(stream.fileno())
        except OSError:
            return None
        content = whole[len(_HEADER) + _DIGEST :]
        if whole[: len(_HEADER) + _DIGEST] == _HEADER + _digest(kind, key, content):
            return content
        with suppress(OSError):
            path.unlink()
        return None

    def put(self, kind: str, key: str, content: bytes) -> None:
        """Keep ``content`` if the file system allows it; what was there is replaced."""
        path = self._path(kind, key)
        size = len(_HEADER) + _DIGEST + len(content)
        if size > self.limit:
            return
        unfinished = path.with_name(f"{key}.{os.urandom(8).hex()}{_UNFINISHED}")
        if doubt_about(self.directory) is not None:
            return
        try:
            _make(path.parent)
            if not self._uses(path.parent):
                return
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_LINKS
            with os.fdopen(os.open(unfinished, flags, 0o600), "wb") as stream:
                stream.write(_HEADER + _digest(kind, key, content))
                stream.write(content)
            unfinished.replace(path)
        except OSError:
            with suppress(OSError):
                unfinished.unlink()
            return
        if size > self.limit // _LARGE or int.from_bytes(_digest(kind, key, b"")) % _SELDOM == 0:
            self._make_room(path)

    def entries(self) -> tuple[Entry, ...]:
        """All entries, by kind and name."""
        found = (entry for entry in self._files() if entry.path.suffix == _SUFFIX)
        return tuple(sorted(found, key=lambda entry: (entry.kind, entry.path.name)))

    def clear(self) -> tuple[Entry, ...]:
        """Remove what is there, and nothing that is not the store's; the entries that could be removed."""
        gone = []
        for entry in self._files():
            with suppress(OSError):
                entry.path.unlink()
                gone.append(entry)
        for kind in {entry.path.parent for entry in gone}:
            with suppress(OSError):  # somebody else's files are in it
                kind.rmdir()
        return tuple(sorted((e for e in gone if e.path.suffix == _SUFFIX), key=lambda e: (e.kind, e.path.name)))

    def doubts(self) -> tuple[tuple[Path, Doubt], ...]:
        """The folders that are there but not used: that of the store, or else those of kinds; each with the reason."""
        kinds = _listed(self.directory) if _is_ours(self.directory) else []
        folders = (self.directory, *sorted(kind for kind in kinds if _is_name(kind.name)))
        found = ((folder, doubt_about(folder)) for folder in folders)
        return tuple((folder, doubt) for folder, doubt in found if doubt is not None)

    def _uses(self, folder: Path) -> bool:
        """Whether the folder of a kind may be read from and written to."""
        return _is_ours(self.directory) and _is_ours(folder)

    def _path(self, kind: str, key: str) -> Path:
        if not _is_name(kind):
            raise ValueError(kind)
        if not _is_key(key):
            raise ValueError(key)
        return self.directory / kind / f"{key}{_SUFFIX}"

    def _make_room(self, kept: Path) -> None:
        """Remove the entries not used for longest, and what dead processes left, until the limit holds."""
        files = sorted(self._files(), key=lambda entry: entry.used)
        total = sum(entry.size for entry in files)
        now = time()
        for entry in files:
            left_over = entry.path.suffix == _UNFINISHED and now - entry.used > STALE
            if left_over or (total > self.limit and entry.path.suffix == _SUFFIX and entry.path != kept):
                with suppress(OSError):
                    entry.path.unlink()
                    total -= entry.size

    def _files(self) -> Iterator[Entry]:
        """Finished and unfinished entries, in no order."""
        for folder in _listed(self.directory):
            if not _is_name(folder.name) or not self._uses(folder):
                continue
            for path in _listed(folder):
                if path.suffix not in (_SUFFIX, _UNFINISHED) or not _is_key(path.name.partition(".")[0]):
                    continue
                with suppress(OSError):
                    found = path.lstat()
                    if stat.S_ISREG(found.st_mode):
                        yield Entry(kind=folder.name, path=path, size=found.st_size, used=found.st_mtime)


def standard_store() -> Store | None:
    """The store of this user: in ``$MBM_CACHE``, else ``$XDG_CACHE_HOME/mbm``, else ``~/.cache/mbm``.

    None if ``$MBM_CACHE`` is ``off``, or where the folder cannot be written to, or is not used (`Doubt`). Nothing is
    made before the first entry.
    """
    directory = standard_directory()
    if directory is None or doubt_about(directory) is not None:
        return None
    place = directory
    while not os.access(place, os.F_OK) and place != place.parent:
        place = place.parent
    writable = os.access(place, os.W_OK | os.X_OK) and os.access(f"{place}{os.sep}", os.F_OK)  # a file ends with none
    return Store(directory=directory) if writable else None


def standard_directory() -> Path | None:
    """Where the store of this user is, or would be; None if it is switched off, or the user has no home."""
    asked = os.environ.get(VARIABLE, "")
    if asked:
        return None if asked == OFF else Path(asked).absolute()
    base = os.environ.get("XDG_CACHE_HOME", "")
    if Path(base).is_absolute():  # the specification of base directories: relative paths are to be ignored
        return Path(base) / "mbm"
    try:
        return Path.home() / ".cache" / "mbm"
    except RuntimeError:
        return None


def _digest(kind: str, key: str, content: bytes) -> bytes:
    digest = sha256(_HEADER + f"{kind}/{key}\n".encode())
    digest.update(content)
    return digest.digest()


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _is_name(text: str) -> bool:
    """Words of ``a-z 0-9`` with ``-`` between them; no pattern, which would be compiled for every solve."""
    return all(word.isascii() and word.isalnum() and word == word.lower() for word in text.split("-"))


def _is_key(text: str) -> bool:
    return len(text) == 2 * _DIGEST and not text.strip("0123456789abcdef")


def _make(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for their owner only, whatever the umask."""
    if not folder.parent.exists():
        _make(folder.parent)
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        return
    if folder.lstat().st_mode & 0o777 != 0o700:
        folder.chmod(0o700)


def doubt_about(folder: Path) -> Doubt | None:
    """Why a folder is not used; None for one that is, and for one that may be made."""
    found = _status(folder)
    if found is None:
        return Doubt.ABOVE if _is_roots_in_anothers(folder) else None
    return _doubt(found)


def _is_ours(folder: Path) -> bool:
    """A folder that is there, and used."""
    found = _status(folder)
    return found is not None and _doubt(found) is None


def _status(path: Path) -> os.stat_result | None:
    """What a path leads to, links not followed; None if nothing can be known of it."""
    try:
        return path.lstat()
    except (OSError, ValueError):
        return None


def _doubt(found: os.stat_result) -> Doubt | None:
    if stat.S_ISLNK(found.st_mode):
        return Doubt.LINK
    if not stat.S_ISDIR(found.st_mode):
        return Doubt.NO_FOLDER
    if not _is_our_own(found):
        return Doubt.ANOTHERS
    return Doubt.OPEN if _is_open(found) else None


def _is_roots_in_anothers(folder: Path) -> bool:
    """Whether a folder would be made by root among what belongs to another user, as under ``sudo`` with its HOME."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return False
    above = next((found for found in map(_status, folder.parents) if found is not None), None)
    return above is not None and above.st_uid != 0


def _is_our_file(found: os.stat_result) -> bool:
    """An ordinary file of this user that nobody else may write to, under one name (none: it was replaced meanwhile)."""
    return stat.S_ISREG(found.st_mode) and found.st_nlink <= 1 and _is_our_own(found) and not _is_open(found)


def _is_our_own(found: os.stat_result) -> bool:
    """Whether something belongs to the user for whom, and by whose rights, this process runs."""
    if not hasattr(os, "getuid"):  # Windows: what is in the user's profile is the user's
        return True
    return found.st_uid == os.getuid() == os.geteuid()


def _is_open(found: os.stat_result) -> bool:
    """Whether others may write to something; lists of access rights (ACL) count as the rights of the group."""
    return hasattr(os, "getuid") and bool(found.st_mode & _FOR_OTHERS)
