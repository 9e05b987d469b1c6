"""``:sigma unknown`` where the size of the residuals does not tell a scale: it becomes an unknown of the likelihood.

Limits, rounded readings and long tails have no s² = SSE/redundancy. ``(observe d … :sigma unknown :below …)`` says the
same as ``:sigma d-sigma`` beside ``(unknowns (d-sigma positive))``, and ``(unknown FORM :as NAME)`` as
``:sigma (* NAME FORM)``.
"""

from __future__ import annotations

from dataclasses import replace

from mbm.problem.reading.noise_structure import is_unknown, read_unknown_noise
from mbm.text.types import Bracket, Form, Keyword, MbmError, Sequence, Span, Symbol, symbols_of
from mbm.values import dataclass

_TOLD_BY_LIKELIHOOD = frozenset({"below", "above", "resolution"})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """An observation whose noise is unknown: FORM of ``(unknown FORM :as NAME)``, where they are stated."""

    form: Form | None
    shared: Symbol | None
    wants: bool
    span: Span


def with_scales(clauses: tuple[Sequence, ...]) -> tuple[Sequence, ...]:
    """The clauses with a scale among the unknowns for each observation that needs one; one for all of one name."""
    asked = {place: found for place, each in enumerate(clauses) if (found := _asked(each)) is not None}
    shared = {each.shared.name for each in asked.values() if each.wants and each.shared is not None}
    taken = {each.name for clause in clauses for each in symbols_of(clause)}
    scales: dict[str, Symbol] = {}
    made = list(clauses)
    for place, each in asked.items():
        if each.wants or (each.shared is not None and each.shared.name in shared):
            name = each.shared
            if name is None:
                name = Symbol(name=_free(f"{_called(clauses[place])}-sigma", taken), span=each.span)
            scales[name.name] = name
            made[place] = _with_scale(clauses[place], name, each)
    if not scales:
        return clauses
    heads = (Symbol(name="unknowns", span=next(iter(scales.values())).span),)
    declared = (_list(name, Symbol(name="positive", span=name.span)) for name in scales.values())
    return (*made, _list(*heads, *declared))


def _asked(clause: Sequence) -> _Asked | None:
    """What an observation says of unknown noise; None where it is none, or stated otherwise."""
    if clause.head != "observe":
        return None
    pairs = zip(clause.items, clause.items[1:], strict=False)
    options = {key.name: form for key, form in pairs if isinstance(key, Keyword)}
    if options.keys() & {"covariance", "information", "bound"}:
        return None
    law, sigma = options.get("distribution"), options.get("sigma")
    wants = bool(options.keys() & _TOLD_BY_LIKELIHOOD) or (isinstance(law, Sequence) and law.head == "student")
    if sigma is None or is_unknown(sigma):
        return _Asked(form=None, shared=None, wants=wants, span=clause.items[0].span if sigma is None else sigma.span)
    if not isinstance(sigma, Sequence) or sigma.head != "unknown":
        return None
    try:
        noise = read_unknown_noise(sigma)
    except MbmError:
        return None  # said where the clause is read
    return _Asked(form=noise.form, shared=noise.shared, wants=wants, span=sigma.span)


def _with_scale(clause: Sequence, scale: Symbol, asked: _Asked) -> Sequence:
    """The clause with the ``scale``, or the scale times FORM, as its standard deviation."""
    kept: list[Form] = []
    items = iter(clause.items)
    for item in items:
        if isinstance(item, Keyword) and item.name == "sigma":
            next(items, None)
        else:
            kept.append(item)
    if not asked.wants:  # readings that are no limits have the same likelihood
        kept += [Keyword(name="below", span=asked.span), Symbol(name="false", span=asked.span)]
    times = Symbol(name="*", span=asked.span)
    sigma = scale if asked.form is None else _list(times, scale, asked.form)
    return replace(clause, items=(*kept, Keyword(name="sigma", span=asked.span), sigma))


def _called(clause: Sequence) -> str:
    """The name of an observation, or of its table."""
    return next((each.name for each in clause.items[1:2] if isinstance(each, Symbol)), "observe")


def _free(name: str, taken: set[str]) -> str:
    """The name, or the first with a number behind it that nobody has; it is taken then."""
    number, found = 2, name
    while found in taken:
        found, number = f"{name}-{number}", number + 1
    taken.add(found)
    return found


def _list(first: Symbol, *items: Form) -> Sequence:
    return Sequence(items=(first, *items), bracket=Bracket.ROUND, span=first.span)
