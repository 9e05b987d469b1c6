"""How far a number goes along a line between places where it is known: to a maximum, to where it has no value, or
without end, as a quotient whose divisor becomes 0 or a logarithm of what does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.types import Floats

ROUNDS, WITHIN = 12, 16
"""Each round looks at so many places between the neighbours of the best so far: 1e-12 of the line in the end."""

AGAIN = 0.3
"""Share of what the first half of the rounds gain that the second half gain of what grows without end. At a logarithm
they gain as much, at the end of a fourth root a hundredth, and at a maximum nothing."""

NOT_ROUNDED = 1e-6
"""Share of what is reached that two rounds gain if it is no rounding. Near a smooth maximum each round leaves a
seventieth of what the one before left, and without end none gains less than the one before."""


@np.errstate(all="ignore")
def farthest(value: Callable[[Floats], Floats], places: Floats, found: Floats) -> tuple[float, float]:
    """The most that a number reaches, infinite if it grows without end, and about where.

    ``found`` (p,) is it at ascending ``places`` (p,), NaN where it has no value; ``value`` gives it at others.
    """
    reached = []
    for _ in range(ROUNDS):
        best = int(np.argmax(np.where(np.isnan(found), -np.inf, found)))
        reached.append(float(found[best]))
        beside = found[max(best - 1, 0)], found[min(best + 1, len(found) - 1)]
        if len(reached) > 2 and reached[-1] - reached[-3] <= NOT_ROUNDED * abs(reached[-1]):
            break
        if not np.isfinite(reached[-1]) or np.min(beside) == reached[-1]:
            break
        low, high = places[max(best - 1, 0)], places[min(best + 1, len(places) - 1)]
        places = np.sort(np.append(np.linspace(low, high, WITHIN + 2), places[best]))
        found = value(places)
    gains = np.diff(reached)
    if len(gains) == ROUNDS - 1:
        first, last = gains[: ROUNDS // 2].sum(), gains[ROUNDS // 2 :].sum()
        if last > max(AGAIN * first, NOT_ROUNDED * abs(reached[-1])):
            return np.inf, float(places[int(np.nanargmax(found))])
    return reached[-1], float(places[int(np.argmax(np.where(np.isnan(found), -np.inf, found)))])
