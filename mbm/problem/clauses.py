"""A problem's clauses in order, with those of the problem that it is ``:like``."""

from __future__ import annotations

from mbm.language import faults as language_faults
from mbm.language.program import ProblemDefinition, Program
from mbm.problem import faults
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, MbmError, Sequence, Symbol

CLAUSES = (
    "constants",
    "data",
    "pair",
    "camera",
    "unknowns",
    "states",
    "dynamics",
    "define",
    "defun",
    "observe",
    "constraints",
    "derive",
    "for-each",
    "window",
    "solve",
)
_MERGED = frozenset({"constants", "unknowns", "define", "derive"})
"""Clauses that are lists of named entries: ``:like`` replaces entry by entry."""


def select_problem(program: Program, name: str | None) -> ProblemDefinition:
    """The problem called ``name``, or the only one.

    Raises:
        MbmError: there is none, none of that name, or several to choose from.

    """
    names = tuple(program.problems)
    if name is not None:
        if name not in program.problems:
            raise MbmError(faults.unknown_problem(name, names))
        return program.problems[name]
    if not names:
        raise MbmError(faults.no_problem(program.source))
    if len(names) > 1:
        raise MbmError(faults.several_problems(names))
    return program.problems[names[0]]


def effective_clauses(program: Program, problem: ProblemDefinition) -> tuple[Sequence, ...]:
    """The clauses of ``problem`` laid over those of the problems that it is like.

    A clause with the same head and name replaces (the same head where it has none); of clauses that list named entries
    (constants, unknowns, define, derive) the entries replace one by one.
    """
    chain = [problem]
    while chain[-1].like is not None:
        like = chain[-1].like
        if like.name not in program.problems:
            near = closest(like.name, program.problems)
            raise MbmError(language_faults.unknown_name(like.span, like.name, near))
        other = program.problems[like.name]
        if any(other is each for each in chain):
            names = [*(each.name for each in chain), like.name]
            raise MbmError(language_faults.circular_definition(like.span, tuple(names[names.index(like.name) :])))
        chain.append(other)
    wrong = [fault for each in chain for clause in each.clauses if (fault := _wrong_head(clause)) is not None]
    if wrong:
        raise MbmError(*wrong)
    clauses: tuple[Sequence, ...] = ()
    for each in reversed(chain):
        clauses = _lay_over(clauses, each.clauses)
    return clauses


def _wrong_head(clause: Sequence) -> Diagnostic | None:
    head = clause.head or ""
    if head not in CLAUSES:
        near = closest(head, CLAUSES)
        return faults.unknown_clause(clause.items[0].span, head, near, CLAUSES)
    return None


def _name(clause: Sequence) -> str | None:
    if clause.head in ("data", "pair", "camera", "defun", "observe") and len(clause.items) > 1:
        first = clause.items[1]
        if isinstance(first, Symbol):
            return first.name
    return None


def _lay_over(base: tuple[Sequence, ...], new: tuple[Sequence, ...]) -> tuple[Sequence, ...]:
    merged = {(c.head, _entry_name(item)) for c in new if c.head in _MERGED for item in c.items[1:]}
    replaced = {(c.head, _name(c)) for c in new if c.head not in _MERGED}
    kept = []
    for clause in base:
        if clause.head in _MERGED:
            items = tuple(item for item in clause.items[1:] if (clause.head, _entry_name(item)) not in merged)
            kept.append(Sequence(items=(clause.items[0], *items), bracket=clause.bracket, span=clause.span))
        elif (clause.head, _name(clause)) not in replaced:
            kept.append(clause)
    return (*kept, *new)


def _entry_name(item: object) -> str | None:
    return item.head if isinstance(item, Sequence) else None
