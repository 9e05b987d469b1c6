"""The minimum with its final weights: variance components, each round of which minimises again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounding_at, terms_of_rows
from mbm.equations.surface import affine_by_products
from mbm.equations.types import Floats, Indices, Minimum, Noise, NoiseState, Observability, Reason
from mbm.estimation.consensus.types import Prepared
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.search.search import Alternative, Found, reweighted
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.informed import informed, without_stationary
from mbm.estimation.uncertainty.observability import observed_at
from mbm.estimation.uncertainty.variance import (
    beside_constants,
    common_factor,
    redundancy_numbers,
    starting_factors,
    variance_components,
    without_constants,
)
from mbm.problem.factors import factor_groups
from mbm.problem.types import Problem
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.structure import Structure

REWEIGHTED_SEARCHES = 5
"""Times the limit of iterations that the rounds of the variance components may take together. Those left over get one
each, and the first of them that is at no minimum then is the last."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reached:
    """The minimum with the final weights, and the equations with them; ``factors`` (all residuals,), None: all 1.

    ``noise`` has the factor of each block whose noise is unknown; ``others`` are the other minima with these weights.
    """

    minimum: Minimum
    noise: Mapping[int, Noise]
    factors: Floats | None
    equations: Assembled
    others: tuple[Alternative, ...]
    iterations: int
    evaluations: int


def reached(
    problem: Problem, robust: Prepared, settings: Settings, found: Found, moves: Floats | None = None
) -> Reached:
    """From the minimum with the noise as stated to that with the noise as it is; ``moves`` (k, m) as in `Moves`."""
    run = _Weighing(problem, robust, settings, found, moves)
    minimum, noise, factors = run.weighted()
    equations = run.equations.with_factors(factors)
    changed = factors is not robust.factors and bool(found.alternatives)
    return Reached(
        minimum=minimum,
        noise=noise,
        factors=factors,
        equations=equations,
        others=reweighted(equations, found.alternatives, settings, problem) if changed else found.alternatives,
        iterations=run.iterations,
        evaluations=run.evaluations,
    )


def checked_rows(equations: Assembled, minimum: Minimum) -> Floats:
    """The redundancy number of each residual (m,) at a minimum of the equations."""
    observed = observed_at(minimum, equations.coordinates(minimum.point), affine=affine_by_products(equations))
    return redundancy_numbers(minimum.jacobian, observed, minimum.blocks)


class _Weighing:
    """Minimisations of one data set, again for each round of the variance components; counts the work.

    ``found`` is the minimum with the noise as stated; ``moves`` are what uncertain constants do to residuals.
    """

    def __init__(
        self, problem: Problem, robust: Prepared, settings: Settings, found: Found, moves: Floats | None
    ) -> None:
        self.equations = robust.equations
        self._moves = moves if moves is not None and moves.shape[1] == self.equations.whole else None
        self._robust = robust
        self.settings = settings
        self._place = problem.span
        self.iterations = self._searched = found.iterations
        self.evaluations = found.evaluations
        self._last: tuple[Floats | None, Minimum] | None = (robust.factors, found.minimum)
        unknown = (
            i
            for i, block in enumerate(problem.blocks)
            if block.unknown_factor and i not in robust.noise and len(self.equations.block_rows(i)) > 0
        )
        self.unknown = factor_groups(problem.blocks, unknown)
        self._point = found.minimum.point if np.isfinite(found.minimum.cost) else self.equations.numbers

    def weighted(self) -> tuple[Minimum, Mapping[int, Noise], Floats | None]:
        """The minimum with the final weights, and the noise of each block whose factor is unknown."""
        robust = self._robust
        groups = [np.concatenate([self.equations.noise_rows(i) for i in group]) for group in self.unknown]
        stated = sum(map(len, groups)) < self.equations.count
        if self._shares():
            return self._shared()
        if not self.unknown:
            return self._minimise(robust.factors), robust.noise, robust.factors
        if len(self.unknown) == 1 and not stated:
            minimum = self._minimise(None)
            observed = self._observed(minimum)
            cost = float(np.square(robust.scattering(minimum.residuals)).sum())
            dof = self.equations.count + observed.equalities - observed.rank
            moves = self._left_over(minimum, observed, None)
            rounding = rounding_at(self.equations, minimum)
            noise = common_factor(cost, dof, rounding)
            if moves is not None and noise.state is NoiseState.ESTIMATED:
                noise = beside_constants(minimum.residuals, moves, dof, rounding)
            return minimum, dict.fromkeys(self.unknown[0], noise), None
        found = variance_components(self._reweighted, groups, self._starting(groups))
        factors = self._row_factors([noise.factor for noise in found])
        noises = dict(robust.noise)
        for group, noise in zip(self.unknown, found, strict=True):
            noises |= dict.fromkeys(group, noise)
        return self._minimise(factors), noises, factors

    def _shares(self) -> bool:
        """Whether noise is unknown in a way in which rows share it; a factor of all of a block's noise is none."""
        structure = self.equations.structure
        blocks = {number for group in self.unknown for number in group}
        return structure is not None and any(
            p.unknown or p.lower is not None or (p.common is not None and p.owner in blocks) for p in structure.patterns
        )

    def _shared(self) -> tuple[Minimum, Mapping[int, Noise], Floats | None]:
        """The same of noise that rows share."""
        # Loaded by the problems that need it only, so that the others start at once.
        from mbm.estimation.solve.shared_noise import Rounds, Ways

        def minimised(structure: Structure, values: Floats) -> Minimum:
            if structure is not self.equations.structure:
                self.equations, self._last = replace(self.equations, structure=structure, factors=None), None
            return self._minimise(self._row_factors(values))

        ways = Ways(minimise=minimised, factors=self._row_factors, observed=self._observed)
        found = Rounds(self.equations, self.unknown, ways).done()
        self.equations = replace(self.equations, structure=found.structure, factors=None)
        return found.minimum, found.noises, found.factors

    def _row_factors(self, values: Sequence[float] | Floats) -> Floats:
        """Factors by residual (all of them) from those of the groups of blocks with unknown noise."""
        by_row = np.ones(self.equations.whole) if self._robust.factors is None else self._robust.factors.copy()
        for group, value in zip(self.unknown, values, strict=True):
            for number in group:
                by_row[self.equations.everything().noise_rows(number)] = value
        return by_row

    def _reweighted(self, factors: Floats) -> tuple[Floats, Floats, Floats] | None:
        minimum = self._minimise(self._row_factors(factors))
        late = minimum.reason is Reason.MAX_ITERATIONS and self._left() <= 0
        if late or not (minimum.reason.converged or minimum.reason.under_way):
            return None
        minimum = informed(self.equations.with_factors(self._row_factors(factors)), minimum)
        observed = self._observed(minimum)
        checked = redundancy_numbers(minimum.jacobian, observed, minimum.blocks)
        residuals, moves = self._robust.scattering(minimum.residuals), self._left_over(minimum, observed, factors)
        if moves is not None:
            residuals, checked = without_constants(residuals, checked, moves)
        return residuals, checked, terms_of_rows(self.equations, minimum)

    def _left_over(self, minimum: Minimum, observed: Observability, factors: Floats | None) -> Floats | None:
        """What the unknowns leave of the moves (k, m), divided by the noise with these factors."""
        if self._moves is None or minimum.blocks is not None or self._robust.factors is not None:
            return None
        moves = self._moves if factors is None else self._moves / self._row_factors(factors)
        rank = observed.row_space.shape[1]
        basis = minimum.jacobian / observed.scale @ (observed.row_space / observed.singular_values[:rank])
        return None if moves.shape[1] != len(basis) else np.asarray(moves - moves @ basis @ basis.T)

    def _starting(self, groups: Sequence[Indices]) -> Floats:
        """Factors of the groups from which the rounds start."""
        ones = np.ones(len(groups))
        told = self._reweighted(ones)
        there = self._minimise(self._row_factors(ones))
        return ones if told is None else starting_factors(there.jacobian, told[1], groups)

    def _left(self) -> int:
        """Iterations that the rounds have left."""
        return REWEIGHTED_SEARCHES * self.settings.max_iterations - (self.iterations - self._searched)

    def _observed(self, minimum: Minimum) -> Observability:
        equations = self.equations
        return observed_at(minimum, equations.coordinates(minimum.point), affine=affine_by_products(equations))

    def _minimise(self, factors: Floats | None) -> Minimum:
        minimum = self._minimum(factors)
        spread = np.sqrt(minimum.cost / max(self.equations.count, 1)) if self.unknown else 1.0
        return without_stationary(self.equations.with_factors(factors), minimum, float(spread))

    def _minimum(self, factors: Floats | None) -> Minimum:
        if self._last is not None and _same(factors, self._last[0]):
            return self._last[1]
        settings = replace(self.settings, max_iterations=min(self.settings.max_iterations, max(self._left(), 1)))
        minimum = minimise(self.equations.with_factors(factors), self._point, settings, self._place)
        self.iterations += minimum.iterations
        self.evaluations += minimum.evaluations
        if np.isfinite(minimum.cost):
            self._point = minimum.point
        self._last = factors, minimum
        return minimum


def _same(first: Floats | None, second: Floats | None) -> bool:
    """Whether two sets of noise factors are equal; None: all 1."""
    if first is None or second is None:
        other = second if first is None else first
        return other is None or bool((other == 1.0).all())
    return bool((first == second).all())
