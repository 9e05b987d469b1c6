"""Values beside a covariance: how well standard deviations are known, and what keeps intervals from being linear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from mbm.equations.types import Floats
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

    def widened(self, added: Floats) -> Followed:
        """The same where the free coordinates would scatter by variances ``added`` (n,) more if no limit held them."""
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
