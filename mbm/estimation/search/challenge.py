"""A start against the closed forms for all unknowns: where one of these leads lower, its minimum is the answer.

Where there is none, as for a camera of known distortion whose focal lengths are unknown, and the fit is worse than
stated noise lets expect, those for poses and rotations have a word, with all else as it was found: a board that is seen
turned round drags the camera with it, and is seen rightly even by that camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache, Kind
from mbm.equations.metric import rounding_at, steps_between
from mbm.equations.types import Floats, Minimum
from mbm.estimation.minimise.minimise import minimise, stopped
from mbm.estimation.minimise.native.minimum import compared_minimum
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.estimation.search.multistart import GIVEN as GIVEN_START, ORIGIN as LAST_WINDOW, RANDOM
from mbm.estimation.search.search import Found, Tally, alone, other_minimum
from mbm.estimation.search.starting import GIVEN, Beginning, blank_numbers
from mbm.estimation.settings import Settings
from mbm.estimation.starts.random_starts import costs
from mbm.problem.types import Method, Problem
from mbm.solver.decisions import takes_over, usual_cost, worth_following
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.starts.closed_forms.completion import Completion
    from mbm.solver.range_maps import RangeMaps

FROM_A_SAMPLE = 1e-2
"""Share of the cost by which an answer from a sample of the rows may lie above the minimum near it."""


def kind_of(equations: Assembled) -> Kind:
    """What decides whether there is a closed form, by which the cache remembers that there is none."""
    names = tuple(entry.unknown.name for entry in equations.layout.entries)
    return names, tuple(group.rows for group in equations.groups)


def uncompared(equations: Assembled, settings: Settings, origin: str) -> bool:
    """Whether closed forms for all unknowns may lead elsewhere than a start of that ``origin``.

    Where no number is stated, they were looked at when the start was made.
    """
    plain = not equations.lossy and not equations.constraints and settings.robust is None
    if settings.method is Method.CLOSED_FORM or not plain or equations.linear:
        return False
    if settings.method is Method.DIRECT_SEARCH or origin in (GIVEN, GIVEN_START, RANDOM, LAST_WINDOW):
        return True
    layout = equations.layout
    return bool((equations.sought() & ~np.isnan(layout.start) & ~layout.guessed).any())


class Challenge:
    """What closed forms for all unknowns that equations mention have to say against a start.

    That no closed form is made for such equations is remembered in ``cache``, for the data sets to come. It is learnt
    from data that were solved only, and not relied on where a fit is worse than stated noise lets expect: what closed
    forms recognise is found by probing the data, and one that fails on these may succeed on the next.
    """

    def __init__(
        self,
        equations: Assembled,
        settings: Settings,
        problem: Problem,
        cache: EvaluationCache,
        ranges: Callable[[], RangeMaps | None] = lambda: None,
    ) -> None:
        """``ranges`` gives those that were recognised in data sets before, if they give all numbers."""
        self._equations = equations
        self._settings = settings
        self._problem = problem
        self._cache = cache
        self._ranges = ranges
        self._kind = kind_of(equations)
        self._led: Minimum | None = None

    def anticipated(self, starts: Sequence[Beginning]) -> Found | None:
        """What a closed form leads to, where it spares a long way from the one start that is stated; else None.

        Of large sparse equations, if the closed form is the only one and costs less than the start, and what it leads
        to fits as well as stated noise lets expect. Not beside errors in columns: most of these have no long way, but
        another way to write the same fit (a line turned round), of which the start chooses one.
        """
        if self._problem.estimates_noise or not sparse_suits(self._equations) or self._equations.implicit is not None:
            return None
        if len(starts) != 1 or starts[0].origin != GIVEN or not uncompared(self._equations, self._settings, GIVEN):
            return None
        form = self._form
        if form is None or form.several or not form.cost < costs(self._equations, starts[0].point[None])[0]:
            return None
        self._led = led = minimise(self._equations, form.numbers, self._settings, self._problem.span)
        if not led.reason.converged or not led.cost < self._most:
            return None
        return Found(
            minimum=led,
            alternatives=(),
            tally=None,
            origin=form.origin,
            iterations=led.iterations,
            evaluations=led.evaluations,
        )

    def compared(self, starts: Sequence[Beginning]) -> Found | None:
        """What the one stated start leads to, where ranges that were recognised before lead nowhere else.

        None: this is not known; all is to be looked at.
        """
        equations, settings = self._equations, self._settings
        if len(starts) != 1 or not settings.iterative or not uncompared(equations, settings, starts[0].origin):
            return None
        if self._kind in self._cache.without_closed_form or sparse_suits(equations):
            return None
        ranges = self._ranges()
        if ranges is None:
            return None
        found = compared_minimum(equations, starts[0].point, settings, ranges, stopped(settings))
        return None if found is None or not found.reason.converged else alone(found, starts[0].origin)

    def answered(self, found: Found) -> Found:
        """``found``, or what a closed form leads to where that is a better fit.

        What a closed form makes of a sample of very many rows is followed if it costs hardly more than what was found.
        """
        if not uncompared(self._equations, self._settings, found.origin):
            return found
        minimum = found.minimum
        solved = minimum.reason.converged and bool(np.isfinite(minimum.cost))
        if solved and self._kind in self._cache.without_closed_form and minimum.cost < self._most:
            return found
        form = self._form
        if form is None:
            if solved and not self._recognised:
                self._cache.without_closed_form.add(self._kind)
            form = None if solved and minimum.cost < self._most else self._poses_anew(minimum)
        if form is None:
            return found
        rounding = rounding_at(self._equations, minimum)
        away = self._away(minimum, form.numbers)
        promising = worth_following(minimum.cost, form.cost / form.allowance, away, self._most, rounding)
        if not np.isfinite(form.cost) or (minimum.reason.converged and not promising and self._led is None):
            return found
        other = self._led
        if other is None:
            other = minimise(self._equations, form.numbers, self._settings, self._problem.span)
        rescued = not minimum.reason.converged and other.cost <= minimum.cost
        worked = replace(
            found, iterations=found.iterations + other.iterations, evaluations=found.evaluations + other.evaluations
        )
        beaten = rescued or takes_over(minimum.cost, other.cost, rounding)
        return _beaten(self._equations, worked, other, form.origin) if beaten else worked

    @cached_property
    def _reached(self) -> tuple[bool, tuple[Completion, ...]]:
        """How far closed forms for all unknowns get; whether they were made of a sample of the rows."""
        return self._completed(blank_numbers(self._equations))

    def _completed(self, every: Sequence[Floats]) -> tuple[bool, tuple[Completion, ...]]:
        """How far closed forms get from each of some numbers (N,); whether they were made of a sample of the rows."""
        # Loaded where a start is challenged only, so that other problems start at once.
        from mbm.estimation.starts.closed_forms.completion import completions
        from mbm.estimation.starts.closed_forms.rows import ENOUGH
        from mbm.estimation.starts.closed_forms.types import Situation

        situations = [
            Situation(layout=self._equations.layout, groups=self._equations.groups, numbers=numbers, most=ENOUGH)
            for numbers in every
        ]
        reached = [completions(situation, self._settings.closed_forms) for situation in situations]
        return situations[0].thins, tuple(each for found in reached for each in found)

    @property
    def _recognised(self) -> bool:
        return any(c.recognised for c in self._reached[1])

    @cached_property
    def _form(self) -> _Form | None:
        """The best of the closed forms that give all numbers; None: there is none."""
        return self._best_of(*self._reached)

    def _poses_anew(self, minimum: Minimum) -> _Form | None:
        """The best of the closed forms that give all poses and rotations, the rest being as at a minimum."""
        layout, sought = self._equations.layout, self._equations.sought()
        turned = {int(number) for each in layout.curved for number in each.numbers[:, 0]}
        numbers = minimum.point.copy()
        for entry in layout.entries:
            if not turned.isdisjoint(range(entry.range.start, entry.range.stop)):
                numbers[entry.range] = np.where(sought[entry.range], np.nan, numbers[entry.range])
        unknown = np.isnan(numbers)
        if not bool(unknown.any()) or bool(unknown[sought].all()):
            return None
        return self._best_of(*self._completed([numbers]))

    def _best_of(self, thins: bool, reached: Sequence[Completion]) -> _Form | None:
        complete = [c for c in reached if not bool(np.isnan(c.numbers).any())]
        if not complete:
            return None
        fits = costs(self._equations, np.stack([c.numbers for c in complete]))
        best = int(np.argmin(fits))
        return _Form(
            numbers=complete[best].numbers,
            cost=float(fits[best]),
            origin="; ".join(complete[best].used),
            several=len(complete) > 1,
            allowance=1.0 + FROM_A_SAMPLE if thins else 1.0,
        )

    def _away(self, minimum: Minimum, point: Floats) -> float:
        """How far a point is from a minimum, by the curvature there.

        Not known where numbers do not vary by addition, nor asked for in large sparse equations, where a search in vain
        takes long.
        """
        equations = self._equations
        if equations.layout.curved or sparse_suits(equations):
            return np.nan
        step = steps_between(equations.layout, equations.free, minimum.point, point)
        return float(np.square(minimum.jacobian @ step).sum())

    @property
    def _most(self) -> float:
        """What the cost stays below where stated noise explains it; infinite where no noise is stated."""
        freedom = self._equations.count - self._equations.dimension
        return np.inf if self._problem.estimates_noise else usual_cost(float(freedom))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Form:
    """A point (N,) from closed forms, and what it costs; ``several``: they give others, too.

    ``allowance``: by which factor it may lie above the minimum near it.
    """

    numbers: Floats
    cost: float
    origin: str
    several: bool
    allowance: float


def _beaten(equations: Assembled, found: Found, other: Minimum, origin: str) -> Found:
    """A better minimum, which one more start has led to; what was the best before is another solution."""
    if found.tally is None:
        return replace(found, minimum=other, origin=origin)
    former = other_minimum(equations, found.minimum, found.tally.best_found)
    converged = int(other.reason.converged)
    return replace(
        found,
        minimum=other,
        origin=origin,
        alternatives=(former, *found.alternatives) if found.minimum.reason.converged else found.alternatives,
        tally=Tally(tried=found.tally.tried + 1, converged=found.tally.converged + converged, best_found=1),
    )
