"""TableDeclaration → Table: where the rows of a data clause come from is decided here, then they are read and shaped.

The first of these that applies: a table given through the Python API, a path given on the command line, the rows
written in the problem, the file that the data clause names.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from mbm.data import faults
from mbm.data.content import COMPRESSED, PER_ROW
from mbm.data.given import table_from_given, table_from_inline
from mbm.data.patterns import matching
from mbm.data.shaping import shape
from mbm.data.types import AnyReader, ImageReader, RawTable, Reader, asked
from mbm.files.faults import too_many_files, unreadable_file
from mbm.files.journal import note, table_role
from mbm.files.memory import PER_VALUE, check_memory, largest_file
from mbm.files.reading import check_ordinary
from mbm.problem.tables import EXTERNAL, Table, TableDeclaration
from mbm.text.faults import MOST_FAULTS, worth_reading
from mbm.text.types import Diagnostic, Label, MbmError, Span

MOST_FILES = 1000
"""Tables of a problem."""

TABLES_SHARE = 2
"""All tables may take one part in so many of the memory: the rest is for what is made of them."""

PER_CELL = 8
"""Bytes of a number in a table."""

Parts: TypeAlias = "dict[tuple[str, Path], Mapping[str, RawTable | MbmError]]"
"""Files of several tables that were read, by format and path."""


def load_all(
    declarations: Iterable[TableDeclaration],
    *,
    base: Path,
    given: Mapping[str, object],
    paths: Mapping[str, str],
    sandbox: Path | None,
    readers: Mapping[str, AnyReader],
) -> dict[str, Table]:
    """The tables of all data clauses by name, in their order; parameters as of ``load``.

    Raises one MbmError with what is wrong with any of them, and undeclared-table for a table that was given under a
    name that no data clause has.
    """
    declared = {declaration.name: declaration for declaration in declarations}
    strangers = [name for name in dict.fromkeys((*given, *paths)) if name not in declared]
    found: list[Diagnostic] = [faults.undeclared_table(name, declared) for name in strangers]
    tables: dict[str, Table] = {}
    parts: Parts = {}
    for number, (name, declaration) in enumerate(declared.items(), start=1):
        if number > MOST_FILES:
            raise MbmError(too_many_files(declaration.span, MOST_FILES))
        try:
            tables[name] = load(
                declaration, base=base, given=given, paths=paths, sandbox=sandbox, readers=readers, parts=parts
            )
        except MbmError as error:
            found.extend(error.diagnostics)
        else:
            _check_together(tables, declaration.span)
        if len(found) > MOST_FAULTS:
            raise MbmError(*worth_reading(_once(found), ended=True))
    if found:
        raise MbmError(*_once(found))
    return tables


def _check_together(tables: Mapping[str, Table], place: Span) -> None:
    """Refuse tables that together take more than they may have of the memory; ``place`` is the last one's.

    Raises:
        MbmError: too-much-memory.

    """
    taken = sum(_size(table) for table in tables.values())
    check_memory(taken * TABLES_SHARE, f"a problem with the {len(tables)} tables up to here", place)


def _size(table: Table) -> int:
    """Bytes that a table takes."""
    texts = sum(column.is_text for column in table.columns.values())
    return len(table) * (PER_ROW + PER_VALUE * texts + PER_CELL * (len(table.columns) - texts))


def _once(found: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The faults without repetitions: a file of several tables is wrong once, however many clauses read it."""
    once: dict[tuple[object, ...], Diagnostic] = {}
    for fault in found:
        once.setdefault((fault.code, fault.message, fault.place), fault)
    return tuple(once.values())


def load(
    declaration: TableDeclaration,
    *,
    base: Path,
    given: Mapping[str, object],
    paths: Mapping[str, str],
    sandbox: Path | None,
    readers: Mapping[str, AnyReader],
    parts: Parts | None = None,
) -> Table:
    """The table of one data clause, numbers in SI.

    ``base`` is the folder of the problem file as messages shall print it, ``given`` holds tables by name (they override
    files), ``paths`` files by name, relative to the working directory (they override the data clause), ``sandbox`` the
    folder that all reads are confined to, ``readers`` the formats by name; ``parts`` holds the files of several tables
    that were read before, and gains the one that is read now.

    ``:where`` and ``:with`` are left to the problem stage.

    Raises MbmError for what is wrong with the file, the columns, the cells or the keys, with file, row and column;
    ValueError if the data clause names a reader that ``readers`` does not have.
    """
    try:
        known = {} if parts is None else parts
        with np.errstate(all="ignore"):  # numbers that are none are found in the table, not on standard error
            raw = _raw(declaration, base, given, paths, sandbox, readers, known)
            remarks = tuple(_with_clause(remark, declaration) for remark in raw.remarks)
            return shape(replace(raw, remarks=remarks), declaration)
    except MbmError as error:
        raise MbmError(*(_with_clause(fault, declaration) for fault in error.diagnostics)) from None


def _with_clause(fault: Diagnostic, declaration: TableDeclaration) -> Diagnostic:
    """The fault with a label at the data clause, unless it already speaks of a place in the problem."""
    places = (fault.place, *(label.place for label in fault.labels))
    if any(isinstance(place, Span) for place in places):
        return fault
    label = Label(declaration.span, f"table `{declaration.name}` is declared here")
    return replace(fault, labels=(*fault.labels, label))


def _raw(
    declaration: TableDeclaration,
    base: Path,
    given: Mapping[str, object],
    paths: Mapping[str, str],
    sandbox: Path | None,
    readers: Mapping[str, AnyReader],
    parts: Parts,
) -> RawTable:
    """The table as its origin has it. The file that the clause names is noted as read also where another one is."""
    name = declaration.name
    if declaration.path is not None:
        note(base / declaration.path, table_role(name))
    if name in given:
        return table_from_given(name, given[name])
    if name in paths:
        path = Path(paths[name])
        note(path, table_role(name))
        return _read(_reader_for(path, declaration, readers), path, declaration, sandbox, parts)
    if declaration.inline is not None:
        return table_from_inline(declaration.inline, declaration.span)
    if declaration.source == EXTERNAL:
        raise MbmError(faults.missing_table(declaration.span, name))
    reader = readers.get(declaration.source)
    if reader is None or declaration.path is None:
        raise ValueError(f"no reader `{declaration.source}` for the path {declaration.path!r}")
    return _read(reader, base / declaration.path, declaration, sandbox, parts)


def _reader_for(path: Path, declaration: TableDeclaration, readers: Mapping[str, AnyReader]) -> AnyReader:
    """The reader of a path that overrides the data clause: by the ending; the clause's own where that says nothing.

    A format of several tables is meant only by a clause that names one of them.
    """
    declared = readers.get(declaration.source)
    ending = (path.with_suffix("") if path.suffix.lower() in COMPRESSED else path).suffix.lower()
    if declared is not None and ending in declared.extensions:
        return declared
    endings: list[str] = []
    broken: list[MbmError] = []
    for name in readers:
        try:
            reader = readers[name]
        except MbmError as error:  # that of an installed package: it harms no files but its own
            broken.append(error)
            continue
        if isinstance(reader, Reader):
            if ending in reader.extensions:
                return reader
            endings += reader.extensions
    if declared is not None:
        return declared
    raise broken[0] if broken else MbmError(faults.unknown_format(declaration.span, path.as_posix(), endings))


def _read(reader: AnyReader, path: Path, declaration: TableDeclaration, sandbox: Path | None, parts: Parts) -> RawTable:
    """Read a file that lies where it may; whether it is there is said of the place that names it."""
    if isinstance(reader, ImageReader):
        return _read_images(reader, path, declaration, sandbox)
    _check(path, declaration, sandbox)
    if isinstance(reader, Reader):
        return reader.read(path)
    found = parts.get((reader.name, path))
    if found is None:
        found = parts[reader.name, path] = reader.read(path)
    if declaration.part is None or declaration.part not in found:
        raise ValueError(f"the reader `{reader.name}` has no part {declaration.part!r}")
    return asked(found[declaration.part])


def _read_images(reader: ImageReader, path: Path, declaration: TableDeclaration, sandbox: Path | None) -> RawTable:
    """Read the images that a path or pattern names."""
    if sandbox is not None:
        _check_confined(path.parent, declaration, sandbox)
    images = matching(path, declaration.span)
    for image in images:
        note(image, table_role(declaration.name))
        _check(image, declaration, sandbox)
    return reader.read(images, path.as_posix(), dict(declaration.arguments))


def _check(path: Path, declaration: TableDeclaration, sandbox: Path | None) -> None:
    """Check that a file lies where it may and is an ordinary one."""
    if sandbox is not None:
        _check_confined(path, declaration, sandbox)
    check_ordinary(path, declaration.span, largest=largest_file())


def _check_confined(path: Path, declaration: TableDeclaration, sandbox: Path) -> None:
    """Check that a path lies in the sandbox, symbolic links followed."""
    try:
        confined = path.resolve().is_relative_to(sandbox.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a name too long, a NUL in it
        reason = str(error)
        raise MbmError(unreadable_file(path, reason, declaration.span)) from None
    if not confined:
        raise MbmError(faults.outside_sandbox(declaration.span, path.as_posix(), sandbox.as_posix()))
