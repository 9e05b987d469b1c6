"""Constants with an uncertainty as fixed unknowns: these vary from trial to trial, and nothing is folded into them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from mbm.language.session import ProblemDefinition, Program
from mbm.problem.clauses import effective_clauses
from mbm.problem.overrides import ConstantValue
from mbm.simulation.trials import faults
from mbm.text.types import Bracket, Form, Keyword, MbmError, Numeral, Sequence, Span, Symbol, symbols_of


def with_drawn_constants(
    program: Program, definition: ProblemDefinition, constants: tuple[ConstantValue, ...]
) -> Program:
    """The program with the ``constants`` of a problem among its unknowns, which are fixed.

    Exact constants that are computed from them become definitions.

    Raises:
        MbmError: `not-propagated`, a matrix, or an uncertain constant that is computed from another.

    """
    drawn = {constant.name: constant for constant in constants}
    stated: list[Form] = []
    clauses: list[Sequence] = []
    for clause in effective_clauses(program, definition):
        if clause.head != "constants":
            clauses.append(clause)
            continue
        followed = _following(clause, frozenset(drawn))
        kept = [item for item in clause.items[1:] if _name(item) not in {*drawn, *followed}]
        clauses.append(_clause("constants", clause.span, kept))
        stated += [_unknown(item, drawn[_name(item)], drawn) for item in clause.items[1:] if _name(item) in drawn]
        computed = [item for item in clause.items[1:] if _name(item) in followed and _name(item) not in drawn]
        if computed:
            clauses.append(_clause("define", clause.span, [_defined(item) for item in computed]))
    clauses.append(_clause("unknowns", definition.span, stated))
    changed = replace(definition, like=None, clauses=tuple(clauses))
    problems: Mapping[str, ProblemDefinition] = {**program.problems, definition.name: changed}
    return replace(program, problems=MappingProxyType(dict(problems)))


def _name(item: Form) -> str:
    return (item.head or "") if isinstance(item, Sequence) else ""


def _clause(head: str, span: Span, items: list[Form]) -> Sequence:
    return Sequence(items=(Symbol(name=head, span=span), *items), bracket=Bracket.ROUND, span=span)


def _following(clause: Sequence, drawn: frozenset[str]) -> frozenset[str]:
    """The constants of a clause that are computed from those that are drawn, whatever stands between."""
    found = set(drawn)
    while True:
        more = {_name(item) for item in clause.items[1:] if _mentions(item, found)} - found
        if not more:
            return frozenset(found - drawn)
        found |= more


def _mentions(item: Form, names: set[str] | Mapping[str, object]) -> bool:
    """Whether the value of an entry (its second element) mentions one of some names."""
    stated = item.items[1:2] if isinstance(item, Sequence) else ()
    return any(symbol.name in names for symbol in symbols_of(*stated))


def _defined(item: Form) -> Form:
    """The entry of an exact constant as that of a definition: without what is not the value."""
    return replace(item, items=item.items[:2]) if isinstance(item, Sequence) else item


def _unknown(item: Form, constant: ConstantValue, drawn: Mapping[str, ConstantValue]) -> Form:
    """The entry of an uncertain constant as that of a fixed unknown."""
    if not isinstance(item, Sequence):
        raise TypeError(item)
    if _mentions(item, drawn):
        why = "its value is computed from another such constant"
        raise MbmError(faults.not_drawn(constant.span, constant.name, why))
    span, size = item.span, len(constant.values)
    if any("," in element for element in constant.elements):
        raise MbmError(faults.not_drawn(constant.span, constant.name, "it is a matrix"))
    shape: tuple[Form, ...] = ()
    if constant.elements != (constant.name,):
        shape = (_list(span, Symbol(name="vector", span=span), Numeral(value=size, unit=None, span=span)),)
    fixed = (Keyword(name="fixed", span=span), Symbol(name="true", span=span))
    return _list(span, item.items[0], *shape, Keyword(name="init", span=span), item.items[1], *fixed)


def _list(span: Span, *items: Form) -> Sequence:
    return Sequence(items=items, bracket=Bracket.ROUND, span=span)
