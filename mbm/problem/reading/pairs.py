"""``(pair NAME (A B) :by t …)``, and of a table with itself ``(pair NAME ((from A) (to A)) :by t :step 1s)``."""

from __future__ import annotations

from mbm.expression.units import parse_unit
from mbm.language import faults as language_faults
from mbm.language.scope import integer
from mbm.problem import faults
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.reading.declarations import stretch
from mbm.problem.tables import POSITION, SOURCE, TIME, PairDeclaration, StepKind, Steps, Table
from mbm.text.types import Form, MbmError, Sequence, Symbol

USAGE = "(pair name (a b) :by t [:tolerance dt] [:interpolate true])"
STEP_USAGE = "(pair name ((from a) (to a)) :by row|t|distance :step form [:tolerance form] [:along (x y z)])"
MOST_ROWS = 1_000_000_000


def read_pair(
    work: Workspace, clause: Sequence, keys: tuple[str, ...] = (), passing: tuple[str, ...] = ()
) -> PairDeclaration:
    """What a pair clause says; its tables are there.

    No pair crosses a value of ``keys``; ``passing`` are columns that windows look at.
    """
    known = ("by", "tolerance", "interpolate", "step", "along")
    options = split_options(clause.items[1:], clause.span, owner="`pair`", known=known)
    name, forms = _names(options.positional, clause)
    by = options.get("by")
    if not isinstance(by, Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "`pair` names the column of times", USAGE))
    aliases, tables = zip(*(_side(work, form) for form in forms), strict=True)
    first, second = tables
    if name.name in work.tables:
        raise MbmError(language_faults.duplicate_definition(name.span, name.name, name.span))
    itself = first.name == second.name
    if itself and options.get("step") is None:
        raise MbmError(
            language_faults.bad_form(forms[1].span, "a table is paired with itself by a `:step`", STEP_USAGE)
        )
    if not itself and (options.get("step") or options.get("along")) is not None:
        raise MbmError(language_faults.bad_form(clause.span, "`:step` pairs a table with itself", STEP_USAGE))
    if aliases[0] == aliases[1]:
        aliases = (aliases[0], f"{aliases[0]}-2")
        if not itself:
            raise MbmError(language_faults.duplicate_definition(forms[1].span, aliases[0], forms[0].span))
    keys = _keys((aliases, tables), (*keys, SOURCE) if itself else keys)
    steps = _steps(work, options, by, first) if itself else None
    if steps is None or steps.kind is StepKind.TIME:
        for table in (first, second):
            if by.name not in table.columns:
                raise MbmError(faults.unknown_column(by.span, by.name, table.name, tuple(table.columns)))
        _check_units(first, second, by)
    scale = by.name if steps is None or not steps.along else steps.along[0]
    tolerance = options.get("tolerance")
    if tolerance is not None and steps is not None and steps.kind is StepKind.ROWS:
        raise MbmError(language_faults.bad_form(tolerance.span, "a step of rows has no tolerance", STEP_USAGE))
    return PairDeclaration(
        name=name.name,
        first=first.name,
        second=second.name,
        aliases=(aliases[0], aliases[1]),
        by=by.name,
        tolerance=None if tolerance is None else stretch(work, tolerance, (first, second), scale, ":tolerance"),
        interpolate=_interpolates(options.get("interpolate"), itself=itself),
        steps=steps,
        keys=keys,
        passing=tuple(column for column in _keys((aliases, tables), passing) if column != by.name),
        plain=_plain(by.name, steps, (aliases, tables), (*passing, *keys)),
        span=by.span,
    )


def _keys(sides: tuple[tuple[str, ...], tuple[Table, ...]], keys: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of the tables that are ``keys``, by their own names or with an alias before them."""
    found = [
        name
        for key in keys
        for alias, table in zip(*sides, strict=True)
        for name in (key, key.removeprefix(f"{alias}."))
        if name in table.columns
    ]
    return tuple(dict.fromkeys(found))


def _plain(
    by: str,
    steps: Steps | None,
    sides: tuple[tuple[str, ...], tuple[Table, ...]],
    more: tuple[str, ...],
) -> tuple[tuple[str, str], ...]:
    """The columns that have names without an alias, as the first of the tables has them that knows them."""
    timed = () if steps is not None and steps.kind is not StepKind.TIME else (by,)
    names = (*timed, *(() if steps is None else (TIME,)), *more)
    found: dict[str, str] = {}
    for alias, table in zip(*sides, strict=True):
        for name in names:
            if name in table.columns:
                found.setdefault(name, f"{alias}.{name}")
    return tuple((name, found[name]) for name in dict.fromkeys(names) if name in found)


def _names(positional: tuple[Form, ...], clause: Sequence) -> tuple[Symbol, tuple[Form, Form]]:
    if len(positional) == 2:
        name, tables = positional
        if isinstance(name, Symbol) and isinstance(tables, Sequence) and len(tables.items) == 2:
            return name, (tables.items[0], tables.items[1])
    raise MbmError(language_faults.bad_form(clause.span, "`pair` has a name and two tables", USAGE))


def _side(work: Workspace, form: Form) -> tuple[str, Table]:
    """``A``, or ``(alias A)``: what the columns are called by, and the table."""
    if not isinstance(form, Sequence):
        table = work.table(form)
        return table.name, table
    if len(form.items) != 2 or not isinstance(form.items[0], Symbol):
        raise MbmError(language_faults.bad_form(form.span, "a table under another name is (name table)", STEP_USAGE))
    return form.items[0].name, work.table(form.items[1])


def _steps(work: Workspace, options: Options, by: Symbol, table: Table) -> Steps:
    """How far the second row stands behind the first."""
    step, along = options.get("step"), options.get("along")
    if step is None:
        raise TypeError(by.name)
    words = {kind.value: kind for kind in (StepKind.ROWS, StepKind.DISTANCE)}
    kind = words.get(by.name, StepKind.TIME)
    if along is not None and kind is not StepKind.DISTANCE:
        raise MbmError(
            language_faults.bad_form(along.span, "`:along` says of what `:by distance` is the path", STEP_USAGE)
        )
    columns = _along(table, along, by) if kind is StepKind.DISTANCE else ()
    if kind is StepKind.ROWS:
        length = float(integer(work.evaluator.wanted(step, work.scope), step.span, "a whole number of rows (`:step`)"))
        if not 1 <= length <= MOST_ROWS:
            raise MbmError(
                language_faults.bad_form(step.span, "`:step` is a whole number of rows from 1 on", STEP_USAGE)
            )
    else:
        length = stretch(work, step, (table,), columns[0] if columns else by.name, ":step")
    return Steps(kind=kind, step=length, along=columns)


def _along(table: Table, form: Form | None, by: Symbol) -> tuple[str, ...]:
    """The columns of the position that a path is made of."""
    if form is None:
        found = tuple(name for name in POSITION if name in table.columns)
        if not found:
            raise MbmError(faults.unknown_column(by.span, POSITION[0], table.name, tuple(table.columns)))
        return found
    items = form.items if isinstance(form, Sequence) else (form,)
    for item in items:
        if not isinstance(item, Symbol) or item.name not in table.columns:
            raise MbmError(faults.unknown_column(item.span, item.span.text, table.name, tuple(table.columns)))
    return tuple(item.name for item in items if isinstance(item, Symbol))


def _check_units(first: Table, second: Table, by: Symbol) -> None:
    """Two times with units are of one dimension."""
    left, right = (parse_unit(table.columns[by.name].unit or "") for table in (first, second))
    if left is not None and right is not None and left.dimension != right.dimension:
        shown = [f"column `{by.name}` of `{t.name}` in {u.symbol}" for t, u in ((first, left), (second, right))]
        raise MbmError(faults.unit_clash(by.span, shown[0], shown[1], ()))


def _interpolates(form: Form | None, *, itself: bool) -> bool:
    if form is None:
        return False
    if itself:
        message = "rows of one table are paired as they are: `:interpolate` is for two"
        raise MbmError(language_faults.bad_form(form.span, message, STEP_USAGE))
    if not isinstance(form, Symbol) or form.name not in ("true", "false"):
        raise MbmError(language_faults.bad_form(form.span, "`:interpolate` is `true` or `false`", USAGE))
    return form.name == "true"
