"""What knows the problem: ``(first TABLE FORM)``, ``(last TABLE FORM)``, ``(sample …)``; ``(dt)`` and ``(rate x)``."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.values import Builtin, Call, Evaluator, FunctionTable, Macro, Scope, SpecialForm, Value
from mbm.problem import faults
from mbm.problem.sampling import sample
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.sequence.types import RATE
from mbm.text.types import MbmError, Sequence, Symbol


def _chosen(row: RowChoice) -> SpecialForm:
    def special(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
        usage = f"({row.value} TABLE form)"
        if len(form.items) != 3 or not isinstance(form.items[1], Symbol):
            raise MbmError(language_faults.bad_form(form.span, f"`{row.value}` takes a table and a form", usage))
        world, name = evaluator.world, form.items[1]
        tables = world.tables if isinstance(world, ProblemScope) else {}
        if not isinstance(world, ProblemScope) or name.name not in tables:
            raise MbmError(faults.unknown_table(name.span, name.name, tuple(tables)))
        table = tables[name.name]
        with world.standing(table, row):
            return evaluator.wanted(form.items[2], RowScope(world, table, {}, row, scope))

    return special


SPECIAL_FORMS: Mapping[str, SpecialForm] = MappingProxyType(
    {**{choice.value: _chosen(choice) for choice in (RowChoice.FIRST, RowChoice.LAST)}, "sample": sample}
)
"""Added to the special forms while a problem is compiled."""


def _interval(call: Call) -> Value:
    world = call.evaluator.world
    interval = world.here.interval if isinstance(world, ProblemScope) else None
    if interval is None:
        message = "`(dt)` is the time to the step that a transition reaches"
        raise MbmError(language_faults.bad_form(call.span, message, "(= (next x) (+ x (* (dt) v)) :sigma q)"))
    return interval


class _Rate(Macro):
    """``(rate x)``."""

    __slots__ = ()
    name, usage = "rate", "(rate x)"
    doc = "The rate of a state that goes on with constant velocity, per unit of the steps' column in SI."

    def call(self, call: Call) -> Value:
        """The state that ``constant-velocity`` adds."""
        world, forms = call.evaluator.world, call.forms
        if len(forms) != 1 or not isinstance(forms[0], Symbol):
            raise MbmError(language_faults.bad_form(call.span, "`rate` takes the name of a state", "(rate x)"))
        name = forms[0].name + RATE
        if not isinstance(world, ProblemScope) or name not in world.entries:
            raise MbmError(faults.state_without_rate(forms[0].span, forms[0].name))
        return call.evaluator.wanted(Symbol(name=name, span=call.span), call.scope)


FUNCTIONS: FunctionTable = MappingProxyType(
    {
        "dt": Builtin("dt", "(dt)", "The time to the step that a transition reaches.", 0, 0, _interval),
        "rate": _Rate(),
    }
)
"""Functions of problems with states; a definition of the user's goes before."""
