"""Which texts of mbm's own machine code is made of: under a new digest it is made anew."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path

import mbm.machine


@cache
def source_digest(package: str, lowered_by: str) -> str:
    """SHA-256 of the little language, of a ``package`` written in it (a folder of mbm) and of what lowers that.

    Equal content, equal code: what else decides (options, processor, version of LLVM) is in the key of `engine.kept`.
    They are read once: what a process has loaded stays as it is.
    """
    folder = Path(mbm.machine.__file__).parent
    digest = sha256()
    for path in sorted([*folder.glob("*.py"), *(folder.parent / package).glob("*.py"), Path(lowered_by)]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
