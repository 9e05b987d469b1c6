"""``(derive (NAME FORM [:over TABLE] [:unit u])… [:over TABLE])``: quantities computed from the estimates."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Column, Constant, Expression, leaves
from mbm.expression.units import Unit, parse_unit
from mbm.language import faults as language_faults
from mbm.language.scope import integer, scalar, vector
from mbm.language.values import Array, ListValue, Placeable, PoseValue, RotationValue, Scope, TableName, Value
from mbm.problem import faults
from mbm.problem.clauses import split_options, stated_unit
from mbm.problem.elaboration import Workspace
from mbm.problem.grids import Grid
from mbm.problem.joining import grid_rows
from mbm.problem.manifold import manifold_of
from mbm.problem.rows import row_values
from mbm.problem.scopes import Entry
from mbm.problem.types import Derived, RowValues, UnknownKind, ValueCase
from mbm.shapes.library import LibraryModel
from mbm.text.types import Form, MbmError, Numeral, Sequence, Span, Symbol

USAGE = "(derive (name form [:over TABLE] [:unit u])… [:over TABLE])"


def read_derived(work: Workspace, clause: Sequence) -> list[Derived]:
    """The derived quantities of a clause; later ones may use earlier ones."""
    found: list[Derived] = []
    entries: tuple[Form, ...] = ()
    common: Form | None = None
    with work.collecting():
        entries, common = _entries(clause)
    for item in entries:
        with work.collecting():
            found.append(_derived(work, item, common))
            work.extent.add(found[-1])
    return found


def _entries(clause: Sequence) -> tuple[tuple[Form, ...], Form | None]:
    """The entries of a clause, and what all of them are ``:over`` that say nothing else."""
    options = split_options(clause.items[1:], clause.span, owner="`derive`", known=("over",))
    common = options.get("over")
    if common is not None and clause.items[-1] is not common:
        message = "`:over` of all quantities stands last in the clause"
        raise MbmError(language_faults.bad_form(options.places["over"], message, USAGE))
    return options.positional, common


def _derived(work: Workspace, item: Form, common: Form | None) -> Derived:
    """``common``: the ``:over`` of the clause."""
    if not (isinstance(item, Sequence) and len(item.items) > 1 and isinstance(item.items[0], Symbol)):
        raise MbmError(language_faults.bad_form(item.span, "a derived quantity is (name form)", USAGE))
    name = item.items[0]
    options = split_options(item.items[1:], item.span, owner="a derived quantity", known=("over", "unit"))
    if len(options.positional) != 1:
        raise MbmError(language_faults.bad_form(item.span, "a derived quantity has one form", USAGE))
    form = options.positional[0]
    over, unit = options.get("over"), options.get("unit")
    over = common if over is None else over
    grid = read_grid(work, over) if over is not None else None
    table = grid_rows(grid) if grid is not None else work.table(over) if over is not None else None

    def evaluate(scope: Scope) -> tuple[Value, tuple[int, ...], tuple[Expression, ...]]:
        value = work.evaluator.wanted(form, scope)
        return (value, *_elements(value, form.span))

    table, cases = work.cases_at_steps(table, evaluate, item.span)
    kinds = {(*_kind(value), shape) for _, (value, shape, _) in cases}
    if len(kinds) > 1:
        raise MbmError(faults.unequal_branches(form.span))
    kind, dimension, shape = next(iter(kinds), (None, 0, ()))
    if name.name in work.scope.derived_over:
        first = work.scope.derived_over[name.name][1]
        raise MbmError(language_faults.duplicate_definition(name.span, name.name, first.span))
    if table is None:
        value = _kept(*cases[0][1])
        work.scope.add(name.name, Entry("derived quantity", name.span, lambda: value))
    else:
        other = work.scope.entries.get(name.name)
        if other is not None:
            raise MbmError(language_faults.duplicate_definition(name.span, name.name, other.span))
        work.scope.derived_over[name.name] = (table.name, form)
    return Derived(
        name=name.name,
        table=table.name if table is not None else None,
        kind=kind,
        dimension=dimension,
        shape=(manifold_of(kind.value, dimension, 0).size,) if kind is not None else shape,
        cases=tuple(ValueCase(static=s, values=v) for s, (_, _, v) in cases),
        unit=stated_unit(unit) if unit is not None else None,
        grid=grid,
        angle=bool(cases) and all(e.angle for _, (_, _, v) in cases for e in v),
        span=name.span,
    )


def _kept(value: Value, shape: tuple[int, ...], elements: tuple[Expression, ...]) -> Value:
    """What later forms see under the name."""
    if isinstance(value, RotationValue | PoseValue):
        return value
    return Array(shape, elements) if shape else elements[0]


def _kind(value: Value) -> tuple[UnknownKind | None, int]:
    if isinstance(value, RotationValue):
        return UnknownKind.ROTATION, value.dimension
    if isinstance(value, PoseValue):
        return (UnknownKind.POSE if value.scale is None else UnknownKind.SIMILARITY), value.rotation.dimension
    return None, 0


def _elements(value: Value, span: Span) -> tuple[tuple[int, ...], tuple[Expression, ...]]:
    if isinstance(value, RotationValue):
        return (), value.matrix.elements
    if isinstance(value, PoseValue):
        scale = () if value.scale is None else (value.scale,)
        return (), (*value.rotation.matrix.elements, *value.translation, *scale)
    if isinstance(value, Array):
        return value.shape, value.elements
    if isinstance(value, ListValue | Placeable):
        elements = vector(value, span).elements
        return (len(elements),), elements
    return (), (scalar(value, span),)


WORD = "grid"
GRID_USAGE = "(grid t 0s 10s 200)"

MOST_VALUES = 100_000
"""Values of a grid: more than any picture shows, and a slip in the count shows at once."""


def read_grid(work: Workspace, form: Form) -> Grid | None:
    """The grid that ``form`` says; None where it says something else."""
    if not isinstance(form, Sequence) or form.head != WORD:
        return None
    _refuse_other(work, form)
    variable = form.items[1] if len(form.items) == 5 else None
    if not isinstance(variable, Symbol):
        message = "`grid` takes a variable, its first value, its last, and how many there are"
        raise MbmError(language_faults.bad_form(form.span, message, GRID_USAGE))
    first, last, count = form.items[2:]
    steps = work.scope.steps
    if steps is not None and steps.column == variable.name:
        message = f"states have values at the steps of `{variable.name}` only: call the variable of the grid otherwise"
        raise MbmError(language_faults.bad_form(variable.span, message, GRID_USAGE))
    number = integer(work.evaluator.wanted(count, work.scope), count.span, "a whole number of values")
    if not 2 <= number <= MOST_VALUES:
        message = f"a grid has from 2 to {MOST_VALUES:,} values, and this one {number:,}"
        raise MbmError(language_faults.bad_form(count.span, message, GRID_USAGE))
    begin, end = _end(work, first), _end(work, last)
    grid = Grid(
        table=f"({WORD} {' '.join(item.span.text for item in form.items[1:])})",
        variable=variable.name,
        first=float(row_values(begin, {})[0, 0]),
        last=float(row_values(end, {})[0, 0]),
        count=number,
        unit=_unit(last) or _unit(first),
        ends=(begin.cases[0].values[0], end.cases[0].values[0]),
        span=form.span,
    )
    if len(np.unique(grid_rows(grid).numbers(grid.variable))) < number:
        message = f"there are no {number:,} different numbers from `{first.span.text}` to `{last.span.text}`"
        raise MbmError(language_faults.bad_form(form.span, message, GRID_USAGE))
    return grid


def _refuse_other(work: Workspace, form: Sequence) -> None:
    """Refuse what has the name of the user's own definition or variable, which is no table.

    Raises:
        MbmError: it has.

    """
    function = work.evaluator.vocabulary.functions.get(WORD)
    value = work.scope.lookup(WORD, form.items[0].span)
    defined = function is not None and not isinstance(function, LibraryModel)
    if defined or (value is not None and not isinstance(value, TableName)):
        message = "`grid` is a definition or variable of yours here, and `:over` takes a table"
        raise MbmError(language_faults.bad_form(form.span, message, GRID_USAGE, "call yours otherwise"))


def _end(work: Workspace, form: Form) -> RowValues:
    """An end: a number that may be made of exact constants.

    Raises:
        MbmError: it depends on unknowns, on data, or on a constant with an uncertainty.

    """
    values = work.values(form, None, (), wanted="an end of a grid")
    for leaf in leaves(values.cases[0].values):
        if isinstance(leaf, Column):
            message = f"an end of a grid is a number, and the column `{leaf.name}` has other ones in other data"
            raise MbmError(language_faults.bad_form(leaf.span or form.span, message, GRID_USAGE))
        if isinstance(leaf, Constant) and leaf.name in work.uncertain:
            message = f"an end of a grid is an exact number, and `{leaf.name}` has a standard deviation"
            mend = "write the number itself, or another constant without `:sigma`"
            raise MbmError(language_faults.bad_form(form.span, message, GRID_USAGE, mend))
    return values


def _unit(form: Form) -> Unit | None:
    """The unit that an end states."""
    return parse_unit(form.unit) if isinstance(form, Numeral) and form.unit else None
