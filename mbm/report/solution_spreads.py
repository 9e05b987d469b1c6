"""What a solution knows of the standard deviations that it reports, for their intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.layout import Entry, half_turns
from mbm.equations.spreads import Followed
from mbm.estimation.search.solution import DerivedSolution, Solution
from mbm.problem.types import UnknownKind
from mbm.report.spreads import Floats, Spread

Ends = Callable[[float], tuple[Floats, Floats]]


def coordinate_spread(solution: Solution) -> Spread:
    """That of all coordinates (M,) of the unknowns."""
    limits, followed = solution.limited, solution.profiles()

    def every(values: Floats, other: float) -> Floats:
        whole = np.full(len(solution.layout.number), other)
        whole[solution.free] = values
        return whole

    found = Spread(
        dof=every(solution.freedom.dof, np.inf),
        inflation=every(solution.freedom.inflation, 1.0),
        ends=None if followed is None else _ends(followed.of_coordinates, lambda values: every(values, np.nan)),
    )
    if limits is None:
        return found
    return replace(
        found,
        lower=every(limits.lower, -np.inf),
        upper=every(limits.upper, np.inf),
        step=every(limits.step, np.nan),
        free=every(limits.sigma, np.nan),
    )


def entry_spread(solution: Solution, every: Spread, entry: Entry, shape: tuple[int, ...]) -> Spread:
    """That of an unknown, of the ``shape`` of its sigmas; limits of angles stand about the value that is reported."""
    found = every.at(entry.coordinates).shaped(shape)
    if every.ends is not None:
        found = replace(found, ends=_ends(every.ends, lambda values: values[entry.coordinates].reshape(shape)))
    if entry.unknown.kind is not UnknownKind.ANGLE or found.lower is None or found.upper is None:
        return found
    numbers = solution.numbers[entry.range].reshape(shape)
    turned = half_turns(numbers) - numbers
    return replace(found, lower=found.lower + turned, upper=found.upper + turned)


def derived_spread(solution: Solution, one: DerivedSolution, shape: tuple[int, ...]) -> Spread:
    """That of a derived quantity, of the ``shape`` of its sigmas."""
    followed = solution.profiles()
    found = Spread(dof=one.freedom.dof, inflation=one.freedom.inflation).shaped(shape)
    return found if followed is None else replace(found, ends=_ends_of_derived(followed, one.owner, shape))


def _ends_of_derived(followed: Followed, owner: int, shape: tuple[int, ...]) -> Ends:
    return _ends(lambda level: followed.of_derived(owner, level), lambda values: values.reshape(shape))


def _ends(followed: Ends, change: Callable[[Floats], Floats]) -> Ends:
    """The same ends in other arrays."""

    def ends(level: float) -> tuple[Floats, Floats]:
        below, above = followed(level)
        return change(below), change(above)

    return ends
