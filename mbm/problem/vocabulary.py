"""Special forms that know the problem's tables: ``(first TABLE FORM)``, ``(last TABLE FORM)``, ``(sample …)``."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.expression.nodes import RowChoice
from mbm.language import faults as language_faults
from mbm.language.values import Evaluator, Scope, SpecialForm, Value
from mbm.problem import faults
from mbm.problem.sampling import sample
from mbm.problem.scopes import ProblemScope, RowScope
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
        return evaluator.wanted(form.items[2], RowScope(world, tables[name.name], {}, row, scope))

    return special


SPECIAL_FORMS: Mapping[str, SpecialForm] = MappingProxyType(
    {**{choice.value: _chosen(choice) for choice in (RowChoice.FIRST, RowChoice.LAST)}, "sample": sample}
)
"""Added to the special forms while a problem is compiled."""

NOT_YET: Mapping[str, str] = MappingProxyType(
    {
        "next": "sequences",
        "dt": "sequences",
        "rate": "sequences",
    }
)
"""Names that belong to problems and come later."""
