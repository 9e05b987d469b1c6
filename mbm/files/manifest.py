"""The list that a command leaves in a folder: which files it wrote there, each with the SHA-256 of its content.

It is written as ``sha256sum --check`` reads it, below a line that says what it is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from hashlib import file_digest, sha256
from pathlib import Path

from mbm.files.names import is_plain
from mbm.files.reading import look_into
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

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
