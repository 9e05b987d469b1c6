"""States that are certain at the first step, where what has ``:sigma 0`` is fixed."""

from __future__ import annotations

from dataclasses import replace

from mbm.expression.nodes import Apply, Column, Number, Operation
from mbm.problem.tables import ROW
from mbm.problem.types import Problem, RowValues, Unknown, ValueCase


def held_at_first(unknown: Unknown, certain: tuple[bool, ...]) -> Unknown:
    """The state with what is certain fixed at the first step."""
    family = unknown.family
    if family is None:
        return unknown
    first = Apply(Operation.EQUAL, (Column(family.rows, ROW), Number(1)))
    stated = unknown.fixed
    cases = stated.cases if stated is not None else (ValueCase(static=(), values=(Number(0),) * len(certain)),)
    fixed = tuple(
        replace(
            case,
            values=tuple(
                Apply(Operation.IF, (first, Number(1), value)) if sure else value
                for value, sure in zip(case.values, certain, strict=True)
            ),
        )
        for case in cases
    )
    return replace(unknown, fixed=RowValues(table=family.rows, cases=fixed, span=unknown.span))


def let_go(problem: Problem) -> Problem:
    """The problem of steps behind the first: what `held_at_first` fixes is as free as anywhere else."""
    states = {} if problem.sequence is None else {each.name: each.certain for each in problem.sequence.states}
    unknowns = tuple(_let_go(each, states.get(each.name, ())) for each in problem.unknowns)
    return replace(problem, unknowns=unknowns)


def _let_go(unknown: Unknown, certain: tuple[bool, ...]) -> Unknown:
    if unknown.fixed is None or not certain:
        return unknown
    cases = tuple(
        replace(
            case,
            values=tuple(
                value.arguments[2] if sure and isinstance(value, Apply) else value
                for value, sure in zip(case.values, certain, strict=True)
            ),
        )
        for case in unknown.fixed.cases
    )
    return replace(unknown, fixed=replace(unknown.fixed, cases=cases))
