"""Names of files below a folder: which lead nowhere else, and which of them are one file on some systems. The list
that a command leaves in a folder: which files it wrote there, each with the SHA-256 of its content.

It is written as ``sha256sum --check`` reads it, below a line that says what it is.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Mapping
from hashlib import file_digest, sha256
from pathlib import Path, PurePosixPath, PureWindowsPath

from mbm.files.reading import look_into
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

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


LARGEST = 4 * 2**20
"""Bytes of a list that is read."""

_ENTRY = re.compile(r"(?P<digest>[0-9a-f]{64})  (?P<path>.+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Maker:
    """A command that writes folders (``mbm compile``), and the name of its list there."""

    command: str
    manifest: str


COMPILE = Maker(command="mbm compile", manifest=".mbm-compile")
SIMULATE = Maker(command="mbm simulate", manifest=".mbm-simulate")
WRITE = Maker(command="mbm solve --write", manifest=".mbm-write")


def manifest_text(maker: Maker, files: Mapping[str, bytes]) -> bytes:
    """The list of the files by path, with what they hold."""
    lines = [f"# files that `{maker.command}` wrote, which it may replace as long as they are as listed"]
    lines += [f"{sha256(content).hexdigest()}  {path}" for path, content in sorted(files.items())]
    return ("\n".join(lines) + "\n").encode("utf-8")


def listed(path: Path) -> dict[str, str] | None:
    """The digests by path of a list; None if it is none, whatever is wrong with it."""
    try:
        lines = look_into(path, DataPlace(file=str(path)), largest=LARGEST).decode("utf-8").split("\n")
    except (MbmError, UnicodeDecodeError):
        return None
    entries = [_ENTRY.fullmatch(line) for line in lines if line and not line.startswith("#")]
    found = {entry["path"]: entry["digest"] for entry in entries if entry is not None and is_plain(entry["path"])}
    return found if len(found) == len(entries) else None


def is_unchanged(path: Path, digest: str) -> bool:
    """Whether an ordinary file holds what it held when it was listed.

    Raises:
        OSError: it cannot be read.

    """
    with path.open("rb") as stream:
        return file_digest(stream, "sha256").hexdigest() == digest
