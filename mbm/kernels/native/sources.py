"""Which texts mbm has in the little language: under a new digest their machine code is made anew."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path

import mbm.machine


@cache
def source_digest(package: str) -> str:
    """SHA-256 of the little language and of a ``package`` written in it (a folder of mbm).

    Equal content, equal code: what else decides (options, processor, version of LLVM) is in the key of `engine.kept`.
    They are read once: what a process has loaded stays as it is.
    """
    folder = Path(mbm.machine.__file__).parent
    digest = sha256()
    for path in sorted([*folder.glob("*.py"), *(folder.parent / package).glob("*.py")]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
