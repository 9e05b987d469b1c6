"""Unknown numbers → values, by one closed form after the other: each makes more numbers known to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field, replace

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.types import Candidate, ClosedForm, Plan, Situation, Support
from mbm.solver.decisions import plausible
from mbm.values import dataclass

MOST_BRANCHES = 16
"""Combinations of solutions that are followed where closed forms have several."""

SAME_COSTS = 1e-6
"""Difference of costs, relative and absolute, below which solutions stay in the order in which they were given."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Completion:
    """Numbers (N,), NaN where no closed form applied, and what was used, in words.

    ``recognised``: a closed form is made for some of the numbers that are not known, but gave none.
    """

    numbers: Floats
    used: tuple[str, ...]
    recognised: bool = False


def completions(situation: Situation, forms: Iterable[ClosedForm]) -> tuple[Completion, ...]:
    """What the closed forms make of the unknown numbers, the better fitting solutions first; at least one."""
    every, parts = tuple(forms), linked_parts(situation)
    open_ones = [(Completion(numbers=situation.numbers, used=()), situation, Tried(parts=parts))]
    finished: list[Completion] = []
    while open_ones:
        each, before, tried = open_ones.pop(0)
        if not bool(np.isnan(each.numbers).any()):
            finished.append(each)
            continue
        here = before.with_numbers(each.numbers)
        steps, recognised = _steps(here, every, tried)
        room = MOST_BRANCHES - len(open_ones) - len(finished)
        if not steps:
            finished.append(replace(each, recognised=recognised))
        for numbers, used in steps[: max(room, 1)]:
            more = Completion(numbers=numbers, used=tuple(dict.fromkeys((*each.used, *used))))
            open_ones.append((more, here, tried if len(steps) == 1 else tried.copied()))
    return tuple(sorted(finished, key=lambda c: int(np.isnan(c.numbers).sum())))


def plans(situation: Situation, forms: Iterable[ClosedForm]) -> Iterator[Plan]:
    """The closed forms that fit some of the unknown numbers, and have rows to begin from that have values."""
    every = tuple(forms)
    for candidate in situation.candidates():
        yield from _plans_of(candidate, every)


def _plans_of(candidate: Candidate, forms: tuple[ClosedForm, ...]) -> Iterator[Plan]:
    together = candidate.coupled or candidate.paired
    for form in forms:
        plan = _recognised(form, candidate) if form.joint or not together else None
        if plan is not None and len(plan.rows):
            yield plan


def _recognised(form: ClosedForm, candidate: Candidate) -> Plan | None:
    """What a form ``recognises``; nothing where it meets a singular matrix (Euler angles that were probed upright)."""
    try:
        return form.recognises(candidate.situation, candidate)
    except np.linalg.LinAlgError:
        return None


@dataclass(slots=True, kw_only=True, eq=False)
class Tried:
    """Candidates that no closed form gave numbers for, and whether one is made for them; ``parts`` as `linked_parts`.

    They are not tried again until more is known of what their equations hold: a chain of n unknowns takes n steps.
    """

    parts: Mapping[str, int]
    known: dict[Support, tuple[bytes, bool]] = field(default_factory=dict)

    def copied(self) -> Tried:
        """For another branch, in which other numbers become known."""
        return replace(self, known=dict(self.known))


Step = tuple[Floats, tuple[str, ...]]
"""Numbers (N,) of which more are known, and the closed forms that gave these, in words."""


def _steps(situation: Situation, forms: tuple[ClosedForm, ...], tried: Tried) -> tuple[list[Step], bool]:
    """The numbers after the first closed form that gives any, and whether there is one that gives none before it.

    One vector for each of its solutions, best first. Where there is one, closed forms for unknowns that no equation
    links with those before are taken in the same step: what they give does not depend on the order. One that takes
    several unknowns together, or has several solutions, waits for the next step, and all that is linked with it.
    """
    recognised = False
    numbers, used = situation.numbers, list[str]()
    closed: set[int] = set()

    def parts_of(support: Support) -> set[int]:
        return {tried.parts[situation.layout.entries[entry].unknown.name] for entry in support.entries}

    def wanted(support: Support) -> bool:
        nonlocal recognised
        if closed and parts_of(support) & closed:
            return False
        state, made = tried.known.get(support, (b"", False))
        if state != situation.absences(support):
            return True
        recognised |= made
        return False

    for candidate in situation.candidates(wanted):
        made = False
        for plan in _plans_of(candidate, forms):
            if used and plan.form.joint:
                closed |= parts_of(candidate.support)
                break
            answers = _answers(plan)
            made = True
            if not answers:
                continue
            if len(answers) == 1 and not plan.form.joint:
                numbers = _filled(numbers, *answers[0])
                used.append(plan.description)
            elif not used:
                return [(_filled(numbers, *answer), (plan.description,)) for answer in answers], recognised
            closed |= parts_of(candidate.support)
            break
        else:
            recognised |= made
            tried.known[candidate.support] = (situation.absences(candidate.support), made)
    return [(numbers, tuple(used))] if used else [], recognised


def _answers(plan: Plan) -> list[tuple[Indices, Floats]]:
    """The solutions of a closed form, best first: places in the vector of all numbers, and values.

    Of a family, the best solution of each member.
    """
    if plan.form.joint:
        whole = plan.solved(np.arange(len(plan.rows))[None])[0]
        return [(plan.candidate.places.ravel(), w) for w in whole if bool(np.isfinite(w).any())]
    solved = solutions(plan)
    known = finite(solved, 2)
    ranks = range(solved.shape[1] if plan.candidate.members == 1 else 1)
    each = [(plan.candidate.places[known[:, rank]], solved[known[:, rank], rank]) for rank in ranks]
    return [(places, values) for places, values in each if places.size]


def _filled(numbers: Floats, places: Indices, values: Floats) -> Floats:
    filled = numbers.copy()
    filled[places] = values
    return filled


def linked_parts(situation: Situation) -> dict[str, int]:
    """Unknowns by name → a number, the same for unknowns that measured equations link, also by way of others."""
    number_of = situation.layout.number_of()
    above = list(range(len(number_of)))

    def top(number: int) -> int:
        while above[number] != number:
            above[number] = above[above[number]]
            number = above[number]
        return number

    for group in situation.observations():
        linked = [top(number_of[slot.unknown]) for slot in group.kernel.variables]
        for number in linked:
            above[top(number)] = top(linked[0])
    return {name: top(number) for name, number in number_of.items()}


def solutions(plan: Plan) -> Floats:
    """The solutions of each member (K, S, s) from all its rows, best first; NaN where there are none.

    Those beyond hard bounds are moved to these; those that fit much worse than the best are left out.
    """
    members = plan.candidate.members
    rows_of = _by_member(plan.rows.member, members)
    counts = np.array([len(rows) for rows in rows_of])
    parts: list[tuple[Indices, Floats]] = []
    for count in np.unique(counts[counts >= plan.minimal]):
        which = np.flatnonzero(counts == count)
        subsets = np.stack([rows_of[m] for m in which])
        parts.append((which, plan.solved(subsets)))
    width = max((part.shape[1] for _, part in parts), default=1)
    found = np.full((members, width, plan.candidate.places.shape[1]), np.nan)
    for which, part in parts:
        found[which, : part.shape[1]] = part
    return _ranked(plan, found)


def _by_member(member: Indices, count: int) -> list[Indices]:
    order = np.argsort(member, kind="stable")
    return np.split(order, np.searchsorted(member[order], np.arange(1, count)))


def _ranked(plan: Plan, found: Floats) -> Floats:
    members, width, _ = found.shape
    found, usable = _within_bounds(plan.candidate, found)
    costs = np.full((members, width), np.inf)
    for rank in range(width):
        with np.errstate(all="ignore"):
            values = plan.rows.values(found[plan.rows.member, rank])
        squares = np.square(values).sum(axis=1) * plan.rows.weight
        costs[:, rank] = np.bincount(plan.rows.member, weights=squares, minlength=members)
    usable &= np.isfinite(costs)
    costs = np.where(usable, costs, np.inf)
    best = costs.min(axis=1, keepdims=True)
    dropped = ~usable | ~np.vectorize(plausible, otypes=[bool])(costs, best)
    with np.errstate(invalid="ignore"):
        alike = np.where(costs <= best * (1 + SAME_COSTS) + SAME_COSTS, best, costs)
    order = np.argsort(np.where(dropped, np.inf, alike), axis=1, kind="stable")
    found = np.where(dropped[..., None], np.nan, found)
    return np.take_along_axis(found, order[..., None], axis=1)


def _within_bounds(candidate: Candidate, found: Floats) -> tuple[Floats, Mask]:
    """Solutions (K, S, s) moved to the bounds that they lie beyond, and which of them are some (K, S)."""
    usable = finite(found, 2)
    if not candidate.flat:
        return found, usable
    layout = candidate.situation.layout
    lower = layout.lower[candidate.coordinates][:, None]
    upper = layout.upper[candidate.coordinates][:, None]
    turning = candidate.angles & np.isfinite(lower) & np.isfinite(upper)
    with np.errstate(invalid="ignore"):
        middle = (lower + upper) / 2
        turned = middle + np.remainder(found - middle + np.pi, 2 * np.pi) - np.pi
        found = np.clip(np.where(turning, turned, found), lower, upper)
        usable &= (~layout.positive[candidate.coordinates][:, None] | (found > 0)).all(axis=2)
    return found, usable
