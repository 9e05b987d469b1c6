"""Intervals where curvature misplaces the linear ones: as far as the cost, least over all else, stays low enough.

Of coordinates and of derived quantities alike the profile of the cost is followed to where it has grown by k² variances
(Bates and Watts 1988, Nonlinear Regression Analysis, chapter 6).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.spreads import Freedom, Moved
from mbm.equations.types import Floats
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.curvature import Curvature, flat_reach, followed_ends, most_followed
from mbm.estimation.trust.nonlinearity import OF_LIKELIHOODS, TOLERATED
from mbm.estimation.uncertainty.student import coverage_factors
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.coverage.likelihood import Likelihood, Own

ACCURACY = 1e-3
"""Relative accuracy of an end."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profiles:
    """Intervals by profile around a minimum: of coordinates with the ``freedom`` (n,), of quantities with ``derived``.

    Both answer how far the ends of intervals of a level lie below and above; NaN where the linear interval is right,
    infinite where there is no end. The ``lock`` is that of a `Solution`. ``scaled``: one scale of a likelihood is an
    unknown, which the profile follows too. ``likelihood`` is that beside limits (None: none hold or cut anything).
    """

    curvature: Curvature | None
    sigma: Floats
    freedom: Freedom
    derived: Mapping[int, DerivedSolution]
    lock: AbstractContextManager[object]
    scaled: bool = False
    likelihood: Likelihood | None = None
    _found: dict[tuple[int | None, float], tuple[Floats, Floats]] = field(default_factory=dict)

    def of_coordinates(self, level: float) -> tuple[Floats, Floats]:
        """Those of the coordinates (n,)."""
        return self._once(None, level, lambda: self._coordinates(level))

    def of_derived(self, owner: int, level: float) -> tuple[Floats, Floats]:
        """Those of all numbers of a derived quantity."""
        return self._once(owner, level, lambda: self._numbers(owner, level))

    def free_steps(self) -> Floats:
        """The steps (n,) to where the coordinates would be without the limits that hold them; NaN: not known."""
        return np.zeros(len(self.sigma)) if self.likelihood is None else self.likelihood.free_steps()

    def beside(self, moved: Moved) -> Profiles:
        """The same with uncertain constants, which move the coordinates."""
        likelihood = None if self.likelihood is None else replace(self.likelihood, moved=moved)
        return replace(self, likelihood=likelihood, _found={})

    def _once(
        self, owner: int | None, level: float, find: Callable[[], tuple[Floats, Floats]]
    ) -> tuple[Floats, Floats]:
        """What is found first stays: equations with corrections begin where they were evaluated last."""
        with self.lock:
            if (owner, level) not in self._found:
                self._found[owner, level] = find()
            return self._found[owner, level]

    def _coordinates(self, level: float) -> tuple[Floats, Floats]:
        ends = np.full(len(self.sigma), np.nan), np.full(len(self.sigma), np.nan)
        if self.curvature is not None:
            ends = self._bent(self.curvature, level)
        if self.likelihood is not None:
            self.likelihood.put_in(self._own(ends, level))
        return ends

    def _numbers(self, owner: int, level: float) -> tuple[Floats, Floats]:
        one = self.derived[owner]
        ends = self._derived(owner, one.freedom, level)
        if self.likelihood is not None:
            freedom = Freedom(dof=one.freedom.dof.ravel(), inflation=one.freedom.inflation.ravel())
            numbers = replace(self._own(ends, level), sigma=one.sigma.ravel(), freedom=freedom)
            self.likelihood.put_in_derived(owner, numbers, self._own(self.of_coordinates(level), level))
        return ends

    def _own(self, ends: tuple[Floats, Floats], level: float) -> Own:
        # Loaded where limits are near, so that the others start at once.
        from mbm.estimation.coverage.likelihood import Own

        return Own(ends=ends, sigma=self.sigma, freedom=self.freedom, level=level)

    def _bent(self, curvature: Curvature, level: float) -> tuple[Floats, Floats]:
        around = curvature.around
        below, above = (np.full(len(self.sigma), np.nan) for _ in range(2))
        reach, share = self._reach(level, self.freedom), _share(self.likelihood)
        bent = curvature.bent
        if bent is not None:
            for doubtful in bent.ends.off(share)[: most_followed(around)].tolist():
                place = int(bent.known[doubtful])
                below[place], above[place] = followed_ends(around, bent, doubtful, float(reach[place]), ACCURACY)
            return below, above
        for place in curvature.ends.off(share)[: most_followed(around)].tolist():
            along = around.factor[place] / np.linalg.norm(around.factor[place])
            both = around.followed(along, float(reach[place]), ACCURACY)
            below[place], above[place] = (end * reach[place] * self.sigma[place] for end in both)
        if curvature.beyond is None:
            return below, above
        linear, ends = reach * self.sigma, curvature.beyond.ends(reach)
        moved = (np.stack(ends) > linear).any(axis=0)
        lower, upper = (
            np.where(moved, np.fmax(np.where(np.isnan(own), linear, own), far), own)
            for own, far in zip((below, above), ends, strict=True)
        )
        return lower, upper

    def _derived(self, owner: int, freedom: Freedom, level: float) -> tuple[Floats, Floats]:
        reach = self._reach(level, freedom).ravel()
        below, above = (np.full(len(reach), np.nan) for _ in range(2))
        curvature = self.curvature
        if curvature is None:
            return below, above
        for one in curvature.derived:
            if one.owner == owner:
                doubtful_ones = one.ends.off(_share(self.likelihood))
                if curvature.bent is not None:
                    doubtful_ones = doubtful_ones[: most_followed(curvature.around)]
                for doubtful in doubtful_ones.tolist():
                    place = int(one.known[doubtful])
                    far = float(reach[place])
                    below[place], above[place] = followed_ends(curvature.around, one, doubtful, far, ACCURACY)
                if one.about is not None and one.flat.size:
                    below[one.flat], above[one.flat] = flat_reach(curvature.around, one.about, reach[one.flat])
        return below, above

    def _reach(self, level: float, freedom: Freedom) -> Floats:
        """By how many deviations the root of the cost may grow.

        Where n readings tell a scale, the cost at t of ν degrees of freedom has grown by n log(1 + t²/ν): the scale
        grows with the misfit. The inflation is √(n/ν).
        """
        factors = coverage_factors(level, freedom.dof)
        if not self.scaled:
            return factors * freedom.inflation
        count = freedom.dof * np.square(freedom.inflation)
        return np.sqrt(count * np.log1p(np.square(factors) / freedom.dof))


def profiles(
    found: Curvature | None,
    sigma: Floats,
    freedom: Freedom,
    derived: tuple[DerivedSolution, ...],
    lock: AbstractContextManager[object],
    *,
    scaled: bool,
    likelihood: Likelihood | None,
) -> Profiles | None:
    """What follows the intervals that curvature misplaces, or a limit of the ``likelihood``; None: nothing does."""
    share = _share(likelihood)
    if found is not None and not (
        found.ends.off(share).size or any(one.ends.off(share).size or one.flat.size for one in found.derived)
    ):
        found = None
    if found is None and likelihood is None:
        return None
    return Profiles(
        curvature=found,
        sigma=sigma,
        freedom=freedom,
        derived={one.owner: one for one in derived},
        lock=lock,
        scaled=scaled,
        likelihood=likelihood,
    )


def _share(likelihood: Likelihood | None) -> float:
    """By how much the end of a linear interval may be off, as a share of it."""
    return TOLERATED if likelihood is None or not likelihood.decisive else OF_LIKELIHOODS
