"""``(NAME [TYPE] option…)``: the names, types and families of unknowns, known before any option is evaluated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import prod

from mbm.expression.algebra import known_value
from mbm.expression.nodes import Column, ColumnMember, Component, Constant, LiteralMember, Member, Number, nearest
from mbm.expression.rows import RowChoice
from mbm.expression.units import parse_unit
from mbm.language import faults as language_faults
from mbm.language.scope import integer
from mbm.language.values import Array, FamilyValue, PoseValue, TextColumn, Value, describe
from mbm.language.vocabulary.rigid import plane_rotation, quaternion_rotation
from mbm.problem import faults
from mbm.problem.clauses import Options, only, split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.joining import with_families
from mbm.problem.manifold import Manifold, manifold_of
from mbm.problem.requests import Window
from mbm.problem.rows import numbers_of
from mbm.problem.scopes import Entry
from mbm.problem.tables import ROW, Table
from mbm.problem.types import Family, UnknownKind
from mbm.problem.zero_points import stated_difference
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

WINDOW_USAGE = "(window column :length l :step s [:min-rows n] [:carry true])"
MOST_ROWS_WANTED = 1_000_000_000


def read_window(work: Workspace, clauses: list[Sequence], for_each: tuple[str, ...]) -> Window | None:
    """The window that a problem asks for; ``for_each`` are the columns that choose rows besides."""
    clause = only(clauses, "window")
    if clause is None:
        return None
    options = split_options(
        clause.items[1:], clause.span, owner="`window`", known=("length", "step", "min-rows", "carry")
    )
    if len(options.positional) != 1 or not isinstance(options.positional[0], Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "`window` names one column", WINDOW_USAGE))
    named = options.positional[0]
    length, step = options.get("length"), options.get("step")
    if length is None or step is None:
        raise MbmError(language_faults.bad_form(clause.span, "`window` wants a length and a step", WINDOW_USAGE))
    column = named_column(work, named)
    tables = tuple(table for table in work.tables.values() if column in table.columns)
    refuse_texts(tables, column, named.span)
    if column in for_each:
        raise MbmError(language_faults.duplicate_definition(named.span, column, clause.span))
    rows = options.get("min-rows")
    wanted = "a whole number (`:min-rows`)"
    count = 1 if rows is None else integer(work.evaluator.wanted(rows, work.scope), rows.span, wanted)
    if not 1 <= count <= MOST_ROWS_WANTED:
        where = rows.span if rows is not None else clause.span
        raise MbmError(language_faults.bad_form(where, "`:min-rows` is a whole number from 1 on", WINDOW_USAGE))
    return Window(
        column=column,
        length=stretch(work, length, tables, column, ":length"),
        step=stretch(work, step, tables, column, ":step"),
        min_rows=count,
        carry=_is_true(options.get("carry"), clause.span),
        span=clause.items[0].span,
    )


def _is_true(form: Form | None, span: Span) -> bool:
    if form is not None and not (isinstance(form, Symbol) and form.name in ("true", "false")):
        raise MbmError(language_faults.bad_form(form.span, "`:carry` is true or false", WINDOW_USAGE))
    return isinstance(form, Symbol) and form.name == "true"


def named_column(work: Workspace, form: Symbol) -> str:
    """The name of the column.

    Raises:
        MbmError: no table has it, or not the one that is named.

    """
    if any(form.name in table.columns for table in work.tables.values()):
        return form.name
    name, _, column = form.name.partition(".")
    table = work.tables.get(name) if column else None
    if table is None:
        every = tuple(dict.fromkeys(c for each in work.tables.values() for c in each.columns))
        raise MbmError(faults.unknown_column(form.span, form.name, "any table", every))
    if column not in table.columns:
        raise MbmError(faults.unknown_column(form.span, column, name, tuple(table.columns)))
    return column


def names_in(clauses: Iterable[Sequence], head: str) -> tuple[str, ...]:
    """The names of columns in the clauses with a head, as they are written."""
    return tuple(form.name for c in clauses if c.head == head for form in c.items[1:] if isinstance(form, Symbol))


def meant(names: Iterable[str], tables: Mapping[str, Table]) -> tuple[str, ...]:
    """What columns are called in ``tables``, the pairs not yet among them: ``run`` for ``P.A.run``.

    A joined column keeps the name before it; names of no column stay as they are.
    """
    known = {column for table in tables.values() for column in table.columns}
    return tuple(next((end for end in _ends(name) if end in known), name) for name in names)


def _ends(name: str) -> Iterable[str]:
    """The name, and what is left of it without the first part, the first two …"""
    parts = name.split(".")
    return (".".join(parts[i:]) for i in range(len(parts)))


def stretch(work: Workspace, form: Form, tables: tuple[Table, ...], column: str, what: str) -> float:
    """A length of time (or of whatever the column measures) above zero, in SI, that goes with the column's unit."""
    value = work.evaluator.wanted(form, work.scope)
    if not isinstance(value, Number | Constant):
        raise MbmError(language_faults.wrong_kind(form.span, "a number known while compiling", describe(value)))
    for table in tables:
        unit = table.columns[column].unit if column in table.columns else None
        known = parse_unit(unit) if unit is not None else None
        if known is not None and value.dimension is not None and value.dimension != known.dimension:
            left = f"`{form.span.text}`, {value.dimension.describe()},"
            right = f"column `{column}` of `{table.name}`, {known.dimension.describe()}"
            raise MbmError(faults.unit_clash(form.span, left, right, ()))
    stated_difference(value, form.span)
    number = nearest(known_value(value))
    if not 0 < number < float("inf"):
        raise MbmError(language_faults.bad_form(form.span, f"`{what}` is a number above zero", f"{what} 1s"))
    return number


def refuse_texts(tables: Iterable[Table], column: str, span: Span) -> None:
    """Refuse texts in a column of times.

    Raises:
        MbmError: bad-time.

    """
    for table in tables:
        numbers_of(table, column, span)


USAGE = (
    "(name [type] [:init form] [:in (lo hi)] [:unit u] [:sigma s] [:prior (rectangular lo hi)] "
    "[:fixed true [:at form]] [:per TABLE])"
)
OPTIONS = ("init", "in", "start", "unit", "sigma", "covariance", "fixed", "at", "per", "doc", "prior")
STATE_OPTIONS = tuple(option for option in OPTIONS if option not in ("per", "prior"))
_SCALARS = {"real": UnknownKind.REAL, "positive": UnknownKind.POSITIVE, "angle": UnknownKind.ANGLE}
_SPATIAL = ("rotation", "pose", "similarity")


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """An unknown as declared: its type is known, its options are forms still."""

    name: Symbol
    kind: UnknownKind
    shape: tuple[int, ...]
    dimension: int
    family: Family | None
    options: Options

    @property
    def manifold(self) -> Manifold:
        """How its numbers vary."""
        return manifold_of(self.kind.value, self.dimension, prod(self.shape))


def declare_unknowns(work: Workspace, clause: Sequence) -> list[Declaration]:
    """Declare the names of a clause, so that all clauses may use them."""
    found = []
    for item in clause.items[1:]:
        with work.collecting(item):
            declaration = read_declaration(work, item)
            keys = keys_of(work, declaration.family)
            _enter(work, declaration, keys)
            found.append(declaration)
    return found


def read_declaration(work: Workspace, item: Form, *, steps: Family | None = None) -> Declaration:
    """An unknown as declared; with ``steps`` a state, whose family goes over them."""
    if not (isinstance(item, Sequence) and item.items and isinstance(item.items[0], Symbol)):
        written = f", `({item.name})`" if isinstance(item, Symbol) else ""
        said = f"an unknown is a list that begins with its name{written}"
        raise MbmError(language_faults.bad_form(item.span, said, USAGE))
    name = item.items[0]
    owner, known = ("an unknown", OPTIONS) if steps is None else ("a state", STATE_OPTIONS)
    options = split_options(item.items[1:], item.span, owner=owner, known=known)
    if len(options.positional) > 1:
        raise MbmError(language_faults.bad_form(options.positional[1].span, "only one type may be given", USAGE))
    kind, shape, dimension = _type(work, options.positional[0] if options.positional else None)
    family = family_of(work, options.get("per")) if steps is None else steps
    return Declaration(name=name, kind=kind, shape=shape, dimension=dimension, family=family, options=options)


def _type(work: Workspace, form: Form | None) -> tuple[UnknownKind, tuple[int, ...], int]:
    if form is None:
        return UnknownKind.REAL, (), 0
    head = form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
    if isinstance(form, Symbol) and form.name in _SCALARS:
        return _SCALARS[form.name], (), 0
    if isinstance(form, Symbol) and head == "direction":
        return UnknownKind.DIRECTION, (manifold_of(head, 3, 0).size,), 3
    if head in _SPATIAL:
        return _spatial(work, form, head)
    if isinstance(form, Sequence) and head in ("vector", "array"):
        extents = [integer(work.evaluator.wanted(f, work.scope), f.span, "a size") for f in form.items[1:]]
        most = 1 if head == "vector" else 2
        if not 1 <= len(extents) <= most:
            usage = "(vector n)" if head == "vector" else "(array n) or (array n m)"
            raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes its sizes", usage))
        for extent, size_form in zip(extents, form.items[1:], strict=True):
            if extent < 1:
                raise MbmError(language_faults.bad_index(size_form.span, f"there is no {head} of size {extent}"))
        work.evaluator.budget.check_length(prod(extents), form)
        return UnknownKind(head), tuple(extents), 0
    known = (*_SCALARS, "vector", "array", "direction", *_SPATIAL)
    shown = head or form.span.text
    raise MbmError(faults.unknown_type(form.span, shown, known))


def _spatial(work: Workspace, form: Form, head: str) -> tuple[UnknownKind, tuple[int, ...], int]:
    """``(rotation 2)``, ``(pose 3)``, …: the dimension says of which space."""
    dimension = 0
    if isinstance(form, Sequence) and len(form.items) == 2:
        dimension = integer(work.evaluator.wanted(form.items[1], work.scope), form.items[1].span, "a dimension")
    if dimension not in (2, 3):
        usage = f"({head} 2) of the plane, or ({head} 3) of space"
        raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes its dimension", usage))
    return UnknownKind(head), (manifold_of(head, dimension, 0).size,), dimension


def family_of(work: Workspace, form: Form | None) -> Family | None:
    """The family that ``:per`` states; None without one."""
    if form is None:
        return None
    if isinstance(form, Sequence) and form.items:
        return _stacked(work, form)
    source = _column_of(work, form)
    if source is not None:
        table_name, column = source
        return Family(table=table_name, column=column, rows=f"{table_name}.{column}", key=column)
    table = work.table(form)
    if table.key is None:
        raise MbmError(faults.table_without_key(form.span, table.name))
    return Family(table=table.name, column=None, rows=table.name, key=table.key)


def _column_of(work: Workspace, form: Form) -> tuple[str, str] | None:
    """The table and column that ``table.column`` names; None if that is no such name.

    A family over the column before this one has entered a table of that name.
    """
    if not isinstance(form, Symbol) or "." not in form.name:
        return None
    name, column = form.name.split(".", 1)
    table = work.tables.get(name)
    if table is not None and column not in table.columns:
        if form.name in work.tables:
            return None
        raise MbmError(faults.unknown_column(form.span, column, name, tuple(table.columns)))
    return None if table is None else (name, column)


def _stacked(work: Workspace, form: Sequence) -> Family:
    """``(A.c B.d)``: a member for each value that one of the columns has."""
    sources = []
    for item in form.items:
        source = _column_of(work, item)
        if source is None:
            said = "`:per` takes a table, a column, or a list of columns"
            raise MbmError(language_faults.bad_form(item.span, said, ":per (edges.from edges.to)"))
        sources.append(source)
    first = work.tables[sources[0][0]].columns[sources[0][1]]
    for item, (table, column) in zip(form.items, sources, strict=True):
        if (work.tables[table].columns[column].texts is None) != (first.texts is None):
            words = ("numbers", "texts") if first.texts is None else ("texts", "numbers")
            raise MbmError(
                language_faults.wrong_kind(item.span, f"a column of {words[0]}, as the first", f"one of {words[1]}")
            )
    name = " ".join(f"{table}.{column}" for table, column in sources)
    return Family(
        table=f"all of {name}", column=sources[0][1], rows=f"({name})", key=sources[0][1], sources=tuple(sources)
    )


def keys_of(work: Workspace, family: Family | None) -> frozenset[str | float] | None:
    """The keys of a family's members, whose table is entered where it is made of a column; None without a family."""
    if family is None:
        return None
    work.tables.update(with_families(work.tables, (family,)))
    return frozenset(work.tables[family.rows].keys(family.key))


def components(declaration: Declaration, member: Member | None, span: Span | None = None) -> Value:
    """The unknown, or one member of the family, as a value."""
    name = declaration.name.name
    angle = declaration.kind is UnknownKind.ANGLE
    shape = declaration.shape
    if not shape:
        return Component(name, (), member, angle, span)
    if declaration.dimension:
        angles = declaration.manifold.number_angles()
        numbers = tuple(Component(name, (i + 1,), member, a, span) for i, a in enumerate(angles))
        return _geometric(declaration, numbers, span or declaration.name.span)
    if len(shape) == 1:
        return Array(shape, tuple(Component(name, (i + 1,), member, angle, span) for i in range(shape[0])))
    indices = [(i + 1, j + 1) for i in range(shape[0]) for j in range(shape[1])]
    return Array(shape, tuple(Component(name, index, member, angle, span) for index in indices))


def _geometric(declaration: Declaration, numbers: tuple[Component, ...], span: Span) -> Value:
    """A direction, rotation, pose or similarity made of the numbers that hold it."""
    kind, dimension = declaration.kind, declaration.dimension
    if kind is UnknownKind.DIRECTION:
        return Array((3,), numbers)
    held = 4 if dimension == 3 else 1
    rotation = quaternion_rotation(numbers[:4], span) if dimension == 3 else plane_rotation(numbers[0], span)
    if kind is UnknownKind.ROTATION:
        return rotation
    scale = numbers[-1] if kind is UnknownKind.SIMILARITY else None
    return PoseValue(rotation, numbers[held : held + dimension], scale)


def _enter(work: Workspace, declaration: Declaration, keys: frozenset[str | float] | None) -> None:
    name = declaration.name

    def make() -> Value:
        if keys is None:
            return components(declaration, None)

        def member(key: str | float | Column | TextColumn) -> Value:
            if isinstance(key, Column | TextColumn):
                return components(declaration, ColumnMember(table=key.table, column=key.name, row=key.row))
            if declaration.family is not None:
                work.reads.keyed[declaration.family.rows] = None
            return components(declaration, LiteralMember(key=key))

        return FamilyValue(name.name, keys, member)

    work.scope.add(name.name, Entry("unknown", name.span, make))


def own_member(family: Family | None, row: RowChoice = RowChoice.EACH) -> Member | None:
    """The member of a family that belongs to a row of the family's own table: to the one at hand."""
    if family is None:
        return None
    return ColumnMember(table=family.rows, column=family.key or ROW, row=row)
