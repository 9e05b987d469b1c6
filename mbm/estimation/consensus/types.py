"""What is asked of consensus, what it answers, and what robust estimation hands to the minimisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from types import MappingProxyType

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Mask, Minimum, Noise, Reason
from mbm.estimation.consensus.held import Held
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.problem.types import Block, BlockRole, Consensus, Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass


def observed(block: Block) -> bool:
    """Whether the block holds observations: the rows that `:robust` may leave out."""
    return block.role is BlockRole.OBSERVATION


def with_loss(block: Block) -> bool:
    """Whether it holds observations that have a loss."""
    return block.role is BlockRole.OBSERVATION and block.loss is not None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Asked:
    """What is asked of consensus: by which rules, of the units of the blocks that are ``ruled``.

    ``stated``: no noise is unknown any more. ``held`` are the constraints that are put in (None: none).
    """

    problem: Problem
    settings: Settings
    consensus: Consensus
    ruled: Callable[[Block], bool]
    stated: bool = False
    held: Held | None = None

    def left(self, equations: Assembled) -> int:
        """Coordinates of equations that constraints leave."""
        return equations.dimension - (0 if self.held is None else self.held.told(equations))

    def acting(self, equations: Assembled) -> tuple[bool, ...]:
        """Which groups of equations have units that may be left out."""
        return tuple(self.ruled(self.problem.blocks[group.kernel.owner]) for group in equations.groups)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreed:
    """The units that agree at a point.

    ``inliers`` (U,) have squared norms up to ``limits`` (U,) at ``point`` (N,); ``variances`` (U,) are those of the
    noise: 1 where it is stated, else estimated from the inliers. ``trials`` is the number of subsets; ``ambiguous``
    says that another point explains as much, ``cut_short`` that the trials were interrupted.
    """

    point: Floats
    inliers: Mask
    limits: Floats
    variances: Floats
    trials: int = 0
    ambiguous: bool = False
    cut_short: bool = False

    @property
    def share(self) -> float:
        """Share of the units that agree."""
        return float(self.inliers.mean()) if self.inliers.size else 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """What to minimise, and where to begin.

    ``factors`` (all residuals,) and ``noise`` belong to blocks with a loss whose factor is unknown. ``truncation`` (all
    residuals,) is κ of the rows that consensus kept (None: no consensus); ``literal``: they inform as if there had been
    no others. ``agreed`` is False where too few agree,
    ``cut_short`` True where the search for those that do was interrupted.
    """

    equations: Assembled
    starts: tuple[Beginning, ...]
    factors: Floats | None = None
    noise: Mapping[int, Noise] = field(default_factory=lambda: MappingProxyType({}))
    truncation: Floats | None = None
    literal: bool = False
    agreed: bool = True
    cut_short: bool = False
    diagnostics: tuple[Diagnostic, ...] = ()

    def judged(self, minimum: Minimum) -> Minimum:
        """The minimum with what the agreement, or the lack of it, says of it."""
        if self.cut_short:
            return replace(minimum, reason=Reason.INTERRUPTED)
        return minimum if self.agreed else replace(minimum, reason=Reason.NO_AGREEMENT)

    @property
    def informing(self) -> Floats | None:
        """What makes of the Jacobian one that holds the information there is: √κ of each row (m,); None: nothing."""
        if self.truncation is None or self.literal:
            return None
        return np.sqrt(self.equations.picked(self.truncation))

    def scattering(self, residuals: Floats) -> Floats:
        """Residuals (m,) that scatter as the noise does, without the loss of the tails."""
        return residuals if self.truncation is None else residuals / np.sqrt(self.equations.picked(self.truncation))

    def tested(self, residuals: Floats) -> float | None:
        """The sum of squares (of residuals (m,)) that follows the χ² law where tails were cut off; None: as it is."""
        return None if self.truncation is None else float(np.square(self.scattering(residuals)).sum())
