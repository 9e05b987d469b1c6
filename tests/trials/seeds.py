"""Seeds of random cases: one for each state of the sources, so that every commit tries others, and repeats its own."""

from __future__ import annotations

import os
from functools import cache
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parents[2]
VARIABLE = "MBM_FUZZ_SEED"
"""Environment variable that states the seed instead."""


def digest_of_sources() -> str:
    """The digest of everything that mbm is made of, names and contents."""
    return digest_of("mbm", "grammar")


@cache
def digest_of(*folders: str) -> str:
    """The digest of the texts in some folders, names and contents."""
    digest = sha256()
    files = [path for folder in folders for path in (ROOT / folder).rglob("*")]
    for path in sorted(files):
        if path.suffix in {".py", ".mbm", ".lark"}:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(ROOT).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def base_seed() -> int:
    """The seed of this run: what `VARIABLE` states, else what the sources lead to."""
    stated = os.environ.get(VARIABLE)
    return int(digest_of_sources()[:12], 16) if stated is None else int(stated)


def seed_for(*parts: object) -> int:
    """A seed of its own for each combination of parts."""
    return int.from_bytes(sha256(repr(parts).encode()).digest()[:8], "little")
