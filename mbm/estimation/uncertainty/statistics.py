"""How good a minimum is: cost, degrees of freedom, covariance, and what the residuals cannot say about the noise.

What the error of each measured value does to the estimates, to first order: the parts that a covariance sums up.

With the factor F of the covariance, Σ = F Fᵀ, and the whitened Jacobian J, an error of one standard deviation in row k
moves the estimates by ``F Fᵀ Jₖᵀ/s``, where s is the standard deviation of residuals that `:sigma unknown` leaves. The
squares of these add up to Σ, as ``FᵀJᵀJF = s²``. With losses the same holds of the sandwich, whose middle is a sum over
rows (`mbm.estimation.uncertainty.sandwich`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.manifolds import of_arrays
from mbm.equations.solves import Counted, alone, counted_of
from mbm.equations.surface import affine_by_products
from mbm.equations.types import Covariance, Fit, Floats, Mask, Minimum, Noise, NoiseState, Observability
from mbm.estimation.uncertainty.degrees import Freedoms, freedoms
from mbm.estimation.uncertainty.observability import covariance, in_datum, observed_at, propagate
from mbm.estimation.uncertainty.variance import fit_statistics
from mbm.problem.factors import factor_groups
from mbm.problem.types import Problem
from mbm.solver.noise_factors import OWN, SAME_COVARIANCES, TRIED, changed
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.corrections.types import MeasuredErrors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowInfluence:
    """Protocol `Influence`: the equations at a minimum, and the covariance that was made there.

    ``observed`` is the rank decision before losses changed it, ``stated`` (m,) says whose noise is not estimated;
    ``freedoms`` as `Statistics` has them. ``informing`` (m,) multiplies the rows of the Jacobian where
    consensus cut off tails (None: nothing does).
    """

    equations: Assembled
    minimum: Minimum
    observed: Observability
    covariance: Covariance
    stated: Mask
    freedoms: Freedoms
    informing: Floats | None = None

    @property
    def deviation(self) -> float:
        """The standard deviation of whitened residuals."""
        return float(np.sqrt(self.covariance.variance))

    @property
    def factors(self) -> Floats:
        """As the protocol has it."""
        own = self.equations.factors
        return np.full(self.equations.whole, self.deviation) * (1.0 if own is None else own)

    @np.errstate(all="ignore")
    def of_residuals(self, gradient: Floats) -> Floats:
        """As the protocol has it."""
        parts = self._sparse(gradient) if self.minimum.blocks is not None else self._dense(gradient)
        if self.informing is not None:
            parts = parts * self.informing
        return self.equations.expanded(parts.T).T

    def of_shared(self, parts: Floats) -> tuple[Floats, Mapping[int, Floats]]:
        """As the protocol has it."""
        structure = self.equations.structure
        return (parts, {}) if structure is None else structure.shared_out(parts)

    def of_measured(self, parts: Floats) -> tuple[Floats, MeasuredErrors | None]:
        """As the protocol has it."""
        if self.equations.implicit is None:
            return parts, None
        return self.equations.implicit.shared_out(self.minimum.point, parts)

    def _dense(self, gradient: Floats) -> Floats:
        equations, minimum = self.equations, self.minimum
        if not equations.lossy:
            if not self.deviation > 0.0:
                return np.zeros((len(gradient), equations.count))
            image = gradient @ self.covariance.factor
            return np.asarray(image @ (minimum.jacobian @ self.covariance.factor).T / self.deviation)
        from mbm.estimation.uncertainty.sandwich import bread

        found = bread(
            loss_lines(equations),
            *equations.plain_linearised(minimum.point),
            self.observed,
            self.stated,
            equations.coordinates(minimum.point),
        )
        moved = gradient @ in_datum(found.basis @ found.inverse, found.observed)
        return np.asarray(moved @ found.along.T * np.sqrt(found.spread))

    def _sparse(self, gradient: Floats) -> Floats:
        # Loaded by sparse problems only, so that the others start at once.
        from mbm.estimation.uncertainty.sparse import sparse_rows

        if not self.equations.lossy:
            return sparse_rows(gradient, self.minimum, self.covariance) * self.deviation
        from mbm.estimation.uncertainty.sparse_sandwich import informed

        plain = self.equations.plain_residuals(self.minimum.point)
        weighted = informed(self.equations, self.minimum, plain, self.observed, self.stated)
        return sparse_rows(gradient, replace(self.minimum, blocks=weighted), self.covariance)

    def dof_of_noise(self, block: int) -> float:
        """As the protocol has it."""
        return self.freedoms.of_noise(block)


Propagator: TypeAlias = tuple[Observability, Covariance]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative:
    """The covariance with another assumption about noise that nothing tells: what is farther ``apart`` is not known.

    It is compared with the covariance without that assumption; what losses make of either does not count.
    """

    given: Propagator
    assumed: Propagator
    apart: float

    def unknown_sigmas(self) -> Mask:
        """Which coordinates (n,) have no standard deviation."""
        first, second = (np.square(each[1].sigma) for each in (self.given, self.assumed))
        return _changed(first, second, self.apart, first)

    def unknown(self) -> Mask:
        """Which elements of the covariance matrix (n, n) are not known; (0, 0) of sparse problems."""
        return _elements_changed(self.given[1].matrix, self.assumed[1].matrix, self.apart)

    def unknown_of(self, gradient: Floats) -> Mask:
        """Which elements (k, k) of the covariance of quantities with a gradient (k, n) are not."""
        first, second = (propagate(gradient, *each).matrix for each in (self.given, self.assumed))
        return _elements_changed(first, second, self.apart)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statistics:
    """``covariance`` holds NaN also for what depends on noise that nothing tells, by the ``alternatives``.

    ``sigma_known`` is False where no noise at all is known. ``freedoms`` says how well standard deviations are known,
    ``influence`` what the covariance is the sum of, ``counted`` what counts of a likelihood (None: there is none).
    """

    observed: Observability
    covariance: Covariance
    alternatives: tuple[Alternative, ...]
    fit: Fit
    sigma_known: bool
    freedoms: Freedoms
    influence: RowInfluence
    counted: Counted | None
    diagnostics: tuple[Diagnostic, ...]

    @property
    def log_likelihood(self) -> float | None:
        """log L of all readings, constants included; None where no equation has a likelihood."""
        found = None if self.counted is None else self.counted.log_likelihood
        return None if found is None else float(found[0])


def statistics(
    problem: Problem,
    equations: Assembled,
    minimum: Minimum,
    observed: Observability,
    noise: Mapping[int, Noise],
    factors: Floats | None,
    tested: float | None = None,
) -> Statistics:
    """Cost, degrees of freedom and covariance; a single unknown factor counts as σ = 1 in the cost (CONTRACT §2).

    ``tested`` as for `fit_statistics`.
    """
    plain, left = plain_residuals(equations, minimum), equations.uncounted
    variance, known, redundancy = 1.0, True, None
    groups = factor_groups(problem.blocks, noise)
    if len(groups) == 1 and factors is None:
        only = next(iter(noise.values()))
        variance = only.factor**2 if only.state is NoiseState.ESTIMATED else 0.0
        known, redundancy = only.state is not NoiseState.NO_REDUNDANCY, only.dof
    stated, decided = _stated(equations, noise), observed
    estimated, observed = _estimated(equations, minimum, plain, decided, stated, variance)
    alternatives = tuple(_alternatives(equations, minimum, noise)) if factors is not None else ()
    for each in alternatives:
        estimated = _masked(estimated, each)
    counted = None
    if equations.likely:
        own = equations.expanded(minimum.residuals)[None]
        counted = counted_of(alone(equations), own, np.array([equations.count]))
    fit = fit_statistics(
        cost_of(problem, equations, minimum, noise, factors),
        equations.count if left is None else int((~left).sum()),
        observed.rank,
        noise_stated=not noise and not equations.lossy and (counted is None or not counted.untested[0]),
        equalities=observed.equalities,
        tested=None if left is not None else tested,
    )
    told = fit.dof if redundancy is None else redundancy
    known_by = _shared(problem, equations, minimum, estimated, noise)
    if known_by is None:
        known_by = freedoms(
            equations, minimum, observed, estimated, [(noise[g[0]], g) for g in groups], (told, counted)
        )
    return Statistics(
        observed=observed,
        covariance=estimated,
        alternatives=alternatives,
        fit=fit,
        sigma_known=known,
        freedoms=known_by,
        influence=RowInfluence(
            equations=equations,
            minimum=minimum,
            observed=decided,
            covariance=estimated,
            stated=stated,
            freedoms=known_by,
        ),
        counted=counted,
        diagnostics=tuple(_unknown_noise(problem, noise)),
    )


def _estimated(
    equations: Assembled, minimum: Minimum, plain: Floats, observed: Observability, stated: Mask, variance: float
) -> tuple[Covariance, Observability]:
    """The covariance, and the rank decision with what losses leave free as well."""
    if not equations.lossy:
        return covariance(observed, variance), observed
    if minimum.blocks is not None:
        # Here and below: loaded by problems with losses only, so that the others start at once.
        from mbm.estimation.uncertainty.sparse_sandwich import sparse_sandwich

        return sparse_sandwich(equations, minimum, plain, observed, stated)
    from mbm.estimation.uncertainty.sandwich import sandwich

    slopes, place = equations.plain_jacobian(minimum.point), equations.coordinates(minimum.point)
    return sandwich(loss_lines(equations), plain, slopes, observed, stated, place)


def plain_residuals(equations: Assembled, minimum: Minimum) -> Floats:
    """Whitened residuals (m,) at a minimum, without losses."""
    return equations.plain_residuals(minimum.point) if equations.lossy else minimum.residuals


def cost_of(
    problem: Problem, equations: Assembled, minimum: Minimum, noise: Mapping[int, Noise], factors: Floats | None
) -> float:
    """Σ r² of a minimum without losses, with one unknown factor as 1, or the final one where errors are beside its own.

    ``factors`` as for `statistics`.
    """
    residuals, left = plain_residuals(equations, minimum), equations.uncounted
    if left is not None:
        residuals = np.where(left, 0.0, residuals)
    groups = factor_groups(problem.blocks, noise)
    if len(groups) == 1 and factors is not None:
        if not any(problem.blocks[number].structure.per for number in groups[0]):
            rows = np.concatenate([equations.noise_rows(number) for number in groups[0]])
            residuals = residuals.copy()
            residuals[rows] *= equations.picked(factors)[rows]
    elif not equations.lossy and left is None:
        return minimum.cost
    return float(residuals @ residuals)


def _shared(
    problem: Problem, equations: Assembled, minimum: Minimum, estimated: Covariance, noise: Mapping[int, Noise]
) -> Freedoms | None:
    """The degrees of freedom where rows share unknown noise; None where they do not."""
    if equations.structure is None:
        return None
    # Loaded by the problems that need it only, so that the others start at once.
    from mbm.estimation.uncertainty.shared_degrees import shared_freedoms

    scaled = [number for number in noise if problem.blocks[number].unknown_factor]
    return shared_freedoms(equations, minimum, estimated, noise, factor_groups(problem.blocks, scaled))


def _wanted(problem: Problem, number: int) -> str:
    """The option that would state the noise of a block."""
    block = problem.blocks[number]
    if block.structure.free:
        return "`:covariance`, or more rows"
    return "`:sigma`" if block.unknown_factor else "`(ar1 …)`, or more rows"


def _unknown_noise(problem: Problem, noise: Mapping[int, Noise]) -> Iterator[Diagnostic]:
    """What is to be said of noise that is not estimated, or not to the end."""
    for number, each in noise.items():
        block = problem.blocks[number]
        if each.state not in (NoiseState.ESTIMATED, NoiseState.NOTHING):
            yield faults.noise_not_estimated(block.span, block.name, each.why, _wanted(problem, number))
        elif not each.settled:
            yield faults.noise_not_settled(block.span, block.name)


def _stated(equations: Assembled, noise: Mapping[int, Noise]) -> Mask:
    """Which residuals (m,) have noise that is stated."""
    found = np.ones(equations.count, dtype=bool)
    for number in noise:
        found[equations.noise_rows(number)] = False
    return found


def _alternatives(equations: Assembled, minimum: Minimum, noise: Mapping[int, Noise]) -> Iterator[Alternative]:
    """The covariances if noise that the residuals cannot tell, or that is nothing, were larger (`TRIED`).

    Beside common errors, what is fitted exactly has the noise of these.
    """
    point = equations.coordinates(minimum.point)

    def with_weights(weights: Floats | None) -> Propagator:
        observed = observed_at(minimum, point, weights, affine=affine_by_products(equations))
        return observed, covariance(observed)

    given, structure = None, equations.structure
    common = {p.owner for p in structure.patterns if p.common is not None} if structure is not None else ()
    untellable = (NoiseState.NO_REDUNDANCY, NoiseState.EXACT, NoiseState.DEPENDENT)
    for states, apart in ((untellable, SAME_COVARIANCES), ((NoiseState.NOTHING,), OWN)):
        untold = [
            i for i, n in noise.items() if n.state in states and not (n.state is NoiseState.EXACT and i in common)
        ]
        if untold:
            given = given or with_weights(None)
            weights = np.ones(equations.count)
            for number in untold:
                weights[equations.noise_rows(number)] = 1.0 / TRIED
            yield Alternative(given=given, assumed=with_weights(weights), apart=apart)


def _changed(first: Floats, second: Floats, share: float, size: Floats) -> Mask:
    return np.asarray(of_arrays(changed)(first, second, share, size) != 0.0)


def _elements_changed(first: Floats, second: Floats, share: float) -> Mask:
    return _changed(first, second, share, np.sqrt(np.outer(np.diag(first), np.diag(first))))


def _masked(estimated: Covariance, alternative: Alternative) -> Covariance:
    matrix = np.where(alternative.unknown(), np.nan, estimated.matrix)
    sigma = np.where(alternative.unknown_sigmas(), np.nan, estimated.sigma)
    return replace(estimated, matrix=matrix, sigma=sigma)
