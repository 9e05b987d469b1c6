"""What a command touches besides what it says: files written or removed elsewhere, files opened that are closed to it,
programs started, the network. Python tells of all of these by audit events."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from mbm.kernels.store import VARIABLE

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGING = {
    *("os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown"),
    *("os.utime", "shutil.move", "shutil.rmtree", "shutil.copyfile"),
}
LEAVING = {
    *("subprocess.Popen", "os.system", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "pty.spawn"),
    *("socket.connect", "socket.bind", "socket.sendto", "urllib.Request", "webbrowser.open"),
}

HEARD = {"open"} | CHANGING | LEAVING
"""Of all events, of which `id` is one, those that matter."""


@dataclass(kw_only=True)
class Watch:
    """Folders in which anything may be written, devices that may be, files that must not be opened; who is told."""

    inside: tuple[str, ...]
    devices: frozenset[str]
    closed: frozenset[str]
    tell: Callable[[str], object]

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """One audit event."""
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, str | bytes):
                self._opened(os.fsdecode(path), flags or 0)
        elif event in CHANGING:
            for path in arguments:
                if isinstance(path, str | bytes):
                    self._changed(event, os.fsdecode(path))
        elif event in LEAVING:
            self.tell(f"{event} {arguments[:2]!r}")

    def _opened(self, path: str, flags: int) -> None:
        if flags & WRITING:
            self._changed("written", path)
        elif os.path.realpath(path) in self.closed:
            self.tell(f"read: {path}")

    def _changed(self, what: str, path: str) -> None:
        if ".pyc" in path or path.endswith("__pycache__") or path in self.devices:
            return
        if sys.pycache_prefix is not None and path.startswith(sys.pycache_prefix):
            return
        place = os.path.join(os.path.realpath(os.path.dirname(path) or "."), os.path.basename(path))  # noqa: PTH118, PTH119, PTH120
        if not place.startswith(self.inside):
            self.tell(f"{what}: {path}")


_CURRENT: list[Watch] = []
_HEARING: list[bool] = []


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if event in HEARD and _CURRENT:
        watch = _CURRENT.pop()  # what the watch does itself is not heard
        try:
            watch.hear(event, arguments)
        finally:
            _CURRENT.append(watch)


def begin(folder: Path, devices: Iterable[str], closed: Iterable[Path], tell: Callable[[str], object]) -> None:
    """From now on ``tell`` is told what happens that should not; ``folder`` and mbm's cache may be written to."""
    if not _HEARING:
        sys.addaudithook(_hook)  # for good: hooks cannot be taken away
        _HEARING.append(True)
    inside = [os.path.realpath(folder) + os.sep]
    if VARIABLE in os.environ:
        inside += [os.path.realpath(os.environ[VARIABLE]), os.path.realpath(os.environ[VARIABLE]) + os.sep]
    outside = frozenset(os.path.realpath(path) for path in closed)
    _CURRENT.append(Watch(inside=tuple(inside), devices=frozenset(devices), closed=outside, tell=tell))


@contextmanager
def watched(folder: Path, devices: Iterable[str], closed: Iterable[Path]) -> Iterator[list[str]]:
    """Inside, the list gets what happened that should not have (`begin`)."""
    seen: list[str] = []
    begin(folder, devices, closed, seen.append)
    try:
        yield seen
    finally:
        _CURRENT.pop()


def digests(paths: Iterable[Path]) -> dict[Path, str | None]:
    """What stands in files; None where there is none."""
    return {path: sha256(path.read_bytes()).hexdigest() if path.is_file() else None for path in paths}
