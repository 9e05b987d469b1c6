"""The one writer of folders: all files or none, nothing lost that somebody else put there, and no links followed."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from stat import S_ISDIR, S_ISLNK, S_ISREG

from mbm.files import faults
from mbm.files.journal import THE_PROBLEM, Read
from mbm.files.names import Maker, Names, folded, is_plain, is_unchanged, listed, manifest_text
from mbm.files.targets import WRITABLE, Target, refuse_read
from mbm.files.writing import discard, put, stage
from mbm.text.types import Diagnostic, MbmError

Files = Sequence[tuple[str, bytes]]
"""Paths below a folder, with slashes, and what the files are to hold."""


def write_new_folder(folder: Path, files: Files) -> None:
    """Write a folder that does not exist yet, or holds nothing.

    Raises:
        MbmError: exists-already, not-writable; nothing was written.

    """
    with _diagnosed(folder):
        status = _status(folder)
        if status is not None and (not S_ISDIR(status.st_mode) or any(folder.iterdir())):
            raise MbmError(faults.exists_already(folder))
        _check_names(folder, files)
        _fill(folder, dict(files), exists=status is not None)


def check_folder(folder: Path, maker: Maker, *, force: bool, reads: Iterable[Read] = ()) -> None:
    """What speaks against writing a folder as far as can be said before its files are made; nothing is touched.

    Raises:
        MbmError: as `write_folder`.

    """
    with _diagnosed(folder):
        _known(folder, maker, force=force, reads=reads)
        missing = _missing(folder.absolute())
        standing = missing[-1].parent if missing else folder
        if not os.access(standing, os.W_OK | os.X_OK):
            raise MbmError(faults.not_writable(standing, "it is read-only"))


def refuse_one_folder(folders: Iterable[Path]) -> None:
    """Refuse two that are one folder, whatever they are called: the second would take away the files of the first.

    Raises:
        MbmError: would-overwrite.

    """
    known: dict[str, Path] = {}
    for folder in folders:
        real = folded(os.path.realpath(folder))
        if real in known:
            raise MbmError(faults.one_folder(known[real].as_posix(), folder.as_posix()))
        known[real] = folder


def write_folder(folder: Path, files: Files, maker: Maker, *, force: bool, reads: Iterable[Read] = ()) -> None:
    """Write the files of a command into a folder, with a list of them.

    A folder that holds other things is refused, unless it has such a list. Files that the list does not name, or that
    were changed since, are never replaced; those that are no longer made are removed if they are unchanged. ``force``
    writes into any folder and replaces files of the same names; links, and files of ``reads``, are refused even then,
    and so is the folder of the problem.

    Raises:
        MbmError: foreign-folder, would-overwrite, not-writable; the files that were there are as they were.

    """
    reads = tuple(reads)
    with _diagnosed(folder):
        known = _known(folder, maker, force=force, reads=reads)
        _check_names(folder, [*files, (maker.manifest, b"")])
        made = dict(files)
        wrong: list[Diagnostic] = []
        for path in (*made, maker.manifest):
            try:
                _check_place(folder, path, reads)
                if not force and path != maker.manifest:
                    _check_own(folder, path, known.get(path), maker)
            except MbmError as error:
                wrong.extend(error.diagnostics)
        if wrong:
            raise MbmError(*wrong)
        _fill(folder, {**made, maker.manifest: manifest_text(maker, made)}, exists=_status(folder) is not None)
        _remove_obsolete(folder, known, made, reads)


@contextmanager
def _diagnosed(folder: Path) -> Iterator[None]:
    """What the system objects to becomes a diagnostic."""
    try:
        yield
    except OSError as error:
        raise MbmError(faults.not_writable(folder, faults.reason_of(error))) from None
    except ValueError:
        raise MbmError(faults.not_writable(folder, "no folder can have this name")) from None


def _status(path: Path) -> os.stat_result | None:
    """What stands at a path, a link itself and not what it leads to; None: nothing."""
    try:
        return path.lstat()
    except FileNotFoundError:
        return None


def _known(folder: Path, maker: Maker, *, force: bool, reads: Iterable[Read]) -> Mapping[str, str]:
    """The digests of the files that ``maker`` wrote into a folder, by path, where it may write into that again."""
    status = _status(folder)
    if status is None:
        return {}
    _check_folder_at(folder, status)
    if any(_holds(folder, read) for read in reads if THE_PROBLEM in read.roles):
        raise MbmError(faults.not_writable(folder, "it holds the problem, whose data would be replaced"))
    manifest = folder / maker.manifest
    there = _status(manifest)
    if there is not None and S_ISREG(there.st_mode):
        known = listed(manifest)
        if known is None and not force:
            raise MbmError(faults.unreadable_list(folder, maker.manifest, maker.command))
        return known or {}
    other = min((entry.name for entry in folder.iterdir()), default=None)
    if other is not None and not force:
        raise MbmError(faults.foreign_folder(folder, other, maker.command))
    return {}


def _holds(folder: Path, read: Read) -> bool:
    """Whether a file that was read lies in a folder, as it was named or where links lead."""
    for path in (Path(read.path), Path(os.path.realpath(read.path))):
        with suppress(OSError):
            if path.parent.samefile(folder):
                return True
    return False


def _check_names(folder: Path, files: Files) -> None:
    """Refuse paths that lead out of the folder, and two that are one file somewhere."""
    names = Names()
    for path, _ in files:
        if not is_plain(path):
            raise MbmError(faults.not_writable(f"{folder.as_posix()}/{path}", "no file below a folder is called so"))
        if not names.is_free(path):
            raise MbmError(faults.not_writable(folder / path, "two files would have this name"))
        names.taken(path)


def _check_folder_at(place: Path, status: os.stat_result) -> None:
    if S_ISLNK(status.st_mode):
        raise MbmError(faults.symbolic_link(place))
    if not S_ISDIR(status.st_mode):
        raise MbmError(faults.not_writable(place, "it is no folder"))


def _check_place(folder: Path, path: str, reads: Iterable[Read]) -> None:
    """Refuse links, what is no ordinary file, and what was read."""
    for above in reversed(PurePosixPath(path).parents[:-1]):
        status = _status(folder / above)
        if status is None:
            return
        _check_folder_at(folder / above, status)
    place = folder / path
    target = _target(place)
    if target.status is None:
        return
    if S_ISLNK(target.status.st_mode):
        raise MbmError(faults.symbolic_link(place))
    if not S_ISREG(target.status.st_mode):
        raise MbmError(faults.not_writable(place, "it is no ordinary file"))
    refuse_read(target, reads)
    if not target.status.st_mode & WRITABLE or not os.access(place, os.W_OK):
        raise MbmError(faults.not_writable(place, "it is read-only"))


def _check_own(folder: Path, path: str, digest: str | None, maker: Maker) -> None:
    """Refuse a file that ``maker`` did not write, or that was changed since."""
    place = folder / path
    if _status(place) is None:
        return
    if digest is None:
        raise MbmError(faults.foreign_file(place.as_posix(), maker.command))
    if not is_unchanged(place, digest):
        raise MbmError(faults.changed_file(place.as_posix(), maker.command))


def _target(place: Path) -> Target:
    return Target(name=place.as_posix(), path=place, descriptor=None, status=_status(place))


def _fill(folder: Path, files: Mapping[str, bytes], *, exists: bool) -> None:
    """Put the files into a folder that ``exists``, or make it as a whole."""
    if exists:
        _replace(folder, files)
        return
    made: list[Path] = []
    temporary = folder.with_name(f".mbm-{os.urandom(8).hex()}")
    try:
        _make(temporary, made)
        _replace(temporary, files)
        temporary.rename(folder)
    except BaseException:
        for path in files:
            discard(temporary / path)
        for place in {(temporary / path).parent for path in files}:
            _remove_empty(place, temporary)
        _unmake(made)
        raise


def _replace(folder: Path, files: Mapping[str, bytes]) -> None:
    """All files are written beside their targets before the first one takes its place."""
    made: list[Path] = []
    staged: list[tuple[Path, Target]] = []
    try:
        for path, content in files.items():
            target = _target(folder / path)
            _make(target.path.parent, made)
            staged.append((stage(target, content), target))
        for temporary, target in staged:
            put(temporary, target)
    except BaseException:
        for temporary, _ in staged:
            discard(temporary)
        _unmake(made)
        raise


def _make(folder: Path, made: list[Path]) -> None:
    """Make a folder with those above it, and add the ones that were missing to ``made``."""
    for place in reversed(_missing(folder)):
        place.mkdir()
        made.append(place)


def _missing(folder: Path) -> list[Path]:
    """The folders that do not exist, from ``folder`` upwards.

    Raises:
        OSError: the path leads back out of one of them.

    """
    missing = []
    while _status(folder) is None:
        if folder.name == "..":
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        missing.append(folder)
        folder = folder.parent
    return missing


def _unmake(made: Iterable[Path]) -> None:
    """Remove folders that were made, as far as they are empty."""
    for place in reversed(tuple(made)):
        with suppress(OSError):
            place.rmdir()


def _remove_obsolete(folder: Path, known: Mapping[str, str], made: Iterable[str], reads: Iterable[Read]) -> None:
    """Remove files that were listed and are no longer made, if they are as they were listed."""
    kept = {folded(path) for path in made}
    for path, digest in known.items():
        place = folder / path
        with suppress(OSError, MbmError):
            _check_place(folder, path, reads)
            if folded(path) not in kept and is_unchanged(place, digest):
                place.unlink()
                _remove_empty(place.parent, folder)


def _remove_empty(place: Path, folder: Path) -> None:
    """Remove a folder and those above it up to ``folder`` (which stays), as far as they are empty."""
    with suppress(OSError):
        while place != folder:
            place.rmdir()
            place = place.parent
