"""TableDeclaration → Table: where the rows of a data clause come from is decided here, then they are read and shaped.

The first of these that applies: a table given through the Python API, a path given on the command line, the rows
written in the problem, the file that the data clause names.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from graphlib import TopologicalSorter
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from mbm.data import faults
from mbm.data.content import COMPRESSED, PER_ROW
from mbm.data.shaping import shape, table_from_given, table_from_inline
from mbm.data.types import AnyReader, ImageReader, ManyReader, RawTable, Reader, asked
from mbm.data.union.tables import is_pattern, matching, piece_of_file, piece_of_table, united
from mbm.files.faults import too_many_files, unreadable_file
from mbm.files.journal import note, table_role
from mbm.files.memory import PER_VALUE, check_memory, largest_file
from mbm.files.reading import check_ordinary
from mbm.problem.tables import EXTERNAL, ArgumentKind, Column, Table, TableDeclaration
from mbm.text.faults import MOST_FAULTS, worth_reading
from mbm.text.types import Diagnostic, Label, MbmError, Span
from mbm.values import dataclass

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
    known: Mapping[str, Table] = MappingProxyType({}),
) -> dict[str, Table]:
    """The tables of all data clauses by name, in their order; parameters as of ``load``.

    ``known`` are tables that unions may take, rather than those of the same names in ``declarations``.

    Raises one MbmError with what is wrong with any of them, and undeclared-table for a table that was given under a
    name that no data clause has.
    """
    declared = {declaration.name: declaration for declaration in declarations}
    strangers = [name for name in dict.fromkeys((*given, *paths)) if name not in declared]
    found: list[Diagnostic] = [faults.undeclared_table(name, declared) for name in strangers]
    tables: dict[str, Table] = {}
    sources = _Sources(
        base=base,
        given=given,
        paths=paths,
        sandbox=sandbox,
        readers=readers,
        parts={},
        tables=ChainMap(dict(known), tables),
    )
    for number, declaration in enumerate(_unions_last(declared), start=1):
        name = declaration.name
        if number > MOST_FILES:
            raise MbmError(too_many_files(declaration.span, MOST_FILES))
        if sources.lack(declaration):
            continue  # what is wrong with a member was said where it was read
        try:
            tables[name] = _loaded(declaration, sources)
        except MbmError as error:
            found.extend(error.diagnostics)
        else:
            _check_together(tables, declaration.span)
        if len(found) > MOST_FAULTS:
            raise MbmError(*worth_reading(_once(found), ended=True))
    if found:
        raise MbmError(*_once(found))
    return {name: tables[name] for name in declared}


def _unions_last(declared: Mapping[str, TableDeclaration]) -> Iterator[TableDeclaration]:
    """The declarations, each union behind the tables that it takes; no union takes itself by whatever way."""
    unions = {name: each for name, each in declared.items() if each.members}
    yield from (each for name, each in declared.items() if name not in unions)
    if unions:
        among = {name: [m.name for m in each.members if m.name in unions] for name, each in unions.items()}
        yield from (unions[name] for name in TopologicalSorter(among).static_order())


def _check_together(tables: Mapping[str, Table], place: Span) -> None:
    """Refuse tables that together take more than they may have of the memory; ``place`` is the last one's.

    Raises:
        MbmError: too-much-memory.

    """
    taken = sum(_size(table.columns.values(), len(table)) for table in tables.values())
    check_memory(taken * TABLES_SHARE, f"a problem with the {len(tables)} tables up to here", place)


def _size(columns: Collection[Column], rows: int) -> int:
    """Bytes that a table takes."""
    texts = sum(column.is_text for column in columns)
    return rows * (PER_ROW + PER_VALUE * texts + PER_CELL * (len(columns) - texts))


def _once(found: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The faults without repetitions: a file of several tables is wrong once, however many clauses read it."""
    once: dict[tuple[object, ...], Diagnostic] = {}
    for fault in found:
        once.setdefault((fault.code, fault.message, fault.place), fault)
    return tuple(once.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sources:
    """Where tables may come from, as ``load`` has it; ``tables`` are those of the problem that were read so far."""

    base: Path
    given: Mapping[str, object]
    paths: Mapping[str, str]
    sandbox: Path | None
    readers: Mapping[str, AnyReader]
    parts: Parts
    tables: Mapping[str, Table]

    def lack(self, declaration: TableDeclaration) -> bool:
        """Whether a union is to be made of a table that is not there."""
        made = declaration.name not in self.given and declaration.name not in self.paths
        return made and not all(member.name in self.tables for member in declaration.members)


def load(
    declaration: TableDeclaration,
    *,
    base: Path,
    given: Mapping[str, object],
    paths: Mapping[str, str],
    sandbox: Path | None,
    readers: Mapping[str, AnyReader],
) -> Table:
    """The table of one data clause, numbers in SI.

    ``base`` is the folder of the problem file as messages shall print it, ``given`` holds tables by name (they override
    files), ``paths`` files by name, relative to the working directory (they override the data clause), ``sandbox`` the
    folder that all reads are confined to, ``readers`` the formats by name.

    ``:where`` and ``:with`` are left to the problem stage.

    Raises MbmError for what is wrong with the file, the columns, the cells or the keys, with file, row and column;
    ValueError if the data clause names a reader that ``readers`` does not have.
    """
    sources = _Sources(base=base, given=given, paths=paths, sandbox=sandbox, readers=readers, parts={}, tables={})
    return _loaded(declaration, sources)


def _loaded(declaration: TableDeclaration, sources: _Sources) -> Table:
    """As ``load``."""
    try:
        with np.errstate(all="ignore"):  # numbers that are none are found in the table, not on standard error
            raw = _raw(declaration, sources)
            if raw.remarks:
                raw = replace(raw, remarks=tuple(_with_clause(remark, declaration) for remark in raw.remarks))
            columns = tuple(
                each if each.fault is None else replace(each, fault=_with_clause(each.fault, declaration))
                for each in raw.columns
            )
            return shape(replace(raw, columns=columns), declaration)
    except MbmError as error:
        raise MbmError(*(_with_clause(fault, declaration) for fault in error.diagnostics)) from None


def _with_clause(fault: Diagnostic, declaration: TableDeclaration) -> Diagnostic:
    """The fault with a label at the data clause, unless it already speaks of a place in the problem."""
    places = (fault.place, *(label.place for label in fault.labels))
    if any(isinstance(place, Span) for place in places):
        return fault
    label = Label(declaration.span, f"table `{declaration.name}` is declared here")
    return replace(fault, labels=(*fault.labels, label))


def _raw(declaration: TableDeclaration, sources: _Sources) -> RawTable:
    """The table as its origin has it. The file that the clause names is noted as read also where another one is."""
    name = declaration.name
    if declaration.path is not None:
        _note(sources.base, declaration.path, declaration)
    if name in sources.given:
        return table_from_given(name, sources.given[name])
    if name in sources.paths:
        path = sources.paths[name]
        _note(Path(), path, declaration)
        return _read(_reader_for(Path(path), declaration, sources.readers), Path(), path, declaration, sources)
    if declaration.inline is not None:
        return table_from_inline(declaration.inline, declaration.span)
    if declaration.members:
        pieces = [piece_of_table(sources.tables[member.name]) for member in declaration.members]
        return united(f"<{name}>", pieces)
    if declaration.source == EXTERNAL:
        raise MbmError(faults.missing_table(declaration.span, name))
    reader = sources.readers.get(declaration.source)
    if reader is None or declaration.path is None:
        raise ValueError(f"no reader `{declaration.source}` for the path {declaration.path!r}")
    return _read(reader, sources.base, declaration.path, declaration, sources)


def _note(base: Path, path: str, declaration: TableDeclaration) -> None:
    """The files that a path means are read for the table; what is wrong with a pattern is said where it is read."""
    with suppress(MbmError):
        for file in matching(base, path, declaration.span).values():
            note(file, table_role(declaration.name))


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


def _read(reader: AnyReader, base: Path, path: str, declaration: TableDeclaration, sources: _Sources) -> RawTable:
    """Read the file at ``path``, relative to ``base``, or all files that a pattern means."""
    whole, pattern = base / path, is_pattern(path)
    if pattern:
        _check_confined(whole.parent, declaration, sources, shown=whole)
    files = matching(base, path, declaration.span)
    if isinstance(reader, ImageReader):
        arguments = {**dict(declaration.arguments), **_named(reader, declaration, sources)}
        for file in files.values():
            _check_file(file, declaration, sources)
        return reader.read(files, whole.as_posix(), arguments)
    if not pattern:
        return _read_file(reader, whole, declaration, sources)
    pieces, taken = [], 0
    for source, file in files.items():
        pieces.append(piece_of_file(source, _read_file(reader, file, declaration, sources)))
        taken += _size(pieces[-1].columns.values(), len(pieces[-1].rows))
        check_memory(taken * TABLES_SHARE, f"a table of {len(pieces)} files or more", declaration.span)
    return united(whole.as_posix(), pieces)


def _named(reader: ImageReader, declaration: TableDeclaration, sources: _Sources) -> dict[str, str]:
    """The files that arguments of a data clause name, as messages shall print them."""
    kinds = {argument.name: argument.kind for argument in reader.format.arguments}
    found = {}
    for name, value in declaration.arguments:
        if kinds.get(name) is ArgumentKind.FILE:
            file = sources.base / str(value)
            note(file, table_role(declaration.name))
            _check_file(file, declaration, sources)
            found[name] = file.as_posix()
    return found


def _read_file(reader: Reader | ManyReader, path: Path, declaration: TableDeclaration, sources: _Sources) -> RawTable:
    """Read a file that lies where it may; whether it is there is said of the place that names it."""
    if isinstance(reader, Reader):
        _check_file(path, declaration, sources)
        return reader.read(path)
    _check_members(reader, path, declaration, sources)
    found = sources.parts.get((reader.name, path))
    if found is None:
        found = sources.parts[reader.name, path] = reader.read(path)
    if declaration.part is None or declaration.part not in found:
        raise ValueError(f"the reader `{reader.name}` has no part {declaration.part!r}")
    return reader.told(asked(found[declaration.part]), dict(declaration.arguments))


def _check_members(reader: ManyReader, path: Path, declaration: TableDeclaration, sources: _Sources) -> None:
    """The file of the reader, or each of its files in a folder, lies where it may; what is missing the reader says."""
    if not reader.members:
        _check_file(path, declaration, sources)
        return
    _check_confined(path, declaration, sources)
    for file in (path / member for member in reader.members):
        if file.is_symlink() or file.exists():
            _check_file(file, declaration, sources)
            note(file, table_role(declaration.name))


def _check_file(path: Path, declaration: TableDeclaration, sources: _Sources) -> None:
    """Check that a file lies where it may and is an ordinary one."""
    _check_confined(path, declaration, sources)
    check_ordinary(path, declaration.span, largest=largest_file())


def _check_confined(
    path: Path, declaration: TableDeclaration, sources: _Sources, *, shown: Path | None = None
) -> None:  # fmt: skip
    """Check that a path lies in the sandbox if there is one, symbolic links followed; a fault says ``shown``."""
    sandbox = sources.sandbox
    if sandbox is None:
        return
    try:
        confined = path.resolve().is_relative_to(sandbox.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a name too long, a NUL in it
        reason = str(error)
        raise MbmError(unreadable_file(path, reason, declaration.span)) from None
    if not confined:
        raise MbmError(faults.outside_sandbox(declaration.span, (shown or path).as_posix(), sandbox.as_posix()))
