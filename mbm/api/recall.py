"""What a text was compiled to in an earlier process, found again by its content.

Three kinds of entries of the store lead from characters to kernels without reading, deriving or differentiating:

    text      the text itself                                 → the files that it uses, with digests of theirs
    tables    these texts, the problem's name, constants      → the data clauses
    problem   these, the columns of the tables, and what they
              answer wherever elaboration asks for a value    → typed equations and kernels
    starts    such equations                                  → for which numbers of rows no closed form is made

All keys hold what made the entry: mbm's own sources, and the packages beside it. Whatever does not fit leads to
compiling, which says everything that there is to say about wrong problems.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm import compiler
from mbm.compiler import Inputs
from mbm.files.memory import largest_file
from mbm.files.reading import read_bytes, read_file
from mbm.problem.elaborated import Consulted, Elaborated
from mbm.problem.types import Problem
from mbm.text.types import DataPlace, MbmError, Source
from mbm.values import dataclass
from mbm.version import __version__

if TYPE_CHECKING:
    from mbm.equations.binding import Kind
    from mbm.kernels.store import Store
    from mbm.kernels.types import KernelSet
    from mbm.language.session import Program, ReadFile
    from mbm.problem.dependence import Facts
    from mbm.problem.tables import Table
    from mbm.registry.standard import Registry

TEXT, TABLES, PROBLEM, STARTS = "text", "tables", "problem", "starts"
"""The kinds of entries."""

MAKERS = (
    "api",
    "data",
    "expression",
    "files",
    "kernels",
    "language",
    "machine",
    "problem",
    "registry",
    "shapes",
    "solver",
    "symbolic",
    "text",
)
"""Folders of mbm that make equations and kernels, beside its own files: stages import one way, so no later one does."""

CLOSED_FORMS = "estimation/starts/closed_forms"
"""The folder that decides for which equations there are closed forms."""

MOST_KINDS = 1000
"""Sets of numbers of rows that are worth keeping for one problem."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """Equations and kernels, and what the tables answered that they were made for; no warnings about data."""

    problem: Problem
    consulted: Consulted
    starts: Mapping[str, tuple[float, ...]]
    answers: Facts
    kernels: KernelSet


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recalled:
    """Equations with their tables, and kernels; ``key`` is that of their entry, None if there is none.

    ``without_closed_form`` are the kinds of equations for which no closed form is made, as far as that was found out.
    """

    elaborated: Elaborated
    kernels: KernelSet
    key: str | None = None
    without_closed_form: tuple[Kind, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """A text, the path where it stands, the folder that confines it, and the closed forms that it may name."""

    source: Source
    path: Path
    sandbox: Path | None
    closed_forms: tuple[str, ...]


def key_of(text: Text) -> str:
    """The key of a text, whatever the files that it uses hold."""
    return _digest(_environment(), text.source, str(text.path), text.path.resolve(), text.sandbox, text.closed_forms)


def known_text(store: Store, own: str) -> str | None:
    """The digest of the text of a key with all files that it uses; None unless they were read without a fault."""
    uses = _unpacked(store.get(TEXT, own))
    return None if uses is None or not all(_unchanged(*use) for use in uses) else _digest(own, uses)


def remember_text(store: Store, own: str, program: Program, read: tuple[ReadFile, ...]) -> str | None:
    """Keep which files the text of a key uses, and which its forms ``read``. The digest of all of them."""
    texts = (
        (str(use.path), str(use.resolved), None if use.source is None else _digest(use.source), True)
        for use in program.used
    )
    uses = (*texts, *((str(each.path), str(each.resolved), each.sha256, False) for each in read))
    return _digest(own, uses) if _put(store, TEXT, uses, own) else None


def _unchanged(path: str, resolved: str, digest: str | None, is_text: bool) -> bool:
    """Whether a file that is used leads where it led, and holds what it held."""
    place = Path(path)
    try:
        if str(place.resolve()) != resolved:
            return False
        if not is_text:
            content = read_bytes(place, DataPlace(file=path), largest=largest_file())
            return sha256(content).hexdigest() == digest
        return digest is None or _digest(read_file(place, path, DataPlace(file=path))) == digest
    except (MbmError, OSError, RuntimeError):
        return False


def recalled(
    store: Store, digest: str, name: str | None, base: Path, inputs: Inputs, registry: Registry
) -> Recalled | None:
    """Equations with the tables of ``inputs``, and their kernels; None unless they were made before.

    ``digest`` is that of the texts, ``name`` the problem's (None: the only one).

    Raises:
        MbmError: what is wrong with the data, as elaboration would say it.

    """
    key = _digest(digest, name, tuple(inputs.overrides.values()), inputs.drawing)
    declarations = _unpacked(store.get(TABLES, key))
    if declarations is None:
        return None
    raw = compiler.loaded(declarations, base, inputs, registry)
    key = _with_columns(key, raw)
    for _ in range(2):  # the entry made last for these columns; then the one made for the same answers
        made = _unpacked(store.get(PROBLEM, key))
        if not isinstance(made, Made):
            return None
        answers, tables = compiler.answers(made.problem, made.consulted, raw)
        if tables is None:
            return None
        if answers == made.answers:
            return Recalled(
                elaborated=compiler.checked(_elaborated(made, raw, tables)),
                kernels=made.kernels,
                key=key,
                without_closed_form=_unpacked(store.get(STARTS, key)) or (),
            )
        key = _digest(key, answers)
    return None


def remember(
    store: Store, digest: str, name: str | None, inputs: Inputs, found: Elaborated, kernels: KernelSet
) -> str | None:
    """Keep equations and kernels that were made for the texts of a digest; the key of their entry."""
    answers, _ = compiler.answers(found.problem, found.consulted, found.raw)
    if answers is None:
        return None
    key = _digest(digest, name, tuple(inputs.overrides.values()), inputs.drawing)
    made = Made(
        problem=replace(found.problem, warnings=found.lasting),
        consulted=found.consulted,
        starts=found.starts,
        answers=answers,
        kernels=kernels,
    )
    columns = _with_columns(key, found.raw)
    keys = [columns] if found.consulted.nothing else [_digest(columns, answers), columns]
    if not _put(store, PROBLEM, made, *keys):
        return None
    _put(store, TABLES, tuple(plan.declaration for plan in found.problem.plans), key)
    return columns


def remember_starts(store: Store, key: str, kinds: Iterable[Kind]) -> None:
    """Keep for which kinds of equations no closed form is made."""
    listed = sorted(kinds)
    if len(listed) <= MOST_KINDS:
        _put(store, STARTS, tuple(listed), key)


def _elaborated(made: Made, raw: Mapping[str, Table], tables: Mapping[str, Table]) -> Elaborated:
    return Elaborated(
        problem=made.problem,
        raw=raw,
        tables=tables,
        starts=made.starts,
        consulted=made.consulted,
        lasting=made.problem.warnings,
    )


def _with_columns(key: str, raw: Mapping[str, Table]) -> str:
    from mbm.problem.dependence import columns_of

    return _digest(key, columns_of(raw))


def _put(store: Store, kind: str, value: object, *keys: str) -> bool:
    """Keep a value under some keys if it can be packed."""
    from mbm.kernels.packing import PackingError, pack

    try:
        content = pack(value)
    except PackingError:
        return False
    for key in keys:
        store.put(kind, key, content)
    return True


def _unpacked(content: bytes | None) -> Any:
    from mbm.kernels.packing import PackingError, unpack

    if content is None:
        return None
    try:
        return unpack(content)
    except PackingError:
        return None


def _digest(*parts: object) -> str:
    """SHA-256 of values whose printed forms tell them apart."""
    return sha256(repr(parts).encode("utf-8", errors="surrogatepass")).hexdigest()


def _environment() -> tuple[object, ...]:
    """What makes equations and kernels: Python, mbm as it is installed, and the packages that it calls.

    Files are told apart by size and time of change. A folder of packages changes when one is installed or removed.
    """
    here = str(Path(__file__).parent.parent)
    packages = [(entry, _changed(entry)) for entry in sys.path if entry.endswith("-packages")]
    return (__version__, sys.version, here, _sources(here), packages)


@cache
def _sources(here: str) -> str:
    """The digest of mbm's files, looked at once: what a process has loaded stays as it is."""
    folders = [os.path.join(here, name) for name in (*MAKERS, CLOSED_FORMS)]  # noqa: PTH118 - as below
    return _digest(sorted([*_states([here], below=False), *_states(folders, below=True)]))


def _states(folders: Iterable[str], *, below: bool) -> Iterable[tuple[str, int, int]]:
    """Names, sizes and times of change of the files in folders, and in those ``below``; compiled ones left out.

    Texts in place of `Path`, and no more calls than files: every process does this before its first solve.
    """
    left = list(folders)
    while left:
        try:
            with os.scandir(left.pop()) as entries:
                for entry in entries:
                    if not entry.is_dir():
                        found = entry.stat()
                        yield entry.path, found.st_size, found.st_mtime_ns
                    elif below and entry.name != "__pycache__":
                        left.append(entry.path)
        except OSError:
            continue


def _changed(entry: str) -> int | None:
    try:
        return Path(entry).stat().st_mtime_ns
    except OSError:
        return None
