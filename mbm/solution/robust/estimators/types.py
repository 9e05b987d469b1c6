"""What a consensus estimator says about itself: where its trials come from, and which of them it likes best."""

from __future__ import annotations

from typing import Protocol

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.units import Units
from mbm.solution.types import Floats


class ConsensusEstimator(Protocol):
    """The rules by which an estimator differs from the others."""

    @property
    def kind(self) -> ConsensusKind:
        """Its name in ``:robust``."""
        ...

    @property
    def samples(self) -> bool:
        """Trials are fits to random minimal subsets; else they come from graduated non-convexity alone."""
        ...

    @property
    def knows_limits(self) -> bool:
        """The score depends on where outliers begin, hence on the noise."""
        ...

    def scores(self, squares: Floats, units: Units, size: int, limits: Floats) -> Floats:
        """The scores (T,) of T trials, lower is better.

        ``squares`` (T, U) are the squared norms of the units' residuals, ``limits`` (U,) those beyond which a unit is
        an outlier, ``size`` the number of units that determine a trial.
        """
        ...
