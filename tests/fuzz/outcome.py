"""Runs a problem file through the command line in this process and says what is wrong with how that ended."""

from __future__ import annotations

import io
import json
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from time import process_time
from typing import Any

import mbm
from mbm.cli.main import run
from mbm.text.types import Code

SLOWEST = {"check": 5.0, "solve": 5.0}
"""Seconds of processor time that no answer may take: bounds against hangs, since the usual case takes milliseconds.
What makes as many values as the limits allow takes half a second by itself, and four times that in a process as full
as that of these tests, whose garbage is collected meanwhile.
Solving may use up all iterations that it is allowed, once for each key."""

NODES = "id,x,y,z,name\n1,0,0,2,p\n2,4,0,2,q\n3,0,4,2,p\n"
READINGS = "id,x,y,name,long\n1,1.5,2.5,p,1\n2,2.25,3.75,q,2\n3,3.5,4.5,p,3\n1,4.75,6.5,q,4\n2,6.5,8.25,p,5\n"


def known_codes() -> frozenset[str]:
    """The names of all codes that any ``faults`` module of the package holds, but that of our own faults."""
    modules = [
        import_module(module.name) for module in walk_packages(mbm.__path__, "mbm.") if module.name.endswith("faults")
    ]
    codes = {value.name for module in modules for value in vars(module).values() if isinstance(value, Code)}
    return frozenset(codes - {"internal-fault"})


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command line answered: exit status, both outputs, seconds of processor time."""

    command: str
    status: int
    out: str
    err: str
    seconds: float


def folder_with_data(folder: Path) -> Path:
    """Puts the tables that generated problems read into a folder."""
    (folder / "nodes.csv").write_text(NODES, encoding="utf-8")
    (folder / "readings.csv").write_text(READINGS, encoding="utf-8")
    return folder


def outcome(*arguments: str) -> Outcome:
    """Runs a command line; only exceptions that ``run`` does not catch get out."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.StringIO()
    limit = sys.getrecursionlimit()
    before = process_time()
    with redirect_stdout(out), redirect_stderr(err):
        status = run(arguments)
        out.flush()
    seconds = process_time() - before
    if sys.getrecursionlimit() != limit:
        raise AssertionError("the recursion limit was not put back")
    written = out.buffer
    if not isinstance(written, io.BytesIO):
        raise TypeError(written)
    return Outcome(
        command=arguments[0], status=status, out=written.getvalue().decode("utf-8"), err=err.getvalue(), seconds=seconds
    )


def faults_of(found: Outcome, folder: Path, codes: frozenset[str]) -> list[str]:
    """Whatever an answer to ``check`` or ``solve … --json -`` must not be; empty if it is as it should be."""
    wrong = []
    if found.status not in (0, 1, 2):
        wrong.append(f"exit status {found.status}")
    if "Traceback" in found.err:
        wrong.append("a traceback")
    if found.seconds > SLOWEST[found.command]:
        wrong.append(f"{found.seconds:.1f} s")
    try:
        document = json.loads(found.out, parse_constant=_refuse)
    except ValueError as error:
        return [*wrong, f"no JSON: {error}"]
    diagnostics = document.get("diagnostics", [])
    for solve in document.get("solves", ()):
        diagnostics = [*diagnostics, *solve.get("diagnostics", ())]
    errors = [d for d in diagnostics if d["severity"] == "error"]
    if found.status == 2 and not errors:
        wrong.append("exit status 2 without an error")
    if "solves" in document and (found.status == 0) != (document["status"] == "ok"):
        wrong.append(f"exit status {found.status} beside document status {document['status']}")
    for diagnostic in diagnostics:
        wrong += [f"{diagnostic['code']}: {fault}" for fault in _faults_of_diagnostic(diagnostic, folder, codes)]
    return wrong


def _refuse(constant: str) -> float:
    message = f"{constant} in a document"
    raise ValueError(message)


def _faults_of_diagnostic(diagnostic: dict[str, Any], folder: Path, codes: frozenset[str]) -> list[str]:
    wrong = []
    if diagnostic["code"] not in codes:
        wrong.append("no known code")
    if not diagnostic["message"].strip():
        wrong.append("no message")
    name, line, column = diagnostic["file"], diagnostic["line"], diagnostic["column"]
    path = None if name is None else folder / Path(name).name
    if path is None or not path.is_file():
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
