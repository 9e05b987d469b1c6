"""What is asked of consensus, what it answers, and what robust estimation hands to the minimisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import with_rows
from mbm.equations.types import Floats, Indices, Mask, Minimum, Noise, Reason
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.problem.types import Block, BlockRole, Consensus, Problem
from mbm.solver.decisions import CONSTRAINT_SHARE
from mbm.text.types import Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """Constraints of some ``equations``, those ``which`` (k,), that hold as equations do.

    They tell as many coordinates as there are ``columns``, among all; ``bounded`` are those that bounds hold.
    """

    equations: Assembled
    which: Mask
    columns: Indices
    bounded: Indices

    def told(self, equations: Assembled) -> int:
        """How many coordinates they tell of those that some of the equations have free."""
        return equations.dimension - len(self._free(equations)) + int(np.isin(self.columns, equations.free).sum())

    def _free(self, equations: Assembled) -> Indices:
        """The coordinates that bounds leave of those that some of the equations have free."""
        return equations.free[~np.isin(equations.free, self.bounded)]

    def upon(self, equations: Assembled) -> Assembled:
        """Some of the equations over some coordinates, with what holds these as their constraints."""
        left = self._free(equations)
        free = np.zeros(len(equations.layout.number), dtype=bool)
        free[left] = True
        groups: list[Group] = []
        equality: list[Mask] = []
        for group in self.equations.constraints:
            lines = self.which[group.first : group.first + group.count].reshape(group.rows, -1)
            mine = free[group.touched].any(axis=1) & lines.any(axis=1)
            for pattern in np.unique(lines[mine], axis=0):
                rows = np.flatnonzero(mine & (lines == pattern).all(axis=1))
                first = sum(len(each) for each in equality)
                groups.append(replace(with_rows(group, rows), first=first))
                equality.append(np.tile(pattern, len(rows)))
        told = np.concatenate(equality) if equality else np.zeros(0, dtype=bool)
        others = equations if len(left) == equations.dimension else equations.freed(left, equations.numbers)
        return replace(others, constraints=tuple(groups), equality=told)


Checked: TypeAlias = Callable[[Assembled, Minimum], Floats]
"""How much each residual (m,) of some equations shows at a minimum of them, as `redundancy_numbers` has it."""


def held_by(equations: Assembled, point: Floats, which: Mask, at_bound: Mask | None = None) -> Held | None:
    """The constraints ``which`` (k,) as equations that are put in, and the coordinates ``at_bound`` (n,) of the point.

    None: there is nothing, or it tells nothing there.
    """
    bounded = np.zeros(equations.dimension, dtype=bool) if at_bound is None else at_bound
    if not (which.any() or bounded.any()):
        return None
    slopes = equations.constraint_jacobian(point)[which]
    slopes[:, bounded] = 0.0
    lengths = np.sqrt(np.square(slopes).sum(axis=1, keepdims=True))
    left = slopes / np.where(lengths > 0.0, lengths, 1.0)
    if not np.isfinite(left).all():
        return None
    columns: list[int] = []
    while left.size and float(np.abs(left).max()) > CONSTRAINT_SHARE:
        row, column = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        columns.append(int(column))
        left = left - np.outer(left[:, column], left[row]) / left[row, column]
    if not (columns or bounded.any()):
        return None
    told = equations.free[columns] if columns else equations.free[:0]
    return Held(equations=equations, which=which, columns=told, bounded=equations.free[bounded])


def with_held(held: Held | None, equations: Assembled) -> Assembled:
    """The equations with what is held as their constraints, and no others."""
    if held is not None:
        return held.upon(equations)
    return replace(equations, constraints=(), equality=equations.equality[:0]) if equations.constraints else equations


def observed(block: Block) -> bool:
    """Whether the block holds observations: the rows that `:robust` may leave out."""
    return block.role is BlockRole.OBSERVATION


def with_loss(block: Block) -> bool:
    """Whether it holds observations that have a loss."""
    return block.role is BlockRole.OBSERVATION and block.loss is not None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Asked:
    """What is asked of consensus: by which rules, of the units of the blocks that are ``ruled``.

    ``checked`` tells redundancy (None: as if all rows told the unknowns alike). ``stated``: no noise is unknown any
    more. ``held`` are the constraints that are put in (None: none).
    """

    problem: Problem
    settings: Settings
    consensus: Consensus
    ruled: Callable[[Block], bool]
    checked: Checked | None = None
    stated: bool = False
    held: Held | None = None

    def left(self, equations: Assembled) -> int:
        """Coordinates of equations that constraints leave."""
        return equations.dimension - (0 if self.held is None else self.held.told(equations))

    def spent(self, equations: Assembled) -> int:
        """Those of them that some unit depends on; the others are told by rows that no rule acts on."""
        seen = np.zeros(len(equations.layout.number), dtype=bool)
        for group, acts in zip(equations.groups, self.acting(equations), strict=True):
            if acts:
                seen[group.touched] = True
        return min(self.left(equations), int(seen[equations.free].sum()))

    def acting(self, equations: Assembled) -> tuple[bool, ...]:
        """Which groups of equations have units that may be left out."""
        return tuple(self.ruled(self.problem.blocks[group.kernel.owner]) for group in equations.groups)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreed:
    """The units that agree at a point.

    ``inliers`` (U,) have squared norms up to ``limits`` (U,) at ``point`` (N,); ``variances`` (U,) are those of the
    noise: 1 where it is stated, else estimated from the inliers. ``redundancy`` (U,) is how much of each shows in its
    residuals (None: nobody has looked). ``trials`` is the number of subsets; ``ambiguous`` says that another point
    explains as much, ``cut_short`` that the trials were interrupted. ``settled`` False: rounds of fit and noise, or of
    what holds the fit, ran out before they agreed.
    """

    point: Floats
    inliers: Mask
    limits: Floats
    variances: Floats
    redundancy: Floats | None = None
    trials: int = 0
    ambiguous: bool = False
    cut_short: bool = False
    settled: bool = True

    @property
    def share(self) -> float:
        """Share of the units that agree."""
        return float(self.inliers.mean()) if self.inliers.size else 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """What to minimise, and where to begin.

    ``factors`` (all residuals,) and ``noise`` belong to blocks with a loss whose factor is unknown. ``truncation`` (all
    residuals,) is κ of the rows that consensus kept (None: no consensus), ``information`` (the same) what they inform
    by (None: as if there had been no others). ``agreed`` is False where too few agree, ``cut_short`` True where the
    search for those that do was interrupted.
    """

    equations: Assembled
    starts: tuple[Beginning, ...]
    factors: Floats | None = None
    noise: Mapping[int, Noise] = field(default_factory=lambda: MappingProxyType({}))
    truncation: Floats | None = None
    information: Floats | None = None
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
        """What makes of the Jacobian one that holds the information there is (m,); None: nothing."""
        return None if self.information is None else np.sqrt(self.equations.picked(self.information))

    def scattering(self, residuals: Floats) -> Floats:
        """Residuals (m,) that scatter as the noise does, without the loss of the tails."""
        return residuals if self.truncation is None else residuals / np.sqrt(self.equations.picked(self.truncation))

    def tested(self, residuals: Floats) -> float | None:
        """The sum of squares (of residuals (m,)) that follows the χ² law where tails were cut off; None: as it is."""
        return None if self.truncation is None else float(np.square(self.scattering(residuals)).sum())
