"""A problem's clauses in order, with those of the problem that it is ``:like``; and what stands in one.

A clause is a head, positional forms and keyword options.
"""

from __future__ import annotations

from collections.abc import Mapping

from mbm.expression.units import Unit, parse_unit, refused_unit
from mbm.language import faults as language_faults
from mbm.language.session import ProblemDefinition, Program
from mbm.problem import faults
from mbm.text.suggest import closest, listed, suggestion
from mbm.text.types import Diagnostic, Form, Keyword, MbmError, Sequence, Span, Symbol, Text
from mbm.values import dataclass

STATES, CAMERA = "states", "camera"
"""The clauses that declare states, and a camera."""

_LAST_NAME = {STATES: None, CAMERA: 2}
"""Behind which of its forms a clause declares no more names."""

ANY_NAME = ""
"""What a clause declares that fails for want of a name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What stands in a clause after its head."""

    positional: tuple[Form, ...]
    keywords: Mapping[str, Form]
    repeated: Mapping[str, tuple[Form, ...]]
    places: Mapping[str, Span]
    span: Span

    def get(self, name: str) -> Form | None:
        """The form behind ``:name``, or None."""
        return self.keywords.get(name)


def split_options(
    items: tuple[Form, ...],
    span: Span,
    *,
    owner: str,
    known: tuple[str, ...],
    repeatable: tuple[str, ...] = (),
    not_yet: Mapping[str, str] | None = None,
    alone: str | None = None,
) -> Options:
    """Sort ``items`` into positional forms and ``:keyword value`` pairs.

    ``alone`` is the usage of an owner that takes options only.

    Raises:
        MbmError: an option that is unknown, given twice, without a value, or not available yet; a form beside options
            that stand alone.

    """
    later = not_yet or {}
    positional: list[Form] = []
    keywords: dict[str, Form] = {}
    repeated: dict[str, list[Form]] = {}
    places: dict[str, Span] = {}
    position = 0
    while position < len(items):
        item = items[position]
        if not isinstance(item, Keyword):
            positional.append(item)
            position += 1
            continue
        if item.name in later:
            raise MbmError(language_faults.not_available_yet(item.span, f"`:{item.name}`", later[item.name]))
        if item.name not in known and item.name not in repeatable:
            near = closest(item.name, known)
            raise MbmError(language_faults.unknown_keyword(item.span, item.name, owner, (near,) if near else known))
        if position + 1 >= len(items) or isinstance(items[position + 1], Keyword):
            raise MbmError(language_faults.missing_keyword_value(item.span, item.name))
        if item.name in repeatable:
            repeated.setdefault(item.name, []).append(items[position + 1])
        elif item.name in keywords:
            raise MbmError(language_faults.duplicate_definition(item.span, f":{item.name}", places[item.name]))
        else:
            keywords[item.name] = items[position + 1]
        places[item.name] = item.span
        position += 2
    if alone is not None and positional:
        raise MbmError(language_faults.bad_form(positional[0].span, f"{owner} takes options only", alone))
    return Options(
        positional=tuple(positional),
        keywords=keywords,
        repeated={k: tuple(v) for k, v in repeated.items()},
        places=places,
        span=span,
    )


def only(clauses: list[Sequence], name: str) -> Sequence | None:
    """The clause that may stand once in a problem; None where there is none.

    Raises:
        MbmError: it stands several times.

    """
    for other in clauses[1:]:
        raise MbmError(language_faults.duplicate_definition(other.span, name, clauses[0].span))
    return clauses[0] if clauses else None


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


_PRIOR = "priors stand in `constraints`: `(constraints (normal x 0 1))`"
_EQUATION = "equations stand in `observe`, or without noise in `constraints`"
_STANDS_IN = {
    **dict.fromkeys(("prior", "priors", "normal", "uniform", "rectangular", "triangular"), _PRIOR),
    **dict.fromkeys(("=", "<=", ">="), _EQUATION),
}
"""Where what is often written as a clause belongs."""


def _wrong_head(clause: Sequence) -> Diagnostic | None:
    head = clause.head or ""
    if head not in CLAUSES:
        mend = _STANDS_IN.get(head) or suggestion(head, CLAUSES, f"the clauses are {listed(CLAUSES)}")
        return faults.unknown_clause(clause.items[0].span, head, mend)
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


def stated_unit(form: Form) -> Unit:
    """The unit behind ``:unit``: ``m``, ``m/s``, ``"1/s"``."""
    if isinstance(form, Symbol):
        text = form.name
    elif isinstance(form, Text):
        text = form.value
    else:
        text = form.span.text
    unit = parse_unit(text)
    if unit is None:
        raise MbmError(language_faults.unknown_unit(form.span, text, refused_unit(text)))
    return unit


def declared_names(form: Form) -> set[str]:
    """The names that a declaration or a clause declares, `ANY_NAME` where they are missing."""
    names = {name for name in (_declared(form),) if name}
    if not isinstance(form, Sequence) or form.head not in _LAST_NAME:
        return names
    inside = {name for each in form.items[1 : _LAST_NAME[form.head]] if (name := _declared(each))}
    return names | (inside or {ANY_NAME})


def _declared(form: Form) -> str | None:
    """The name that a declaration begins with, or would, had its list not been forgotten."""
    if isinstance(form, Text):
        return form.value
    return form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
