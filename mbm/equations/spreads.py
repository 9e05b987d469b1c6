"""Values beside a covariance: how well standard deviations are known, and what keeps intervals from being linear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.corrections.types import MeasuredErrors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Freedom:
    """``dof``, infinite where nothing was estimated, and the ``inflation`` of the standard deviation, of one shape."""

    dof: Floats
    inflation: Floats

    def first(self, count: int) -> Freedom:
        """The first ``count`` along the leading axis."""
        return Freedom(dof=self.dof[:count], inflation=self.inflation[:count])

    @np.errstate(all="ignore")
    def beside(self, sigma: Floats, parts: Floats, dof: Floats) -> Freedom:
        """That of deviations ``sigma`` with more, independent ``parts`` (m, …) of their squares, known by ``dof`` (m,).

        After Welch and Satterthwaite.
        """
        own, added = np.square(sigma * self.inflation), parts.sum(axis=0)
        whole = np.square(sigma) + added
        lost = np.square(own) / self.dof + np.tensordot(1.0 / dof, np.square(parts), axes=1)
        return Freedom(
            dof=np.where(lost > 0.0, np.square(own + added) / lost, np.where(whole > 0.0, np.inf, self.dof)),
            inflation=np.where(whole > 0.0, np.sqrt((own + added) / whole), self.inflation),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """What a standard deviation of each of m uncertain constants, known by ``dof`` (m,), does.

    To the coordinates: ``coordinates`` (m, n), and ``free`` (m, n) as they would be without limits; and to numbers
    that are looked at: ``own`` (m, k).
    """

    coordinates: Floats
    free: Floats
    own: Floats
    dof: Floats

    def at(self, places: Indices) -> Moved:
        """Of some coordinates alone."""
        return Moved(coordinates=self.coordinates[:, places], free=self.free[:, places], own=self.own, dof=self.dof)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limited:
    """Limits ``lower`` and ``upper`` (n,) of the free coordinates, infinite where there is none.

    ``step`` (n,) leads from an estimate that a limit holds to where it would be without it, where it would have the
    standard deviation ``sigma`` (n,); infinite where that is not known, NaN for all others.
    """

    lower: Floats
    upper: Floats
    step: Floats
    sigma: Floats

    @property
    def alone(self) -> Floats:
        """The steps (n,) to where each would be if its own limit were not; NaN: not known."""
        return np.where(np.isnan(self.step), 0.0, np.where(np.isfinite(self.step), self.step, np.nan))

    def first(self, count: int) -> Limited:
        """The first ``count`` along the leading axis."""
        return Limited(
            lower=self.lower[:count], upper=self.upper[:count], step=self.step[:count], sigma=self.sigma[:count]
        )


class Followed(Protocol):
    """What finds intervals whose linear ends are wrong.

    The first two methods answer how far the ends of intervals of a level lie below and above the estimate; NaN where
    the linear interval is right, infinite where there is no end.
    """

    def of_coordinates(self, level: float) -> tuple[Floats, Floats]:
        """Those of the free coordinates (n,)."""
        ...

    def of_derived(self, owner: int, level: float) -> tuple[Floats, Floats]:
        """Those of all numbers of a derived quantity."""
        ...

    def free_steps(self) -> Floats:
        """The steps (n,) to where the free coordinates would be without the limits that hold them; NaN: not known."""
        ...

    def beside(self, moved: Moved) -> Followed:
        """The same with uncertain constants, which move the free coordinates."""
        ...


class Influence(Protocol):
    """What the covariance at a minimum is the sum of: the errors of all that was measured or is known beforehand."""

    @property
    def factors(self) -> Floats:
        """By how much the standard deviation of each residual (all of them,) is larger than it was stated."""
        ...

    def of_residuals(self, gradient: Floats) -> Floats:
        """What an error of one standard deviation in each of all residuals does to k quantities: (k, all residuals).

        ``gradient`` (k, n) is that of the quantities by the free coordinates. The sign is that of a larger measured
        value, or of a larger number that a form should have instead of zero. 0 for residuals that are left out.
        """
        ...

    def of_shared(self, parts: Floats) -> tuple[Floats, Mapping[int, Floats]]:
        """Parts (k, all residuals) as `of_residuals` has them, and what of them is due to errors that rows share.

        The first keep what is due to the rows' own noise. The others (k, q), by block, are those of the clause's common
        errors, entry by entry, of each for every value of its column as these first occur.
        """
        ...

    def of_measured(self, parts: Floats) -> tuple[Floats, MeasuredErrors | None]:
        """Parts (k, all residuals) as `of_residuals` has them, and what of them is due to errors of measured columns.

        Of equations with such columns the first keep what is due to their own noise.
        """
        ...

    def dof_of_noise(self, block: int) -> float:
        """Degrees of freedom of the variance of a block's rows; infinite where it was not estimated."""
        ...
