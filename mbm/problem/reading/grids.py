"""``(grid VARIABLE FIRST LAST COUNT)`` behind ``:over`` of derived quantities."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Column, Constant, leaves
from mbm.expression.units import Unit, parse_unit
from mbm.language import faults as language_faults
from mbm.language.coerce import integer
from mbm.language.values import TableName
from mbm.problem.elaboration import Workspace
from mbm.problem.grids import Grid
from mbm.problem.rows import row_values
from mbm.problem.types import RowValues
from mbm.shapes.library import LibraryModel
from mbm.text.types import Form, MbmError, Numeral, Sequence, Symbol

WORD = "grid"
USAGE = "(grid t 0s 10s 200)"

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
        raise MbmError(language_faults.bad_form(form.span, message, USAGE))
    first, last, count = form.items[2:]
    steps = work.scope.steps
    if steps is not None and steps.column == variable.name:
        message = f"states have values at the steps of `{variable.name}` only: call the variable of the grid otherwise"
        raise MbmError(language_faults.bad_form(variable.span, message, USAGE))
    number = integer(work.evaluator.wanted(count, work.scope), count.span, "a whole number of values")
    if not 2 <= number <= MOST_VALUES:
        message = f"a grid has from 2 to {MOST_VALUES:,} values, and this one {number:,}"
        raise MbmError(language_faults.bad_form(count.span, message, USAGE))
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
    if len(np.unique(grid.rows().numbers(grid.variable))) < number:
        message = f"there are no {number:,} different numbers from `{first.span.text}` to `{last.span.text}`"
        raise MbmError(language_faults.bad_form(form.span, message, USAGE))
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
        raise MbmError(language_faults.bad_form(form.span, message, f"call yours otherwise, to write {USAGE}"))


def _end(work: Workspace, form: Form) -> RowValues:
    """An end: a number that may be made of exact constants.

    Raises:
        MbmError: it depends on unknowns, on data, or on a constant with an uncertainty.

    """
    values = work.values(form, None, (), wanted="an end of a grid")
    for leaf in leaves(values.cases[0].values):
        if isinstance(leaf, Column):
            message = f"an end of a grid is a number, and the column `{leaf.name}` has other ones in other data"
            raise MbmError(language_faults.bad_form(leaf.span or form.span, message, USAGE))
        if isinstance(leaf, Constant) and leaf.name in work.uncertain:
            message = f"an end of a grid is an exact number, and `{leaf.name}` has a standard deviation"
            raise MbmError(language_faults.bad_form(leaf.span or form.span, message, USAGE))
    return values


def _unit(form: Form) -> Unit | None:
    """The unit that an end states."""
    return parse_unit(form.unit) if isinstance(form, Numeral) and form.unit else None
