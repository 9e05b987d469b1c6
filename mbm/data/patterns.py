"""Files by pattern: ``"left*.jpg"`` names all files of one folder whose names it fits, in the order of their names.

``*`` stands for any characters and ``?`` for one, in the name of the file only; names that begin with a point are
fitted only by patterns that do.
"""

from __future__ import annotations

import os
import re
from fnmatch import translate
from pathlib import Path

from mbm.data import faults
from mbm.files.faults import too_many_files, unreadable_file
from mbm.text.types import MbmError, Span

WILD = re.compile(r"[*?]")
MOST_MATCHES = 10_000
"""Files that one pattern may name."""

MOST_ENTRIES = 1_000_000
"""Entries of a folder that are looked at."""


def is_pattern(path: Path) -> bool:
    """Whether the name of a file holds ``*`` or ``?``."""
    return WILD.search(path.name) is not None


def matching(path: Path, place: Span) -> tuple[Path, ...]:
    """The files that a pattern names, in the order of their names; without ``*`` and ``?``, the path itself.

    Raises:
        MbmError: no-matching-file, unreadable-file, too-many-files.

    """
    if not is_pattern(path):
        return (path,)
    names = []
    fits = re.compile(translate(path.name.replace("[", "[[]")))  # without backtracking over several stars
    try:
        with os.scandir(path.parent) as entries:
            for number, entry in enumerate(entries):
                if number >= MOST_ENTRIES:
                    raise MbmError(too_many_files(place, MOST_ENTRIES))
                if fits.match(entry.name) and entry.name.startswith(".") == path.name.startswith("."):
                    names.append(entry.name)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        raise MbmError(faults.no_matching_file(place, path.as_posix())) from None
    except OSError as error:
        raise MbmError(unreadable_file(path.parent, error.strerror or type(error).__name__, place)) from None
    if not names:
        raise MbmError(faults.no_matching_file(place, path.as_posix()))
    if len(names) > MOST_MATCHES:
        raise MbmError(too_many_files(place, MOST_MATCHES))
    return tuple(path.with_name(name) for name in sorted(names))
