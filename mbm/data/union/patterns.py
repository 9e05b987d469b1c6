"""Paths with ``*`` or ``?`` in the name of the file: which files they mean, and what a row of each is told by."""

from __future__ import annotations

import os
from fnmatch import translate
from pathlib import Path
from re import compile as compiled

from mbm.data.content import COMPRESSED
from mbm.data.union import faults
from mbm.files.faults import unreadable_file
from mbm.text.types import MbmError, Place

WILD = "*?"

MOST_MATCHES = 1000
"""Files that one pattern may fit."""


def is_pattern(path: str) -> bool:
    """Whether a path, as it is written, names files by a pattern; brackets are characters of a name."""
    return any(wild in path for wild in WILD)


def matching(base: Path, path: str, place: Place) -> dict[str, Path]:
    """The files that fit, in the order of their names, by what their rows are told by; a path without pattern is one.

    ``path`` is relative to ``base``. A name that begins with a point fits only a pattern that does. Nothing is opened.

    Raises:
        MbmError: bad-pattern, no-match, too-many-matches, unreadable-file.

    """
    pattern = base / path
    shown = pattern.as_posix()
    if not is_pattern(path):
        return {source_of(pattern): pattern}
    if is_pattern(str(Path(path).parent)):
        raise MbmError(faults.pattern_in_folder(place, shown))
    fits = compiled(translate(pattern.name.replace("[", "[[]"))).match
    hidden = pattern.name.startswith(".")
    names = []
    try:
        with os.scandir(pattern.parent) as entries:
            for entry in entries:
                if fits(entry.name) and (hidden or not entry.name.startswith(".")):
                    names.append(entry.name)
                if len(names) > MOST_MATCHES:
                    raise MbmError(faults.too_many_matches(place, shown, MOST_MATCHES))
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a NUL in the name of the folder
        raise MbmError(faults.no_match(place, shown, folder=False)) from None
    except OSError as error:
        raise MbmError(unreadable_file(pattern.parent, error.strerror or type(error).__name__, place)) from None
    if not names:
        raise MbmError(faults.no_match(place, shown, folder=True))
    found: dict[str, Path] = {}
    for name in sorted(names):
        file = pattern.with_name(name)
        source = source_of(file)
        if source in found:
            raise MbmError(faults.same_source(place, found[source].name, name, source))
        found[source] = file
    return found


def source_of(path: Path) -> str:
    """The name of a file without folder and ending, of a packed one without the ending before it either."""
    bare = path.stem if path.suffix.lower() in COMPRESSED else path.name
    return os.fsencode(Path(bare).stem).decode("utf-8", errors="replace")


def shot_of(pattern: str, path: Path) -> str:
    """What ``*`` and ``?`` of a pattern stand for in the name of a file that fits; without any, as `source_of`.

    So `left07.jpg` and `right07.jpg`, by the patterns `left*.jpg` and `right*.jpg`, are told by the same text `07`.
    """
    own = Path(pattern).name
    first = min((own.find(sign) for sign in "*?" if sign in own), default=len(own))
    last = max(own.rfind(sign) for sign in "*?") + 1
    stands = path.name[first : len(path.name) - (len(own) - last)] if last else ""
    return os.fsencode(stands).decode("utf-8", errors="replace") or source_of(path)
