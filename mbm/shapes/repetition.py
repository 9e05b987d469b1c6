"""``(for (i first last) …)``: one scope for each value of the counter."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.algebra import number
from mbm.language import faults
from mbm.language.scope import LocalScope, integer
from mbm.language.values import Evaluator, Scope
from mbm.text.types import Form, MbmError, Sequence, Symbol

USAGE = "(for (i first last) shape…)"


def repetitions(evaluator: Evaluator, form: Sequence, scope: Scope) -> Iterator[LocalScope]:
    """The scopes in which the body of a ``for`` is read, first to last; none if last < first.

    Raises:
        MbmError: not built as ``USAGE`` says, ends that are not known while compiling, more rounds than the limit.
        StaticColumnNeeded: an end depends on a data column.

    """
    if len(form.items) < 3:
        raise MbmError(faults.bad_form(form.span, "this `for` is not complete", USAGE))
    name, first_form, last_form = _counter(form.items[1])
    first = integer(evaluator.wanted(first_form, scope), first_form.span)
    last = integer(evaluator.wanted(last_form, scope), last_form.span)
    evaluator.budget.check_length(last - first + 1, form)
    for value in range(first, last + 1):
        evaluator.budget.spend(1, form)
        yield LocalScope({name: number(value)}, scope)


def _counter(form: Form) -> tuple[str, Form, Form]:
    if not isinstance(form, Sequence) or len(form.items) != 3 or not isinstance(form.items[0], Symbol):
        raise MbmError(faults.bad_form(form.span, "the counter of `for` is (name first last)", USAGE))
    return form.items[0].name, form.items[1], form.items[2]
