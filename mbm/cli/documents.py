"""Whether a file is a document that mbm wrote: a result, or diagnostics. Such a file may be written again."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mbm.files.reading import look_into
from mbm.text.types import DataPlace, MbmError

LARGEST = 64 * 2**20
"""Bytes of a document that is looked into; a longer one counts as something else."""

_BEGINNING = re.compile(rb'\{\s*"(?:diagnostics|mbm)":')
_RESULT = frozenset({"mbm", "file", "problem", "status", "options", "inputs", "solves"})
_DIAGNOSTIC = frozenset({"severity", "code", "message", "hint"})


def is_document(path: Path) -> bool:
    """Whether the file holds a result document, or ``{"diagnostics": […]}``, and nothing else."""
    try:
        content = look_into(path, DataPlace(file=str(path)), largest=LARGEST)
        if _BEGINNING.match(content) is None:
            return False
        value = json.loads(content)
    except (MbmError, ValueError, RecursionError):
        return False
    return isinstance(value, dict) and (_is_result(value) or _is_diagnostics(value))


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
