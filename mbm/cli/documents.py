"""Documents that a slip on the command line may send anywhere: they replace only what mbm wrote itself."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbm.cli.output import write_bytes
from mbm.files.journal import Read
from mbm.text.types import DataPlace, MbmError

STANDARD_OUTPUT = "-"
"""The ``PATH`` of ``--json`` that means standard output."""

LARGEST = 64 * 2**20
"""Bytes of a document that is looked into; a longer one counts as something else."""

_BEGINNING = re.compile(rb'\{\s*"(?:diagnostics|mbm|path)":')
_RESULT = frozenset({"mbm", "file", "problem", "status", "options", "inputs", "solves"})
_DIAGNOSTIC = frozenset({"severity", "code", "message", "hint"})
_CACHE = frozenset({"path", "entries", "bytes", "kinds"})


def refuse_standard_output(path: str | Path) -> None:
    """Refuse to write a file or folder of the name ``-``.

    Raises:
        MbmError: not-writable.

    """
    if str(path) == STANDARD_OUTPUT:
        from mbm.files.faults import not_writable

        told = not_writable(path, "only `--json -` goes to standard output")
        raise MbmError(replace(told, hint="name a file or a folder"))


def check_document(destination: str | None, reads: Iterable[Read]) -> None:
    """Whether diagnostics, or what the cache holds, may be written to a destination of ``--json``, before they are.

    Raises:
        MbmError: not-writable, would-overwrite.

    """
    if destination is None or destination == STANDARD_OUTPUT:
        return
    from mbm.files.faults import not_our_document
    from mbm.files.writing import checked_target

    target = checked_target(destination, reads=reads)
    if target.is_ordinary and target.status is not None and target.status.st_size and not is_document(target.path):
        raise MbmError(not_our_document(destination))


def write_document(content: bytes, destination: str, *, reads: Iterable[Read]) -> None:
    """A document into a file, or to standard output for ``-``.

    Raises:
        MbmError: not-writable, would-overwrite; what stood there is as it was.

    """
    if destination == STANDARD_OUTPUT:
        write_bytes(content)
        return
    from mbm.files.writing import write_whole

    reads = tuple(reads)
    check_document(destination, reads)
    write_whole(destination, content, reads=reads)


def is_document(path: Path) -> bool:
    """Whether the file holds a result document, ``{"diagnostics": […]}`` or what ``mbm cache`` says; nothing else."""
    import json

    from mbm.files.reading import look_into

    try:
        content = look_into(path, DataPlace(file=str(path)), largest=LARGEST)
        if _BEGINNING.match(content) is None:
            return False
        value = json.loads(content)
    except (MbmError, ValueError, RecursionError):
        return False
    return isinstance(value, dict) and (_is_result(value) or _is_diagnostics(value) or _is_cache(value))


def _is_result(value: dict[str, Any]) -> bool:
    texts, lists = ("mbm", "problem", "status"), ("inputs", "solves")
    return (
        value.keys() >= _RESULT
        and all(isinstance(value[name], str) for name in texts)
        and all(isinstance(value[name], list) for name in lists)
    )


def _is_diagnostics(value: dict[str, Any]) -> bool:
    return value.keys() == {"diagnostics"} and (
        isinstance(value["diagnostics"], list)
        and all(isinstance(each, dict) and each.keys() >= _DIAGNOSTIC for each in value["diagnostics"])
    )


def _is_cache(value: dict[str, Any]) -> bool:
    return value.keys() >= _CACHE and isinstance(value["entries"], int) and isinstance(value["kinds"], dict)
