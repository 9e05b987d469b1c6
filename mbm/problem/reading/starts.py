"""``:starts`` of the solve: where the search for the best minimum begins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from mbm.language import faults as language_faults
from mbm.language.coerce import integer
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.options import split_options
from mbm.problem.reading.unknowns import Declaration, stated_numbers
from mbm.problem.types import GivenStarts, RandomStarts
from mbm.text.types import Form, MbmError, Sequence, Symbol

STARTS_USAGE = ":starts (random 100 [:seed 1]) | (given ((name value)…)…)"
MAXIMUM_STARTS = 100_000
LARGEST_SEED = 2**63 - 1


def read_starts(
    work: Workspace, form: Form | None, declarations: Iterable[Declaration]
) -> RandomStarts | GivenStarts | None:
    """The starts that ``:starts`` asks for; None where it is left out.

    Raises:
        MbmError: it asks for none, for too many, or for values of what is no unknown.

    """
    if form is None:
        return None
    if isinstance(form, Sequence) and form.head == "random":
        return _random(work, form)
    if isinstance(form, Sequence) and form.head == "given":
        return _given(work, form, {d.name.name: d for d in declarations})
    message = f"`{form.span.text}` says nothing about where to start"
    raise MbmError(language_faults.bad_form(form.span, message, STARTS_USAGE))


def _random(work: Workspace, form: Sequence) -> RandomStarts:
    options = split_options(form.items[1:], form.span, owner="`random`", known=("seed",))
    if len(options.positional) != 1:
        raise MbmError(language_faults.bad_form(form.span, "`random` takes the number of starts", STARTS_USAGE))
    count = _whole(work, options.positional[0], 1, MAXIMUM_STARTS, "the number of starts")
    seed = options.get("seed")
    return RandomStarts(count=count, seed=None if seed is None else _whole(work, seed, 0, LARGEST_SEED, "`:seed`"))


def _whole(work: Workspace, form: Form, low: int, high: int, name: str) -> int:
    value = integer(work.evaluator.wanted(form, work.scope), form.span, f"{name} (a whole number)")
    if not low <= value <= high:
        raise MbmError(language_faults.bad_form(form.span, f"{name} should lie in {low} … {high}", STARTS_USAGE))
    return value


def _given(work: Workspace, form: Sequence, declarations: Mapping[str, Declaration]) -> GivenStarts:
    if len(form.items) == 1:
        raise MbmError(language_faults.bad_form(form.span, "`given` lists no start", STARTS_USAGE))
    return GivenStarts(starts=tuple(_start(work, start, declarations) for start in form.items[1:]))


def _start(work: Workspace, form: Form, declarations: Mapping[str, Declaration]) -> Mapping[str, tuple[float, ...]]:
    """The values of one start by name, one number for each component in SI."""
    if not isinstance(form, Sequence) or not form.items:
        raise MbmError(language_faults.bad_form(form.span, "a start is a list of (name value)", STARTS_USAGE))
    found: dict[str, tuple[float, ...]] = {}
    for entry in form.items:
        if not isinstance(entry, Sequence) or len(entry.items) != 2 or not isinstance(entry.items[0], Symbol):
            raise MbmError(language_faults.bad_form(entry.span, "a start is a list of (name value)", STARTS_USAGE))
        name, given = entry.items[0].name, entry.items[1]
        declaration = declarations.get(name)
        if declaration is None:
            raise MbmError(faults.unknown_override(name, tuple(declarations), entry.items[0].span))
        value = work.evaluator.wanted(given, work.scope)
        found[name] = tuple(float(n.value) for n in stated_numbers(declaration, value, given.span))
    return MappingProxyType(found)
