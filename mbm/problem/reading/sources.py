"""``(data NAME SOURCE option…)``: which table is read from where, and which are put end to end (``union``)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field, replace
from graphlib import CycleError, TopologicalSorter
from typing import TypeAlias

from mbm.expression.algebra import known_value
from mbm.expression.nodes import Constant, Number, nearest
from mbm.expression.units import Dimension, Unit, parse_unit, scale_of
from mbm.language import faults as language_faults
from mbm.language.values import Evaluator, Scope, describe
from mbm.problem import faults
from mbm.problem.clauses import split_options, stated_unit
from mbm.problem.elaboration import Workspace
from mbm.problem.reading.noise_structure import READER, matrix_forms, matrix_table
from mbm.problem.reading.source_arguments import read_arguments
from mbm.problem.tables import UNION, ColumnDeclaration, Format, InlineTable, Member, Table, TableDeclaration
from mbm.problem.types import Join, TablePlan
from mbm.scales import SI
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, Form, Keyword, Label, MbmError, Numeral, Sequence, Span, Symbol, Text
from mbm.values import dataclass


def check_members(clauses: Mapping[str, DataClause]) -> None:
    """Check that unions take tables which there are, as they are read, and not themselves.

    Raises:
        MbmError: unknown-table, union-of-chosen-rows, circular-definition.

    """
    found: list[Diagnostic] = []
    for clause in clauses.values():
        for member in clause.declaration.members:
            other = clauses.get(member.name)
            if other is None:
                found.append(faults.unknown_table(member.span, member.name, tuple(clauses)))
            elif other.where is not None or other.joins:
                option = ":where" if other.where is not None else ":with"
                found.append(faults.union_of_chosen_rows(member.span, member.name, option, clause.declaration.name))
    if found:
        raise MbmError(*found)
    members = {name: [member.name for member in each.declaration.members] for name, each in clauses.items()}
    try:
        TopologicalSorter(members).prepare()
    except CycleError as error:
        circle = tuple(error.args[1])
        raise MbmError(language_faults.circular_definition(clauses[circle[0]].declaration.span, circle)) from None


def check_units(clauses: Mapping[str, DataClause], raw: Mapping[str, Table]) -> None:
    """Check that a column has one dimension in all tables of a union, and that only one clause states its unit.

    Raises:
        MbmError: unit-clash, mixed-units.

    """
    for clause in clauses.values():
        stated: dict[str, tuple[Dimension, str, Span]] = {}
        for member in clause.declaration.members:
            for name, column in raw[member.name].columns.items():
                unit = parse_unit(column.unit) if column.unit is not None else None
                if unit is None or column.unit is None:
                    continue
                place = _stated(clauses[member.name], name, member)
                first = stated.setdefault(name, (unit.dimension, column.unit, place))
                if first[0] != unit.dimension:
                    labels = (Label(first[2], f"in `{first[1]}` here"), Label(place, f"in `{column.unit}` here"))
                    what = f"column `{name}` of `{member.name}` in `{column.unit}`"
                    other = f"that of the tables before in `{first[1]}`"
                    raise MbmError(faults.unit_clash(member.span, what, other, labels))
        for declared in clause.declaration.columns:
            if declared.unit is not None and declared.source in stated:
                place = stated[declared.source][2]
                raise MbmError(faults.unit_given_twice(declared.span, declared.source, place, "a table of the union"))


def _stated(clause: DataClause, column: str, member: Member) -> Span:
    """Where the unit of a column of a member is stated: in its clause, or, of a union, wherever that takes it from."""
    declared = (each.span for each in clause.declaration.columns if each.name == column and each.unit is not None)
    return next(declared, member.span)


USAGE = (
    '(data name (csv "path") [:key column] [:with (table column)] [:columns ((new old :unit u)…)] '
    "[:where form] [:missing skip])"
)
Formats: TypeAlias = Mapping[str, Format]
"""What a data clause may say of the formats of files, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DataClause:
    """A data clause before its table is read; ``where`` is a form still."""

    declaration: TableDeclaration
    joins: tuple[Join, ...]
    where: Form | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """The source of a data clause: a format with its path (and table, of several), ``external``, or rows written.

    ``units`` has the SI unit of each column of which the source states it, and the place that does; ``usual`` the unit
    of columns that have none of their own.
    """

    format: str
    path: str | None = None
    part: str | None = None
    arguments: tuple[tuple[str, float | str], ...] = ()
    inline: InlineTable | None = None
    members: tuple[Member, ...] = ()
    units: Mapping[str, tuple[str, Span]] = field(default_factory=dict)
    usual: Mapping[str, str] = field(default_factory=dict)


def read_source(evaluator: Evaluator, scope: Scope, clause: Sequence, formats: Formats) -> DataClause:
    """The declaration that a data clause makes; ``formats`` are those that there are readers for."""
    items = clause.items[1:]
    if len(items) < 2 or not isinstance(items[0], Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "a data clause has a name and a source", USAGE))
    name = items[0]
    options = split_options(
        items[2:],
        clause.span,
        owner="`data`",
        known=("key", "columns", "where", "missing"),
        repeatable=("with",),
    )
    if options.positional:
        raise MbmError(language_faults.bad_form(options.positional[0].span, "a data clause has one source", USAGE))
    origin = _source(evaluator, scope, items[1], formats)
    columns = _with_units(origin, _columns(options.get("columns")), items[1].span)
    key = options.get("key")
    declaration = TableDeclaration(
        name=name.name,
        source=origin.format,
        path=origin.path,
        part=origin.part,
        arguments=origin.arguments,
        inline=origin.inline,
        members=origin.members,
        key=_symbol(key, ":key") if key is not None else None,
        columns=columns,
        skip_missing=_skips(options.get("missing")),
        span=name.span,
    )
    joins = tuple(_join(form) for form in options.repeated.get("with", ()))
    return DataClause(declaration=declaration, joins=joins, where=options.get("where"))


def plan_of(work: Workspace, data: DataClause) -> TablePlan:
    """How the table of a clause comes to be: which of its rows are kept is known now."""
    table = work.tables[data.declaration.name]
    where = None if data.where is None else work.conditions(data.where, table, 1, wanted="`:where`")
    return TablePlan(declaration=data.declaration, joins=data.joins, where=where)


def in_join_order(clauses: Mapping[str, DataClause]) -> list[DataClause]:
    """The clauses, each behind those whose tables it joins: the order in a file says nothing.

    A table may join itself: it then sees its own rows as they were read.

    Raises:
        MbmError: tables that join one another in a circle.

    """
    found: list[DataClause] = []
    done: set[str] = set()

    def visit(name: str, chain: tuple[str, ...]) -> None:
        for join in clauses[name].joins:
            if join.table in chain:
                circle = (*chain[chain.index(join.table) :], name, join.table)
                raise MbmError(language_faults.circular_definition(join.span, circle))
            if join.table in clauses and join.table not in done and join.table != name:
                visit(join.table, (*chain, name))
        done.add(name)
        found.append(clauses[name])

    for name in clauses:
        if name not in done:
            visit(name, ())
    return found


def refuse_overwriting(table: Table, clause: DataClause, tables: Mapping[str, Table]) -> None:
    """No joined column may take the name of a column that is there.

    Raises:
        MbmError: it does.

    """
    taken = dict.fromkeys(table.columns, clause.declaration.span)
    for join in clause.joins:
        names = tables[join.table].columns if join.table in tables else ()
        for name in (f"{join.alias}.{column}" for column in names):
            if name in taken:
                raise MbmError(language_faults.duplicate_definition(join.span, name, taken[name]))
            taken[name] = join.span


def _source(evaluator: Evaluator, scope: Scope, form: Form, formats: Formats) -> _Source:
    if isinstance(form, Symbol) and form.name == "external":
        return _Source(format="external")
    head = form.head if isinstance(form, Sequence) else None
    if isinstance(form, Sequence) and head is not None and head in formats:
        known = formats[head]
        if known.arguments:
            return _images(evaluator, scope, form, known)
        return _file(evaluator, scope, form, known)
    if isinstance(form, Sequence) and head == "table":
        return _inline(evaluator, scope, form)
    if isinstance(form, Sequence) and head == UNION:
        return _Source(format=UNION, members=_members(form))
    shown = head or form.span.text
    raise MbmError(faults.unknown_source(form.span, shown, (*formats, "table", UNION, "external")))


def _file(evaluator: Evaluator, scope: Scope, form: Sequence, known: Format) -> _Source:
    """``(csv "path")``; ``(g2o "path" :edges)``: one of the tables of a file."""
    head, parts = form.head or "", known.parts
    if not (parts or known.named):
        if len(form.items) != 2 or not isinstance(form.items[1], Text):
            raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes one path", f'({head} "path")'))
        return _Source(format=head, path=form.items[1].value, usual=known.units)
    if known.named:
        texts = [item.value for item in form.items[1:] if isinstance(item, Text)]
        if not 1 <= len(texts) <= 2 or len(texts) != len(form.items) - 1:
            usage = f'({head} "path" ["node"])'
            raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes a path and the name of a node", usage))
        return _Source(format=head, path=texts[0], part=texts[1] if len(texts) > 1 else "")
    usage = f'({head} "path" {" | ".join(f":{part}" for part in parts)})'
    if len(form.items) < 3 or not isinstance(form.items[1], Text) or not isinstance(form.items[2], Keyword):
        raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes a path and the table that is meant", usage))
    part = form.items[2]
    if part.name not in parts:
        near = closest(part.name, parts)
        raise MbmError(language_faults.unknown_keyword(part.span, part.name, f"`{head}`", (near,) if near else parts))
    meant = Format(parts=(part.name,), arguments=known.of_part.get(part.name, ()))
    given = read_arguments(evaluator, scope, replace(form, items=(*form.items[:2], *form.items[3:])), meant)
    return _Source(format=head, path=given.path, part=part.name, arguments=given.values)


def _members(form: Sequence) -> tuple[Member, ...]:
    """``(union A B …)``: the tables, each once."""
    usage = "(union table table …)"
    found: dict[str, Member] = {}
    for item in form.items[1:]:
        if not isinstance(item, Symbol):
            raise MbmError(language_faults.bad_form(item.span, "a union takes the names of tables", usage))
        if item.name in found:
            raise MbmError(language_faults.duplicate_definition(item.span, item.name, found[item.name].span))
        found[item.name] = Member(name=item.name, span=item.span)
    if not found:
        raise MbmError(language_faults.bad_form(form.span, "a union takes the names of tables", usage))
    return tuple(found.values())


def _images(evaluator: Evaluator, scope: Scope, form: Sequence, known: Format) -> _Source:
    """``(chessboard "left*.jpg" 9 6 25mm)``: images, and what is to be found in them."""
    given = read_arguments(evaluator, scope, form, known)
    units = {} if given.length is None else dict.fromkeys(known.lengths, given.length)
    return _Source(format=form.head or "", path=given.path, arguments=given.values, units=units, usual=known.units)


def _inline(evaluator: Evaluator, scope: Scope, form: Sequence) -> _Source:
    usage = "(table (column…) (value…)…)"
    header = form.items[1] if len(form.items) > 1 else None
    if not isinstance(header, Sequence) or not all(isinstance(i, Symbol) for i in header.items):
        raise MbmError(language_faults.bad_form(form.span, "an inline table begins with its columns", usage))
    names = tuple(i.name for i in header.items if isinstance(i, Symbol))
    for name in (n for n in names if names.count(n) > 1):
        raise MbmError(language_faults.duplicate_definition(header.span, name, header.span))
    rows = []
    units, bare, zeros = dict[str, tuple[str, Span]](), dict[str, Span](), dict[str, Span]()
    for item in form.items[2:]:
        if not isinstance(item, Sequence) or len(item.items) != len(names):
            shown = f"{len(item.items)} values" if isinstance(item, Sequence) else "no list"
            raise MbmError(language_faults.length_clash(item.span, f"a row of {shown}", f"{len(names)} columns"))
        cells = [_cell(evaluator, scope, cell) for cell in item.items]
        for name, (value, unit), cell in zip(names, cells, item.items, strict=True):
            if unit is None and not isinstance(value, str):
                (zeros if value == 0 else bare).setdefault(name, cell.span)  # 0 m is 0 mm, 0 degC is not 0 K
            if unit is not None and units.setdefault(name, (unit, cell.span))[0] != unit:
                raise MbmError(faults.mixed_units(cell.span, name, (units[name][0], unit), units[name][1]))
        rows.append(tuple(value for value, _ in cells))
    for name, (unit, place) in units.items():
        if alone := bare.get(name) or (zeros.get(name) if scale_of(unit).zero else None):
            raise MbmError(faults.cell_without_unit(alone, name, unit, place))
    table = InlineTable(columns=names, rows=tuple(rows), spans=tuple(i.span for i in form.items[2:]))
    return _Source(format="table", inline=table, units=units)


def _with_units(origin: _Source, columns: tuple[ColumnDeclaration, ...], place: Span) -> tuple[ColumnDeclaration, ...]:
    """What the source states, as the cells ``5mm`` of an inline table do, ``:columns`` may not state again."""
    units = {**{name: (unit, place) for name, unit in origin.usual.items()}, **origin.units}
    found = []
    for column in columns:
        stated = origin.units.get(column.source)
        if stated is not None and column.unit is not None:
            raise MbmError(faults.unit_given_twice(column.span, column.source, stated[1]))
        unit, _ = units.pop(column.source, (None, place))
        found.append(column if column.unit is not None else replace(column, unit=unit or None, scale=scale_of(unit)))
    left = [
        ColumnDeclaration(name=name, source=name, unit=unit or None, scale=scale_of(unit), span=span)
        for name, (unit, span) in units.items()
    ]
    return (*found, *left)


def _cell(evaluator: Evaluator, scope: Scope, form: Form) -> tuple[float | str, str | None]:
    """A cell in SI and its SI unit, if it states one (empty for a pure number such as an angle).

    A temperature such as 20degC stays in its unit, as in a file whose column states that.
    """
    if isinstance(form, Text):
        return form.value, None
    if isinstance(form, Symbol) and scope.lookup(form.name, form.span) is None and form.name != "pi":
        return form.name, None
    value = evaluator.wanted(form, scope)
    if isinstance(form, Numeral) and isinstance(value, Number) and value.absolute:
        return nearest(form.value), form.unit
    if isinstance(value, Number | Constant):
        return nearest(known_value(value)), value.dimension.symbol() if value.dimension is not None else None
    raise MbmError(language_faults.wrong_kind(form.span, "a number or a text", describe(value)))


def _columns(form: Form | None) -> tuple[ColumnDeclaration, ...]:
    if form is None:
        return ()
    if not isinstance(form, Sequence):
        raise MbmError(language_faults.bad_form(form.span, "`:columns` takes a list", ":columns ((new old :unit u)…)"))
    return tuple(_column(item) for item in form.items)


def _column(item: Form) -> ColumnDeclaration:
    if isinstance(item, Symbol):
        return ColumnDeclaration(name=item.name, source=item.name, unit=None, scale=SI, span=item.span)
    usage = "(new old :unit u) or (column :unit u)"
    if not isinstance(item, Sequence):
        raise MbmError(language_faults.bad_form(item.span, "a column is a list", usage))
    options = split_options(item.items, item.span, owner="a column", known=("unit",))
    names = [_symbol(f, "a column") for f in options.positional]
    if not 1 <= len(names) <= 2:
        raise MbmError(language_faults.bad_form(item.span, "a column has a name, or a new and an old one", usage))
    unit_form = options.get("unit")
    unit: Unit | None = stated_unit(unit_form) if unit_form is not None else None
    return ColumnDeclaration(
        name=names[0],
        source=names[-1],
        unit=unit.symbol if unit is not None else None,
        scale=unit.scale if unit is not None else SI,
        span=item.span,
    )


def _skips(form: Form | None) -> bool:
    if form is None:
        return False
    if not (isinstance(form, Symbol) and form.name == "skip"):
        raise MbmError(language_faults.bad_form(form.span, "`:missing` knows one rule", ":missing skip"))
    return True


def _join(form: Form) -> Join:
    usage = ":with (table column) or :with (alias table column)"
    few = isinstance(form, Sequence) and 2 <= len(form.items) <= 3
    if not isinstance(form, Sequence) or not few or any(isinstance(i, Keyword) for i in form.items):
        raise MbmError(language_faults.bad_form(form.span, "`:with` takes a table and a column", usage))
    names = [_symbol(f, ":with") for f in form.items]
    return Join(alias=names[0], table=names[-2], column=names[-1], span=form.span)


def _symbol(form: Form, what: str) -> str:
    if isinstance(form, Symbol):
        return form.name
    if isinstance(form, Text):
        return form.value
    raise MbmError(language_faults.bad_form(form.span, f"`{what}` wants a name", f"{what} name"))


def matrices(clauses: Iterable[Sequence]) -> dict[str, DataClause]:
    """Their tables."""
    return {
        matrix_table(path): DataClause(
            declaration=TableDeclaration(name=matrix_table(path), source=READER, path=path.value, span=path.span),
            joins=(),
            where=None,
        )
        for clause in clauses
        for _, path in matrix_forms(clause)
    }
