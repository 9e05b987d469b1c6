"""What was derived or compiled once and is found again by its content: bytes under a kind and a key, in files.

Each entry is a file of its own, ``DIRECTORY/KIND/KEY.entry``: a line that names the format and mbm's version, the
SHA-256 of kind, key and content, then the content. An entry that does not check, because it is cut off, written to,
moved, or of another version, is as good as none, and removed. Entries appear under their names when they are whole
(they are renamed into place), so that any number of processes may read and write at once. Nothing here ever raises
for what the file system does: without a store everything is computed again.

Object code comes out of it, so the folder of a kind is used only if it belongs to the user and nobody else may write
to it, and symbolic links are not followed.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import suppress
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
_FEW = 64
_OFTEN = 16
"""The folder is looked through after entries above this part of the limit, and after so many of 256 others: looking
takes longer than writing where there are thousands."""

_DIGEST = 32
_SUFFIX, _UNFINISHED = ".entry", ".part"
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A file of the store; ``used`` is when it was last read or written (seconds since 1970), ``size`` in bytes."""

    kind: str
    path: Path
    size: int
    used: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Store:
    """Entries in the folder ``directory``, ``limit`` bytes at most. Kinds and keys are words of ``a-z 0-9 -``."""

    directory: Path
    limit: int = LIMIT

    def get(self, kind: str, key: str) -> bytes | None:
        """The content that was put under this kind and key; None where there is none that can be trusted."""
        path = self._path(kind, key)
        if not _is_ours(path.parent):
            return None
        try:
            with os.fdopen(os.open(path, os.O_RDONLY | _NO_LINKS), "rb") as stream:
                whole = stream.read()
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
        try:
            self.directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            path.parent.mkdir(mode=0o700, exist_ok=True)
            if not _is_ours(path.parent):
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
        if size > self.limit // _FEW or _digest(kind, key, b"")[0] < _OFTEN:
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

    def _path(self, kind: str, key: str) -> Path:
        for name in (kind, key):
            if not _is_name(name):
                raise ValueError(name)
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
            if not _is_name(folder.name) or not _is_ours(folder):
                continue
            for path in _listed(folder):
                key = path.name.partition(".")[0]
                if path.suffix not in (_SUFFIX, _UNFINISHED) or not _is_name(key):
                    continue
                with suppress(OSError):
                    found = path.lstat()
                    if stat.S_ISREG(found.st_mode):
                        yield Entry(kind=folder.name, path=path, size=found.st_size, used=found.st_mtime)


def standard_store() -> Store | None:
    """The store of this user: in ``$MBM_CACHE``, else ``$XDG_CACHE_HOME/mbm``, else ``~/.cache/mbm``.

    None if ``$MBM_CACHE`` is ``off``, or where the folder cannot be written to. Nothing is made before the first entry.
    """
    directory = standard_directory()
    if directory is None:
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


def _is_ours(folder: Path) -> bool:
    """A folder, no link to one, that belongs to this user and that nobody else may write to."""
    try:
        found = folder.lstat()
    except (OSError, ValueError):
        return False
    if not stat.S_ISDIR(found.st_mode):
        return False
    if not hasattr(os, "getuid"):  # Windows: folders in the user's profile are the user's
        return True
    return found.st_uid == os.getuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
