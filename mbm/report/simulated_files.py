"""A simulation as a folder: data files, a copy of the problem that reads them, and the truth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

from mbm.data.content import BLANKS, COMPRESSED, read_text
from mbm.data.pose_graphs import with_measurements
from mbm.data.writers import WRITERS
from mbm.files.names import SIMULATE, Names, file_name, is_plain
from mbm.files.reading import read_file
from mbm.files.targets import SOURCE_ENDING
from mbm.language.session import Program
from mbm.problem.clauses import effective_clauses, select_problem
from mbm.problem.reading.noise_structure import READER as MATRIX, matrix_forms, matrix_table
from mbm.problem.tables import Column, TableDeclaration
from mbm.problem.types import Problem
from mbm.report.simulated import Simulated, SimulatedTable
from mbm.text.printer import print_text
from mbm.text.reader import read
from mbm.text.types import Numeral, Sequence, Source, Span, Symbol, Text
from mbm.values import dataclass

TRUTH = "truth.json"
GRAPH = "g2o"
USE = "use"
"""The head of a form that names a file of definitions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputFile:
    """A file to be written below the folder; ``summary`` says in words what it holds."""

    path: str
    content: bytes
    summary: str


@dataclass(frozen=True, slots=True)
class _Edit:
    """A stretch of a source, and what stands there instead."""

    span: Span
    text: str


def output_files(program: Program, problem: Problem, name: str | None, made: Simulated) -> tuple[OutputFile, ...]:
    """All files of a simulation, each under a name of its own.

    Data files have the format, the columns and the units of those that the problem names, and their relative paths;
    what cannot be written so (other formats, paths outside the folder or of another file, tables from elsewhere)
    becomes CSV, and the copy of the problem reads that. Inline tables are changed in the copy.
    """
    names = Names()
    names.taken(SIMULATE.manifest)
    names.taken(TRUTH)
    main = names.own(_main_name(program))
    tables = _Tables(names, _source_forms(program, name))
    for plan in problem.plans:
        tables.add(plan.declaration, next(t for t in made.tables if t.name == plan.declaration.name))
    truth = json.dumps(made.truth, ensure_ascii=False, indent=1) + "\n"
    files = [*tables.files(), OutputFile(path=TRUTH, content=truth.encode("utf-8"), summary="the true values")]
    return (*files, *_sources(program, main, names, tables.edits))


def _main_name(program: Program) -> str:
    """What the copy of the problem is called: as the problem is, if that can be."""
    main = Path(program.source.name)
    if main.suffix != SOURCE_ENDING:
        return f"problem{SOURCE_ENDING}"
    return main.name if is_plain(main.name) else file_name(main.stem, SOURCE_ENDING)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Origin:
    """What tables share a file: the path and the format of their clauses, and the file that was read for them."""

    path: str
    kind: str
    read: str
    sha256: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sheet:
    """A data file of columns; those named in ``changed`` are simulated."""

    path: str
    kind: str
    columns: dict[str, Column]
    changed: list[str]


class _Tables:
    """The files of the tables, and what must be changed in the problem so that it reads them."""

    def __init__(self, names: Names, forms: Mapping[str, Symbol | Sequence]) -> None:
        self.edits: list[_Edit] = []
        self._names = names
        self._forms = forms
        self._sheets: list[_Sheet] = []
        self._shared: dict[_Origin, _Sheet] = {}
        self._graphs: dict[_Origin, tuple[str, str]] = {}

    def add(self, declaration: TableDeclaration, table: SimulatedTable) -> None:
        """Another table, in the order of the problem."""
        form = self._forms.get(declaration.name)
        if declaration.inline is not None and isinstance(form, Sequence):
            self.edits.extend(_inline_edits(form, table))
            return
        origin = _origin(declaration, table)
        if origin is not None and origin.kind == GRAPH:
            path, text = self._graphs.get(origin, (None, None))
            text = _graph(text, table)
            if text is not None:
                path = path or self._names.own(origin.path)
                self._graphs[origin] = path, text
                self._read_there(declaration, table, _graph_form(path, declaration), path, GRAPH)
                return
            origin = None
        sheet = self._sheet(origin, declaration, table)
        self._read_there(declaration, table, f"({sheet.kind} {print_text(sheet.path)})", sheet.path, sheet.kind)

    def files(self) -> Iterator[OutputFile]:
        """All files of tables."""
        for sheet in self._sheets:
            content = WRITERS[sheet.kind](tuple(sheet.columns.values()))
            yield OutputFile(path=sheet.path, content=content, summary=_summary(sheet.columns, sheet.changed))
        for path, text in self._graphs.values():
            yield OutputFile(path=path, content=text.encode("utf-8"), summary="a pose graph, its edges simulated")

    def _sheet(self, origin: _Origin | None, declaration: TableDeclaration, table: SimulatedTable) -> _Sheet:
        """The file of a table: that of a table from the same file, unless both have the same column simulated."""
        columns = {column.name: column for column in table.columns}
        found = None if origin is None else self._shared.get(origin)
        if found is not None and _rows(found.columns) == _rows(columns) and not {*found.changed} & {*table.changed}:
            found.columns.update({name: columns[name] for name in table.changed})
            found.changed.extend(table.changed)
            return found
        fresh = origin is not None and self._names.is_free(origin.path)
        path = origin.path if origin is not None and fresh else file_name(declaration.name, ".csv")
        sheet = _Sheet(
            path=self._names.own(path),
            kind=origin.kind if origin is not None and fresh else MATRIX if declaration.source == MATRIX else "csv",
            columns=columns,
            changed=list(table.changed),
        )
        self._sheets.append(sheet)
        if origin is not None:
            self._shared.setdefault(origin, sheet)
        return sheet

    def _read_there(
        self, declaration: TableDeclaration, table: SimulatedTable, form: str, path: str, kind: str
    ) -> None:
        """The data clause reads the file, by ``form`` if it does not do so already."""
        written = self._forms.get(declaration.name)
        if written is None or (path == declaration.path and kind == declaration.source):
            return
        key = table.origin.key if declaration.key is None and kind != GRAPH else None  # what the format says of it
        self.edits.append(_Edit(written.span, form if key is None else f"{form} :key {print_text(key)}"))


def _graph_form(path: str, declaration: TableDeclaration) -> str:
    said = "".join(f" :{name} {value}" for name, value in declaration.arguments)
    return f"({GRAPH} {print_text(path)} :{declaration.part}{said})"


def _source_forms(program: Program, name: str | None) -> Mapping[str, Symbol | Sequence]:
    """The form that says where each table comes from, by the table's name."""
    found: dict[str, Symbol | Sequence] = {}
    for clause in effective_clauses(program, select_problem(program, name)):
        if clause.head == "data" and len(clause.items) > 2:
            table, form = clause.items[1:3]
            if isinstance(table, Symbol) and isinstance(form, Symbol | Sequence):
                found[table.name] = form
        elif clause.head == "observe":
            found.update((matrix_table(path), form) for form, path in matrix_forms(clause))
    return found


def _origin(declaration: TableDeclaration, table: SimulatedTable) -> _Origin | None:
    """Where a table may be written in its own format; None where that would not be below the folder."""
    if declaration.path is None or declaration.source not in (*WRITERS, GRAPH) or table.origin.provenance.parts:
        return None
    ending = PurePosixPath(declaration.path).suffix
    path = normpath(declaration.path.removesuffix(ending) if ending.lower() in COMPRESSED else declaration.path)
    if not is_plain(path):
        return None
    read = table.origin.provenance
    return _Origin(path=path, kind=declaration.source, read=read.path, sha256=read.sha256)


def _graph(text: str | None, table: SimulatedTable) -> str | None:
    """A pose graph file with simulated numbers; None if it is none. ``text`` is what was made of it so far."""
    columns = {c.name: c.numbers for c in table.columns if c.name in table.changed and c.numbers is not None}
    origin = table.origin.provenance
    if text is None:
        path = Path(origin.path)
        if path.suffix != f".{GRAPH}" or not path.is_file():
            return None
        text, _ = read_text(path, between=BLANKS)
    return with_measurements(text, origin.file_rows.tolist() if columns else (), columns)


def _rows(columns: Mapping[str, Column]) -> int:
    first = next(iter(columns.values()), None)
    if first is None:
        return 0
    return len(first.texts) if first.texts is not None else 0 if first.numbers is None else len(first.numbers)


def _summary(columns: Mapping[str, Column], changed: list[str]) -> str:
    rows = f"{_rows(columns)} rows"
    return f"{rows}, simulated: {', '.join(dict.fromkeys(changed))}" if changed else f"{rows}, as they were"


def _inline_edits(form: Sequence, table: SimulatedTable) -> Iterator[_Edit]:
    """The cells of an inline table that were simulated, each in the unit in which it is written."""
    from mbm.expression.units import parse_unit

    names = [column.name for column in table.columns]
    for name in table.changed:
        place = names.index(name)
        numbers = table.columns[place].numbers
        for row, item in enumerate(form.items[2:]):
            if numbers is None or not isinstance(item, Sequence):
                continue
            cell, number = item.items[place], float(numbers[row])
            unit = parse_unit(cell.unit) if isinstance(cell, Numeral) and cell.unit is not None else None
            if unit is None or not isinstance(cell, Numeral):
                yield _Edit(cell.span, repr(number))
            else:
                yield _Edit(cell.span, f"{number if unit.zero else unit.scale.from_si(number)!r}{cell.unit}")


def _sources(program: Program, main: str, names: Names, edits: list[_Edit]) -> Iterator[OutputFile]:
    """The problem file and those it uses, edited; each file once, however many paths lead to it."""
    start = program.base / Path(program.source.name).name
    places = {start.resolve(): main}
    waiting: list[tuple[Source, Path]] = [(program.source, start)]
    while waiting:
        source, path = waiting.pop()
        place = places[path.resolve()]
        folder = PurePosixPath(place).parent
        own = [edit for edit in edits if edit.span.source == source]
        for written in _used(source):
            used = path.parent / written.value
            if used.resolve() not in places:
                places[used.resolve()] = names.own(_place_of(written.value, folder))
                waiting.append((read_file(used, str(used), written.span), used))
            there = PurePosixPath(relpath(places[used.resolve()], folder))
            if PurePosixPath(written.value) != there:
                own.append(_Edit(written.span, print_text(str(there))))
        summary = "the problem, reading these files" if source is program.source else "used by the problem"
        yield OutputFile(path=place, content=_edited(source, own).encode("utf-8"), summary=summary)


def _place_of(written: str, folder: PurePosixPath) -> str:
    """Where the copy of a file that is used goes, if nothing is there: where it lies, or else beside what uses it."""
    direct = normpath(folder / written)
    if is_plain(direct):
        return direct
    name = PurePosixPath(written).name
    return str(folder / (name if is_plain(name) else file_name(PurePosixPath(name).stem, SOURCE_ENDING)))


def _used(source: Source) -> Iterator[Text]:
    if USE not in source.text:
        return  # reading a long text once more takes seconds
    for form in read(source):
        if isinstance(form, Sequence) and form.head == USE and len(form.items) == 2:
            written = form.items[1]
            if isinstance(written, Text):
                yield written


def _edited(source: Source, edits: list[_Edit]) -> str:
    pieces, reached = [], 0
    for edit in sorted(edits, key=lambda e: e.span.start):
        pieces += [source.text[reached : edit.span.start], edit.text]
        reached = edit.span.end
    return "".join((*pieces, source.text[reached:]))
