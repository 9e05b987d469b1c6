"""A simulation as a folder: data files, a copy of the problem that reads them, and the truth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from posixpath import normpath

from mbm.data.content import BLANKS, read_text
from mbm.data.pose_graphs import with_measurements
from mbm.data.writers import WRITERS
from mbm.files.source import read_file
from mbm.language.program import Program
from mbm.problem.clauses import effective_clauses, select_problem
from mbm.problem.tables import Column, TableDeclaration
from mbm.problem.types import Problem
from mbm.report.simulated import Simulated, SimulatedTable
from mbm.text.reader import read
from mbm.text.types import Numeral, Sequence, Source, Span, Symbol, Text
from mbm.values import dataclass

TRUTH = "truth.json"
GRAPH = "g2o"


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
    """All files of a simulation.

    Data files have the format, the columns and the units of those that the problem names, and their relative paths;
    what cannot be written so (other formats, paths outside the folder, tables from elsewhere) becomes CSV, and the copy
    of the problem reads that. Inline tables are changed in the copy.
    """
    forms = _source_forms(program, name)
    edits: list[_Edit] = []
    contents: dict[str, tuple[str, dict[str, Column], list[str]]] = {}
    graphs: dict[str, str] = {}
    for plan in problem.plans:
        declaration = plan.declaration
        table = next(t for t in made.tables if t.name == declaration.name)
        form = forms.get(declaration.name)
        if declaration.inline is not None and isinstance(form, Sequence):
            edits.extend(_inline_edits(form, table))
            continue
        path, kind = _destination(declaration)
        if kind == GRAPH:
            graph = _graph(graphs.get(path), table)
            if graph is not None:
                graphs[path] = graph
                continue
            path, kind = f"{declaration.name}.csv", "csv"
        columns = {column.name: column for column in table.columns}
        if path in contents and _rows(contents[path][1]) != _rows(columns):
            path, kind = f"{declaration.name}.csv", "csv"
        if form is not None and (path != declaration.path or kind != declaration.source):
            key = table.origin.key if declaration.key is None else None  # what the format itself says of it
            stated = "" if key is None else f" :key {json.dumps(key, ensure_ascii=False)}"
            edits.append(_Edit(form.span, f"({kind} {json.dumps(path, ensure_ascii=False)}){stated}"))
        if path in contents:
            changed = {source: columns[source] for source in table.changed}
            contents[path][1].update(changed)
            contents[path][2].extend(table.changed)
        else:
            contents[path] = (kind, columns, list(table.changed))
    files = [
        OutputFile(path=path, content=WRITERS[kind](tuple(columns.values())), summary=_summary(columns, changed))
        for path, (kind, columns, changed) in contents.items()
    ]
    files += [
        OutputFile(path=path, content=text.encode("utf-8"), summary="a pose graph, its edges simulated")
        for path, text in graphs.items()
    ]
    truth = json.dumps(made.truth, ensure_ascii=False, indent=1) + "\n"
    files.append(OutputFile(path=TRUTH, content=truth.encode("utf-8"), summary="the true values"))
    return (*files, *_sources(program, edits))


def _source_forms(program: Program, name: str | None) -> Mapping[str, Symbol | Sequence]:
    """The form that says where each table comes from, by the table's name."""
    found: dict[str, Symbol | Sequence] = {}
    for clause in effective_clauses(program, select_problem(program, name)):
        if clause.head == "data" and len(clause.items) > 2:
            table, form = clause.items[1:3]
            if isinstance(table, Symbol) and isinstance(form, Symbol | Sequence):
                found[table.name] = form
    return found


def _destination(declaration: TableDeclaration) -> tuple[str, str]:
    """Relative path and format of the file of a table."""
    if declaration.path is not None and (declaration.source in WRITERS or declaration.source == GRAPH):
        path = PurePosixPath(declaration.path)
        if not path.is_absolute() and ".." not in path.parts and not Path(declaration.path).is_absolute():
            return declaration.path, declaration.source
    return f"{declaration.name}.csv", "csv"


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
                yield _Edit(cell.span, f"{number / unit.factor!r}{cell.unit}")


def _sources(program: Program, edits: list[_Edit]) -> Iterator[OutputFile]:
    """The problem file and those it uses, edited."""
    main = Path(program.source.name)
    name = main.name if main.suffix == ".mbm" else "problem.mbm"
    taken: set[Path] = set()
    waiting: list[tuple[Source, Path, PurePosixPath]] = [(program.source, program.base / name, PurePosixPath(name))]
    while waiting:
        source, path, target = waiting.pop()
        taken.add(path.resolve())
        own = [edit for edit in edits if edit.span.source == source]
        for written in _used(source):
            used = path.parent / written.value
            place = PurePosixPath(normpath(target.parent / written.value))
            if ".." in place.parts or place.is_absolute():
                place = target.parent / PurePosixPath(written.value).name
                own.append(_Edit(written.span, json.dumps(place.name, ensure_ascii=False)))
            if used.resolve() not in taken:
                waiting.append((read_file(used, str(used), written.span), used, place))
        summary = "the problem, reading these files" if source is program.source else "used by the problem"
        yield OutputFile(path=target.as_posix(), content=_edited(source, own).encode("utf-8"), summary=summary)


def _used(source: Source) -> Iterator[Text]:
    for form in read(source):
        if isinstance(form, Sequence) and form.head == "use" and len(form.items) == 2:
            written = form.items[1]
            if isinstance(written, Text):
                yield written


def _edited(source: Source, edits: list[_Edit]) -> str:
    pieces, reached = [], 0
    for edit in sorted(edits, key=lambda e: e.span.start):
        pieces += [source.text[reached : edit.span.start], edit.text]
        reached = edit.span.end
    return "".join((*pieces, source.text[reached:]))
