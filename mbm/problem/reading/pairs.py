"""``(pair NAME (A B) :by t [:tolerance dt] [:interpolate true])``: which two timed tables are laid on one another."""

from __future__ import annotations

from mbm.expression.nodes import Constant, Number, nearest
from mbm.expression.units import parse_unit
from mbm.language import faults as language_faults
from mbm.language.values import describe
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.options import split_options
from mbm.problem.tables import PairDeclaration, Table
from mbm.text.types import Form, MbmError, Sequence, Symbol

USAGE = "(pair name (a b) :by t [:tolerance dt] [:interpolate true])"


def read_pair(work: Workspace, clause: Sequence) -> PairDeclaration:
    """What a pair clause says; its tables are there."""
    options = split_options(clause.items[1:], clause.span, owner="`pair`", known=("by", "tolerance", "interpolate"))
    name, tables = _names(options.positional, clause)
    by = options.get("by")
    if not isinstance(by, Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "`pair` names the column of times", USAGE))
    first, second = (work.table(form) for form in tables)
    if first.name == second.name:
        raise MbmError(language_faults.bad_form(tables[1].span, "`pair` takes two different tables", USAGE))
    if name.name in work.tables:
        raise MbmError(language_faults.duplicate_definition(name.span, name.name, name.span))
    for table in (first, second):
        if by.name not in table.columns:
            raise MbmError(faults.unknown_column(by.span, by.name, table.name, tuple(table.columns)))
    _check_units(first, second, by)
    tolerance = options.get("tolerance")
    return PairDeclaration(
        name=name.name,
        first=first.name,
        second=second.name,
        by=by.name,
        tolerance=None if tolerance is None else stretch(work, tolerance, (first, second), by.name, ":tolerance"),
        interpolate=_interpolates(options.get("interpolate")),
        span=by.span,
    )


def _names(positional: tuple[Form, ...], clause: Sequence) -> tuple[Symbol, tuple[Form, Form]]:
    if len(positional) == 2:
        name, tables = positional
        if isinstance(name, Symbol) and isinstance(tables, Sequence) and len(tables.items) == 2:
            return name, (tables.items[0], tables.items[1])
    raise MbmError(language_faults.bad_form(clause.span, "`pair` has a name and two tables", USAGE))


def _check_units(first: Table, second: Table, by: Symbol) -> None:
    """Two times with units are of one dimension."""
    left, right = (parse_unit(table.columns[by.name].unit or "") for table in (first, second))
    if left is not None and right is not None and left.dimension != right.dimension:
        shown = [f"column `{by.name}` of `{t.name}` in {u.symbol}" for t, u in ((first, left), (second, right))]
        raise MbmError(faults.unit_clash(by.span, shown[0], shown[1], ()))


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
    number = nearest(value.value)
    if not 0 < number < float("inf"):
        raise MbmError(language_faults.bad_form(form.span, f"`{what}` is a number above zero", f"{what} 1s"))
    return number


def _interpolates(form: Form | None) -> bool:
    if form is None:
        return False
    if not isinstance(form, Symbol) or form.name not in ("true", "false"):
        raise MbmError(language_faults.bad_form(form.span, "`:interpolate` is `true` or `false`", USAGE))
    return form.name == "true"
