"""Values beside a covariance: how well standard deviations are known, and what keeps intervals from being linear."""

from __future__ import annotations

from typing import Protocol

from mbm.equations.types import Floats
from mbm.values import dataclass


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

    Both methods answer how far the ends of intervals of a level lie below and above the estimate; NaN where the linear
    interval is right, infinite where there is no end.
    """

    def of_coordinates(self, level: float) -> tuple[Floats, Floats]:
        """Those of the free coordinates (n,)."""
        ...

    def of_derived(self, owner: int, level: float) -> tuple[Floats, Floats]:
        """Those of all numbers of a derived quantity."""
        ...
