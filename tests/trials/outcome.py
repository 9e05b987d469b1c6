"""Runs a command line in this process and says what is wrong with how that ended."""

from __future__ import annotations

import io
import json
import os
import re
import resource
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from pkgutil import walk_packages
from time import process_time
from types import FrameType
from typing import Any

import mbm
from mbm.cli.main import run
from mbm.text.types import Code

SLOWEST = 5.0
"""Seconds of processor time that no answer may take: a bound against hangs, since the usual case takes milliseconds.
What makes as many values as the limits allow takes half a second by itself, and four times that in a process as full
as that of these tests, whose garbage is collected meanwhile."""
LARGEST = 2_000_000_000
"""Bytes that the memory of a process may grow by for one answer."""
SLOWEST_SOLVE = 15.0
"""The same where problems without end are solved: five hundred iterations in each of several windows, as many as rounds
of unknown noise may take together, evaluated by NumPy a row at a time."""
PATIENCE, STANDSTILL = 30.0, 120.0
"""Seconds of processor time, and of waiting for something, after which an answer is given up."""
PACKED = {".gz", ".bz2", ".xz", ".npz", ".parquet", ".json"}
"""Endings of files whose rows are not lines of a text."""
LOOKED_INTO = 20_000_000
"""Bytes of a file in which places of diagnostics are looked up."""
KINDS_OF_BYTES = {"linux": 1024}
"""What `resource` counts the largest memory in, by platform; elsewhere in bytes."""


class TooLong(BaseException):
    """Raised inside a command that does not come to an end; no handler of `Exception` takes it."""


@cache
def known_codes() -> frozenset[str]:
    """The names of all codes that any ``faults`` module of the package holds, but that of our own faults."""
    modules = [
        import_module(module.name) for module in walk_packages(mbm.__path__, "mbm.") if module.name.endswith("faults")
    ]
    codes = {value.name for module in modules for value in vars(module).values() if isinstance(value, Code)}
    return frozenset(codes - {"internal-fault"})


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command line answered: exit status (None: it was given up), outputs, seconds of processor time.

    ``grown`` is by how many bytes the largest memory of the process has grown (from nothing, where it is one of its
    own), ``aside`` how many bytes a library wrote
    to the outputs itself, past Python; they are counted where the outputs are files.
    """

    status: int | None
    out: str
    err: str
    seconds: float
    grown: int
    aside: int


def outcome(*arguments: str) -> Outcome:
    """Runs a command line; only exceptions that ``run`` does not catch get out."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.StringIO()
    limit, memory, aside = sys.getrecursionlimit(), _memory(), _written_aside()
    before = process_time()
    try:
        with redirect_stdout(out), redirect_stderr(err), _ended_after(PATIENCE, STANDSTILL):
            status: int | None = run(arguments)
            out.flush()
    except TooLong:
        status = None
    seconds = process_time() - before
    if sys.getrecursionlimit() != limit:
        raise AssertionError("the recursion limit was not put back")
    written = out.buffer
    if not isinstance(written, io.BytesIO):
        raise TypeError(written)
    said = written.getvalue().decode("utf-8")
    return Outcome(
        status=status,
        out=said,
        err=err.getvalue(),
        seconds=seconds,
        grown=_memory() - memory,
        aside=_written_aside() - aside,
    )


def _written_aside() -> int:
    """Bytes in the files behind both outputs of the process."""
    return sum(found.st_size for found in map(os.fstat, (1, 2)) if stat.S_ISREG(found.st_mode))


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * KINDS_OF_BYTES.get(sys.platform, 1)


@contextmanager
def _ended_after(working: float, waiting: float) -> Iterator[None]:
    """Inside, `TooLong` is raised once either time is over; other threads than the main one are not interrupted."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def over(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, working), (signal.SIGALRM, signal.ITIMER_REAL, waiting))
    before = [signal.signal(number, over) for number, _, _ in clocks]
    for _, clock, seconds in clocks:
        signal.setitimer(clock, seconds)
    try:
        yield
    finally:
        for (number, clock, _), handler in zip(clocks, before, strict=True):
            signal.setitimer(clock, 0)
            signal.signal(number, handler)


def faults_of(found: Outcome, arguments: tuple[str, ...], folder: Path, slowest: float = SLOWEST) -> list[str]:
    """Whatever an answer must not be; empty if it is as it should be. It takes ``slowest`` seconds at most.

    With ``--json -`` standard output is a document, whose places are looked up in ``folder``.
    """
    wrong = []
    if found.status not in (0, 1, 2):
        wrong.append("no end" if found.status is None else f"exit status {found.status}")
    if "Traceback" in found.err:
        wrong.append("a traceback")
    if "internal-fault" in found.err:
        wrong.append("an internal fault")
    if found.seconds > slowest:
        wrong.append(f"{found.seconds:.1f} s")
    if found.grown > LARGEST:
        wrong.append(f"{found.grown / 1e9:.1f} GB")
    if re.search(r"^\S+\.py:\d+: \w*Warning: ", found.err, re.MULTILINE):
        wrong.append("a warning of Python")
    if found.aside:
        wrong.append("a library wrote to the outputs itself")
    wrong += [f"{character!r} on the terminal" for character in sorted(unprintable(found.err))]
    if found.status is None:
        return wrong
    understood = arguments[: arguments.index("--")] if "--" in arguments else arguments
    if ("--json", "-") in pairwise(understood) and "--help" not in understood:
        return wrong + _faults_of_document(found, folder)
    wrong += [f"{character!r} on the terminal" for character in sorted(unprintable(found.out))]
    if found.status == 2 and "error[" not in found.err:
        wrong.append("exit status 2 without an error")
    return wrong


def unprintable(text: str) -> set[str]:
    """What would move a cursor, feign or reorder text on a terminal: all but line breaks that is not printable."""
    return set() if text.isprintable() else {c for c in set(text) if not c.isprintable()} - {"\n"}


def _faults_of_document(found: Outcome, folder: Path) -> list[str]:
    wrong = []
    try:
        document = json.loads(found.out, parse_constant=_refuse)
    except ValueError as error:
        return [f"no JSON: {error}"]
    diagnostics = document.get("diagnostics", [])
    for solve in document.get("solves", ()):
        diagnostics = [*diagnostics, *solve.get("diagnostics", ())]
    errors = [d for d in diagnostics if d["severity"] == "error"]
    # What goes wrong with another output, once the document is out, is said on standard error.
    elsewhere = found.status == 2 and "error[not-writable]" in found.err
    if found.status == 2 and not errors and not elsewhere:
        wrong.append("exit status 2 without an error")
    if "solves" in document and not elsewhere and (found.status == 0) != (document["status"] == "ok"):
        wrong.append(f"exit status {found.status} beside document status {document['status']}")
    for diagnostic in diagnostics:
        wrong += [f"{diagnostic['code']}: {fault}" for fault in _faults_of_diagnostic(diagnostic, folder)]
    return wrong


def _refuse(constant: str) -> float:
    message = f"{constant} in a document"
    raise ValueError(message)


def _is_there(path: Path) -> bool:
    """Whether there is such a file; there is none whose name is too long."""
    try:
        return path.is_file()
    except OSError:
        return False


def _faults_of_diagnostic(diagnostic: dict[str, Any], folder: Path) -> list[str]:
    wrong = []
    if diagnostic["code"] not in known_codes():
        wrong.append("no known code")
    if not diagnostic["message"].strip():
        wrong.append("no message")
    name, line, column = diagnostic["file"], diagnostic["line"], diagnostic["column"]
    path = None if name is None else folder / Path(name).name
    if path is None or not _is_there(path) or path.suffix in PACKED or path.stat().st_size > LOOKED_INTO:
        return wrong
    text = path.read_bytes().decode("utf-8", errors="replace")
    lines = re.split(r"\r\n|\r|\n", text)
    if line is None:
        return [*wrong, "no line in a problem file"] if path.suffix == ".mbm" else wrong
    if not 1 <= line <= len(lines):
        return [*wrong, f"line {line} of {len(lines)}"]
    if path.suffix == ".mbm" and column is not None:
        # A lone carriage return ends a line for some editors only: either way of counting is inside the file.
        longest = max(
            len(lines[line - 1]), len(([*text.split("\n"), ""])[line - 1]) if line <= text.count("\n") + 1 else 0
        )
        if not 1 <= column <= longest + 1:
            wrong.append(f"column {column} of line {line}")
    return wrong
