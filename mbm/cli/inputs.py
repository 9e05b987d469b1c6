"""Texts of the command line → what they say: ``NAME=VALUE``, and files of JSON."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mbm.cli import faults
from mbm.text.types import MbmError


def named_texts(option: str, entries: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """``h=70cm`` → ``("h", "70cm")``. Raises MbmError (bad-call) without a name, a ``=`` or a value."""
    pairs = []
    for entry in entries:
        name, sign, value = (part.strip() for part in entry.partition("="))
        if not name or not sign or not value:
            raise MbmError(faults.bad_call(f"{option} wants NAME=VALUE, and `{entry}` is not", "mbm solve"))
        pairs.append((name, value))
    return tuple(pairs)


def named_paths(option: str, entries: Iterable[str]) -> dict[str, Path]:
    """``ranges=today.csv`` → ``{"ranges": Path("today.csv")}``. Raises MbmError (bad-call), also for repetitions."""
    paths: dict[str, Path] = {}
    for name, value in named_texts(option, entries):
        if name in paths:
            raise MbmError(faults.bad_call(f"{option} names `{name}` twice", "mbm solve"))
        paths[name] = Path(value)
    return paths


def json_object(path: Path) -> dict[str, Any]:
    """The JSON object that a file holds. Raises MbmError (bad-json) if it holds none."""
    import json

    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise MbmError(faults.not_readable(str(path), error.strerror or str(error))) from error
    except json.JSONDecodeError as error:
        where = f"{error.msg.lower()} in line {error.lineno}, column {error.colno}"
        raise MbmError(faults.bad_json(str(path), where)) from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise MbmError(faults.bad_json(str(path), "it is no text, or nested too deeply")) from error
    if not isinstance(value, dict):
        raise MbmError(faults.bad_json(str(path), "an object of names and values is wanted"))
    return value
