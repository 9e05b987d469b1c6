"""Samples → estimate, standard deviation and coverage intervals (GUM Supplement 1, clauses 7.5 to 7.9 and 8)."""

from __future__ import annotations

from dataclasses import fields
from math import ceil, isfinite, sqrt

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.values import dataclass

DIGITS = 2
"""Digits of a standard deviation that are meaningful."""

LEAST_BLOCK = 10_000
"""Trials of a block at least (7.9.4 a)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spreads:
    """Of samples (T, S): arrays (S,). The ``interval`` is probabilistically symmetric; both are (S, 2).

    ``chance`` (S, 2, 2) has for each of its ends where it may lie: the order statistics three standard deviations of
    their rank below and above.
    """

    mean: Floats
    sigma: Floats
    median: Floats
    interval: Floats
    shortest: Floats
    chance: Floats

    def of(self, columns: slice) -> Spreads:
        """Those of some of the scalars."""
        return Spreads(**{each.name: getattr(self, each.name)[columns] for each in fields(self)})


@np.errstate(all="ignore")
def spreads(samples: Floats, level: float) -> Spreads:
    """What samples (T, S) say at a level of coverage, by their order (7.6, 7.7)."""
    ordered = np.sort(samples, axis=0)
    count = len(ordered)
    held = min(max(int(level * count + 0.5), 1), count - 1) if count > 1 else 0
    first = max(int((count - held + 1) / 2), 1) - 1
    widths = ordered[held:] - ordered[: count - held]
    best = np.argmin(widths, axis=0)
    columns = np.arange(samples.shape[1])
    last = min(first + held, count - 1)
    reach = ceil(3.0 * sqrt(count * (1.0 - level) / 2.0 * (1.0 + level) / 2.0))
    ranks = np.clip([[first - reach, first + reach], [last - reach, last + reach]], 0, max(count - 1, 0))
    return Spreads(
        mean=samples.mean(axis=0),
        sigma=samples.std(axis=0, ddof=1) if count > 1 else np.full(samples.shape[1], np.nan),
        median=np.median(ordered, axis=0),
        interval=np.stack([ordered[first], ordered[last]], axis=1),
        shortest=np.stack([ordered[best, columns], ordered[best + held, columns]], axis=1),
        chance=np.moveaxis(ordered[ranks], 2, 0),
    )


def block_size(level: float) -> int:
    """Trials of a block (7.9.4 a): a hundred beyond an interval at least."""
    return max(ceil(100.0 / (1.0 - level)), LEAST_BLOCK)


def tolerances(sigma: Floats) -> Floats:
    """Half a unit of the last of the meaningful digits of standard deviations (S,) (7.9.2); 0 where nothing varies."""
    return np.array([_tolerance(each) for each in np.ravel(sigma).tolist()])


def _tolerance(sigma: float) -> float:
    if not (isfinite(sigma) and sigma > 0.0):
        return 0.0
    exponent = int(f"{sigma:.{DIGITS - 1}e}".partition("e")[2]) - (DIGITS - 1)
    return 0.5 * 10.0**exponent


def scatter(blocks: list[Spreads]) -> Spreads:
    """The standard deviations of the means of what h blocks say (7.9.4 f); infinite of one block."""
    count = len(blocks)
    found = {}
    for each in fields(Spreads):
        parts = np.stack([getattr(block, each.name) for block in blocks])
        found[each.name] = parts.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.full(parts.shape[1:], np.inf)
    return Spreads(**found)


def wanting(scattering: Spreads, tolerance: Floats, *, moments: bool) -> Floats:
    """By how much (S,) twice the scatter of the results exceeds the tolerance; at most 1 where they have settled.

    ``moments``: mean and standard deviation exist.
    """
    parts = [scattering.median, *scattering.interval.T]
    if moments:
        parts = [scattering.mean, scattering.sigma, *scattering.interval.T]
    worst = np.max(np.stack(parts), axis=0)
    still = worst == 0.0
    return np.where(
        still, 0.0, 2.0 * worst / np.where(still | (tolerance > 0.0), np.maximum(tolerance, 1e-300), 1e-300)
    )


def validated(linear: Floats, found: Spreads) -> Mask:
    """Whether linear intervals (S, 2) agree with the symmetric ones to the meaningful digits (8.2), wherever within its
    chance the end of the latter is.
    """
    tolerance = tolerances(found.sigma)[:, None]
    inside = (linear >= found.chance[..., 0] - tolerance) & (linear <= found.chance[..., 1] + tolerance)
    return np.asarray(inside.all(axis=1))
