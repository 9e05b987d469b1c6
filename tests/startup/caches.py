"""Caches of single tests, apart from that of the run."""

from __future__ import annotations

import shutil
from pathlib import Path

LARGE = 100_000
"""Bytes of machine code that is not that of one small problem: the solver's."""


def seeded(cache: Path, shared: Path) -> None:
    """Puts the solver's machine code into a cache that is not there yet: it takes long to make, and is another matter
    than what is derived of a text.
    """
    if cache.exists():
        return
    (cache / "object").mkdir(mode=0o700, parents=True)
    cache.chmod(0o700)
    for entry in (shared / "object").glob("*.entry"):
        if entry.stat().st_size > LARGE:
            shutil.copy2(entry, cache / "object")


def forgotten(cache: Path) -> None:
    """Removes all that was kept but machine code, which takes long to make and is another matter."""
    for folder in cache.iterdir():
        if folder.name != "object":
            shutil.rmtree(folder)
