"""Names of files below a folder: which lead nowhere else, and which of them are one file on some systems."""

from __future__ import annotations

import os
import unicodedata
from pathlib import PurePosixPath, PureWindowsPath

LONGEST = 200
"""Bytes of a part of a path: file systems take 255, and a name may gain an ending."""


def is_plain(path: str) -> bool:
    """Whether a path with slashes leads to a file below the folder that it is relative to, here as on other systems.

    ``..``, absolute paths, drives, names that cannot be shown on one line and names that no file can have are refused.
    """
    parts = path.split("/")
    return all(
        part not in ("", ".", "..")
        and part.isprintable()
        and len(os.fsencode(part)) <= LONGEST
        and PureWindowsPath(part).parts == (part,)
        and not PureWindowsPath(part).anchor
        for part in parts
    )


def folded(path: str) -> str:
    """A path as file systems see it that know neither capitals nor how a letter is composed."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", path).casefold())


class Names:
    """Gives out paths of files below one folder, each once, none of them also that of a folder."""

    def __init__(self) -> None:
        self._files: set[str] = set()
        self._folders: set[str] = set()

    def is_free(self, path: str) -> bool:
        """Whether a file can have this path beside those that were given out."""
        own = folded(path)
        return own not in self._files | self._folders and not self._files & _above(own)

    def taken(self, path: str) -> str:
        """The path, which from now on is taken."""
        own = folded(path)
        self._files.add(own)
        self._folders.update(_above(own))
        return path

    def own(self, wanted: str) -> str:
        """The path that is ``wanted``, or one like it, which from now on is taken: ``a.csv``, ``a-2.csv``, …"""
        path, number = PurePosixPath(wanted), 2
        if self._files & _above(folded(wanted)):  # a file stands where its folder would be
            path = PurePosixPath(path.name)
        found = str(path)
        while not self.is_free(found):
            found = str(path.with_name(f"{path.stem}-{number}{path.suffix}"))
            number += 1
        return self.taken(found)


def file_name(text: str, ending: str) -> str:
    """A plain name with an ending, as much like ``text`` as can be: letters and digits of all alphabets, ``. _ -``."""
    kept = "".join(c if c.isalnum() or c in "._-" else "-" for c in unicodedata.normalize("NFC", text)).strip(".-")
    short = kept.encode("utf-8")[: LONGEST // 2].decode("utf-8", errors="ignore")
    return f"{short or 'unnamed'}{ending}"


def _above(path: str) -> set[str]:
    """The folders on the way to a path."""
    parts = path.split("/")
    return {"/".join(parts[:count]) for count in range(1, len(parts))}
