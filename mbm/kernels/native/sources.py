"""mbm's own texts in the little language as IR, and which texts those are: under a new digest they are made anew."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import mbm.machine

if TYPE_CHECKING:
    from mbm.machine.tree import Module


@cache
def source_digest(package: str) -> str:
    """SHA-256 of the little language, of a ``package`` written in it (a folder of mbm) and of this file.

    Equal content, equal code: what else decides (options, processor, version of LLVM) is in the key of `engine.kept`.
    They are read once: what a process has loaded stays as it is.
    """
    folder = Path(mbm.machine.__file__).parent
    digest = sha256()
    for path in sorted([*folder.glob("*.py"), *(folder.parent / package).glob("*.py"), Path(__file__)]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def lowered(module: Module, flags: tuple[str, ...] = ()) -> str:
    """The IR of a module; ``flags`` as `lower_into` takes them. What only returns a value stands in place of calls."""
    from llvmlite import ir

    from mbm.machine.llvm import lower_into
    from mbm.machine.tree import Return

    target = ir.Module(module.name)
    lower_into(target, module, flags)
    for each in module.functions:
        if len(each.body) == 1 and isinstance(each.body[0], Return):
            target.get_global(each.name).attributes.add("alwaysinline")
    return str(target)
