"""The one writer of files: whole or not at all, and never onto a file that was read.

An ordinary file is written beside its target, under a name that nobody knows, and takes the target's place when all of
it is on the disk: where the disk is full, or the program ends, the earlier file stands there as it was. Pipes, devices
and streams that are open already are written directly.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from select import select
from stat import S_IMODE, S_ISFIFO

from mbm.files import faults
from mbm.files.journal import WRITTEN, Read, note
from mbm.files.targets import Target, refuse_read, refuse_source, refuse_streamed, target_of
from mbm.text.types import MbmError

PATIENCE = 3.0
"""Seconds in which somebody may begin to read a pipe that is named as a target."""

_PAUSE = 0.02
_COMMON = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | _COMMON
_STREAM = os.O_WRONLY | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_NONBLOCK", 0) | _COMMON

_NOT_SYNCED = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)
"""What file systems answer that have nothing to wait for."""


def write_whole(
    path: str | os.PathLike[str],
    content: bytes,
    *,
    reads: Iterable[Read] = (),
    allowed: Iterable[str] = (),
    replaces_source: bool = False,
) -> None:
    """Write a file; what ``path`` leads to through links is replaced, the links stay.

    Args:
        path: the file, a pipe, a device, or ``/dev/fd/N``.
        content: all of it.
        reads: files that must not be replaced.
        allowed: roles for which a file may have been read and be replaced nevertheless.
        replaces_source: a problem file may be replaced.

    Raises:
        MbmError: not-writable, would-overwrite; what stood there is as it was.

    """
    target = checked_target(path, reads=reads, allowed=allowed, replaces_source=replaces_source)
    try:
        if target.descriptor is not None:
            _write_all(target.descriptor, content)
        elif target.is_ordinary:
            put(stage(target, content), target)
        else:
            _write_stream(target, content)
    except OSError as error:
        raise MbmError(faults.not_writable(target.name, faults.reason_of(error))) from None
    note(target.path, WRITTEN)


def checked_target(
    path: str | os.PathLike[str],
    *,
    reads: Iterable[Read] = (),
    allowed: Iterable[str] = (),
    replaces_source: bool = False,
) -> Target:
    """What `write_whole` would write to; nothing is touched.

    Raises:
        MbmError: not-writable, would-overwrite.

    """
    target = target_of(path)
    refuse_read(target, reads, allowed)
    refuse_streamed(target)
    if not replaces_source:
        refuse_source(target)
    return target


def stage(target: Target, content: bytes) -> Path:
    """Write ``content`` to a new file beside an ordinary target, with the target's mode; the path of that file.

    Raises:
        OSError: nothing is left of the new file.

    """
    temporary = target.path.with_name(f".mbm-{os.urandom(8).hex()}")
    descriptor = os.open(temporary, _NEW, 0o666 if target.status is None else 0o600)
    try:
        with open(descriptor, "wb") as stream:  # noqa: PTH123 - made with these flags
            stream.write(content)
            stream.flush()
            _synchronise(descriptor)
            if target.status is not None:
                _make_alike(temporary, target.status)
    except BaseException:
        discard(temporary)
        raise
    return temporary


def put(temporary: Path, target: Target) -> None:
    """A staged file takes the place of its target.

    Raises:
        OSError: the target is as it was, and nothing is left of the staged file.

    """
    try:
        temporary.replace(target.path)
    except BaseException:
        discard(temporary)
        raise


def discard(temporary: Path) -> None:
    """Remove a staged file, if it is there."""
    with suppress(OSError):
        temporary.unlink()


def _make_alike(path: Path, status: os.stat_result) -> None:
    """The owner and the group, where that may be said, and the mode of the file that is to be replaced.

    Where the group cannot be kept, the group that the new file has gets what all others have: nobody gets more.
    """
    mode = S_IMODE(status.st_mode) & 0o777
    if hasattr(os, "chown") and not (_owned(path, status.st_uid, status.st_gid) or _owned(path, -1, status.st_gid)):
        mode = (mode & ~0o070) | (mode & (mode << 3) & 0o070)
    path.chmod(mode)


def _owned(path: Path, user: int, group: int) -> bool:
    try:
        os.chown(path, user, group)
    except OSError:
        return False
    return True


def _synchronise(descriptor: int) -> None:
    """Wait until the content is on the disk: only now some file systems say that there is no room for it."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NOT_SYNCED:
            raise


def _write_stream(target: Target, content: bytes) -> None:
    """Write to a pipe or a device; a pipe that nobody begins to read is given up."""
    is_pipe = target.status is not None and S_ISFIFO(target.status.st_mode)
    patient_until = time.monotonic() + PATIENCE
    while True:
        try:
            descriptor = os.open(target.path, _STREAM)
            break
        except OSError as error:
            if not is_pipe or error.errno != errno.ENXIO:
                raise
        if time.monotonic() > patient_until:
            raise OSError(errno.ENXIO, "nobody reads from this pipe")
        time.sleep(_PAUSE)
    try:
        _write_all(descriptor, content)
    finally:
        os.close(descriptor)


def _write_all(descriptor: int, content: bytes) -> None:
    """Write to an open stream, however slowly it is read; a reader that goes away has read what it wanted."""
    rest = memoryview(content)
    with suppress(BrokenPipeError, ConnectionResetError):
        while rest:
            try:
                rest = rest[os.write(descriptor, rest) :]
            except BlockingIOError:
                select([], [descriptor], [])
