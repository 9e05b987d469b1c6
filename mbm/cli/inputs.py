"""Texts of the command line → what they say: ``NAME=VALUE``, and files of JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.cli import faults
from mbm.files.journal import note, option_role
from mbm.text.faults import shown
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.options import SolveOptions


def solve_options(given: Mapping[str, Any]) -> SolveOptions:
    """What the options that commands with a solve share say. Raises as `named_paths` and `initial_values` do."""
    from mbm.report.options import SolveOptions

    return SolveOptions(
        problem=given["problem"],
        set=named_texts("--set", given["settings"]),
        data=named_paths("--data", given["data"]),
        init=None if given.get("init") is None else initial_values(Path(given["init"])),
        seed=given["seed"],
        sandbox=None if given["sandbox"] is None else Path(given["sandbox"]),
        allow_external=given["allow_external"],
    )


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


def initial_values(path: Path) -> dict[str, Any]:
    """What the file of ``--init`` holds; it counts among the files that the call reads. Raises as `json_object`."""
    note(path, option_role("--init"))
    return json_object(path)


def json_object(path: Path) -> dict[str, Any]:
    """The JSON object that a file, or a stream that the shell hands over, holds; every name in it occurs once.

    Raises MbmError: bad-json, too-much-memory, and as `mbm.files.reading.read_bytes` does.
    """
    from json import detect_encoding

    from mbm.files.json_text import MARKS, JsonError, parsed
    from mbm.files.memory import check_memory, largest_file, text_memory
    from mbm.files.reading import read_bytes
    from mbm.text.types import DataPlace

    place = DataPlace(file=str(path))
    content = read_bytes(path, place, largest=largest_file(), streams=True)
    values = sum(content.count(mark) for mark in MARKS)
    check_memory(text_memory(content, values), f"the file `{shown(path)}` with {values:,} values", place)
    try:
        found = parsed(content.decode(detect_encoding(content)))
    except UnicodeDecodeError as error:
        raise MbmError(faults.bad_json(str(path), f"byte 0x{content[error.start]:02x} belongs to no text")) from None
    except JsonError as error:
        where = "" if error.line is None else f" in line {error.line}, column {error.column}"
        raise MbmError(faults.bad_json(str(path), f"{error.reason[:1].lower()}{error.reason[1:]}{where}")) from None
    if not isinstance(found.value, dict):
        raise MbmError(faults.bad_json(str(path), "an object of names and values is wanted"))
    if found.twice is not None:
        raise MbmError(faults.bad_json(str(path), f"the name `{shown(found.twice)}` stands in one object twice"))
    return found.value
