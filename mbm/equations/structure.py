"""Noise that rows share: what makes the residuals of a clause independent, beside its standard deviations.

The residuals v of a clause, each over its standard deviation, have the covariance ``R + Z Zᵀ/s²`` in units of the
clause's factor s: R is the correlation along the rows, Z what errors common to groups of rows do to each, over its
standard deviation. With ``W R Wᵀ = 1`` and the singular vectors U of ``W Z``, whose squared singular values are λ,
``(1 − U (1 − 1/√(1 + λ/s²)) Uᵀ) W v`` is independent, and no matrix of rows by rows is made (Woodbury 1950).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np
from scipy.linalg import solve_banded, solve_triangular
from scipy.sparse import csr_array

from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass

LARGEST_RHO = 1.0 - 1e-6
"""Correlation of neighbouring rows up to which the noise of a row differs from that of the one before."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chains:
    """First-order autoregression: ``gaps`` (r,) in rows to the line before, 0 where a chain begins; rho at first."""

    gaps: Indices
    rho: float

    @property
    def _begins(self) -> Mask:
        return np.asarray(self.gaps == 0)

    @property
    def _powers(self) -> Floats:
        """The correlation with the line before (r,), 0 where a chain begins."""
        return np.where(self._begins, 0.0, np.power(self.rho, self.gaps))

    @property
    def _slopes(self) -> Floats:
        """Its derivative by rho."""
        return np.where(self._begins, 0.0, self.gaps * np.power(self.rho, np.maximum(self.gaps - 1, 0)))

    @property
    def _roots(self) -> Floats:
        return np.sqrt(1.0 - np.square(self._powers))

    def independent(self, values: Floats) -> Floats:
        """W v of values (r, …): innovations over their standard deviation, which is one for the first of a chain."""
        before = np.concatenate([np.zeros_like(values[:1]), values[:-1]])
        shape = (-1, *(1,) * (values.ndim - 1))
        return np.asarray((values - self._powers.reshape(shape) * before) / self._roots.reshape(shape))

    def correlated(self, values: Floats) -> Floats:
        """W⁻¹ of values (r, …): what has the correlation, of independent values."""
        band = np.zeros((2, len(values)))
        band[0] = 1.0
        band[1, :-1] = -self._powers[1:]
        shape = (-1, *(1,) * (values.ndim - 1))
        return np.asarray(solve_banded((1, 0), band, self._roots.reshape(shape) * values))

    @property
    def log_determinant(self) -> float:
        """Of W."""
        return float(-np.log(self._roots).sum())

    def slope(self, values: Floats) -> Floats:
        """``W dR/drho Wᵀ`` times values (r, k): minus K and its transpose, with ``K = dW/drho W⁻¹``."""
        first = (-self._slopes / self._roots)[:, None]
        own = (self._powers * self._slopes / np.square(self._roots))[:, None]
        correlated = self.correlated(values)
        lower = first * np.concatenate([np.zeros_like(values[:1]), correlated[:-1]]) + own * values
        pushed = first * values
        band = np.zeros((2, len(values)))
        band[1] = 1.0
        band[0, 1:] = -self._powers[1:]
        ahead = solve_banded((0, 1), band, np.concatenate([pushed[1:], np.zeros_like(pushed[:1])]))
        return np.asarray(-(lower + self._roots[:, None] * ahead + own * values))

    @property
    def slope_traces(self) -> tuple[float, float]:
        """The traces of that matrix and of its square."""
        own = self._powers * self._slopes / np.square(self._roots)
        first = np.square(self._slopes / self._roots).sum()
        return float(-2.0 * own.sum()), float(2.0 * np.square(own).sum() + 2.0 * (np.square(own).sum() + first))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stated:
    """A correlation matrix that is stated: ``lower`` (t, t) is its Cholesky factor, the same for each component."""

    lower: Floats

    def independent(self, values: Floats) -> Floats:
        """W v of values (r, …), component after component."""
        return self._solved(values, transposed=False)

    def _solved(self, values: Floats, *, transposed: bool) -> Floats:
        parts = values.reshape(-1, len(self.lower), *values.shape[1:])
        found = [solve_triangular(self.lower, each, lower=True, trans=int(transposed)) for each in parts]
        return np.stack(found).reshape(values.shape)

    @property
    def log_determinant(self) -> float:
        """Of W, for one component."""
        return float(-np.log(np.diag(self.lower)).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Common:
    """Errors that groups of rows share: ``vectors`` U (r, q) of unit length and ``squares`` λ (q,) for s = 1."""

    vectors: csr_array
    squares: Floats

    def independent(self, values: Floats, factor: float) -> Floats:
        """Values (r, …) without what they share."""
        return self._without(values, 1.0 - 1.0 / np.sqrt(1.0 + self.squares / factor**2))

    def own(self, values: Floats, factor: float) -> Floats:
        """Values (r, …) times the share of the covariance that is the factor's: 1 − U λ/(λ + s²) Uᵀ."""
        return self._without(values, self.shares(factor))

    def shares(self, factor: float) -> Floats:
        """The share (q,) of the variance along each direction that is common."""
        return np.asarray(self.squares / (self.squares + factor**2))

    def _without(self, values: Floats, taken: Floats) -> Floats:
        flat = values.reshape(len(values), -1)
        along = taken[:, None] * (self.vectors.T @ flat)
        return np.asarray((flat - self.vectors @ along).reshape(values.shape))

    def log_determinant(self, factor: float) -> float:
        """Of what makes them independent."""
        return float(-0.5 * np.log1p(self.squares / factor**2).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pattern:
    """How the residuals of block ``owner`` at ``lines`` (r,) depend on one another.

    ``raw`` (r, q) is Z, what common errors do to each line (None: there are none). ``lower`` (k, k) is the Cholesky
    factor of the covariance of a row's k components where that is unknown. ``unknown``: rho is to be estimated.
    """

    owner: int
    lines: Indices
    chains: Chains | None = None
    stated: Stated | None = None
    raw: csr_array | None = None
    common: Common | None = None
    lower: Floats | None = None
    unknown: bool = False

    @property
    def along(self) -> Chains | Stated | None:
        """The correlation along the rows."""
        return self.chains or self.stated

    def independent(self, values: Floats, factor: float) -> Floats:
        """Values (r, …) that are independent, of variance 1."""
        if self.lower is not None:
            rows = values.reshape(-1, len(self.lower), *values.shape[1:])
            flat = rows.reshape(len(rows), len(self.lower), -1)
            inverse = solve_triangular(self.lower, np.eye(len(self.lower)), lower=True)
            return np.asarray(np.einsum("ij,rjn->rin", inverse, flat).reshape(values.shape))
        found = values if self.along is None else self.along.independent(values)
        return found if self.common is None else self.common.independent(found, factor)

    def shared_out(self, parts: Floats, factor: float) -> tuple[Floats, Floats]:
        """Parts (r, k) of errors of independent residuals, by what causes them: the lines (r, k), common errors (q, k).

        With a correlation along the rows those of the lines are of the rows together only.
        """
        if self.lower is not None or self.common is None or self.raw is None:
            return parts, np.zeros((0, parts.shape[1]))
        own, raw = self.common.independent(parts, factor), self.raw
        effect = raw if self.along is None else csr_array(self.along.independent(np.asarray(raw.toarray())))
        return own, np.asarray(effect.T @ own) / factor

    def log_determinant(self, factor: float) -> float:
        """Of what makes them independent."""
        if self.lower is not None:
            return float(-np.log(np.diag(self.lower)).sum()) * (len(self.lines) // len(self.lower))
        found = 0.0
        if self.chains is not None:
            found += self.chains.log_determinant
        if self.stated is not None:
            found += self.stated.log_determinant * (len(self.lines) // len(self.stated.lower))
        return found if self.common is None else found + self.common.log_determinant(factor)

    def scale_image(self, values: Floats, factor: float) -> Floats:
        """What the logarithm of the factor's square adds to the covariance of independent residuals, times values."""
        return values if self.common is None else self.common.own(values, factor)

    def rho_image(self, values: Floats, factor: float) -> Floats:
        """The same of the correlation of neighbouring rows, for values (r, k)."""
        if self.chains is None:
            raise TypeError(self)
        if self.common is None:
            return self.chains.slope(values)
        return self.common.independent(self.chains.slope(self.common.independent(values, factor)), factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """What the blocks of a problem have of it; ``factors`` of patterns, by the block, where they are not 1."""

    patterns: tuple[Pattern, ...]
    factors: Mapping[int, float] = field(default_factory=dict)

    def scaled(self, factors: Floats | None) -> Structure:
        """The same where residuals are divided by ``factors`` (all residuals,) before (None: all 1)."""
        known = {} if factors is None else {p.owner: float(factors[p.lines[0]]) for p in self.patterns if len(p.lines)}
        return replace(self, factors=known)

    def factor(self, pattern: Pattern) -> float:
        """The factor of a pattern's block."""
        return self.factors.get(pattern.owner, 1.0)

    def make_independent(self, values: Floats) -> None:
        """Make whitened values (all residuals, …) independent, in place."""
        for pattern in self.patterns:
            values[pattern.lines] = pattern.independent(values[pattern.lines], self.factor(pattern))

    def shared_out(self, parts: Floats) -> tuple[Floats, dict[int, Floats]]:
        """Parts (k, all residuals) of errors of independent residuals: those of rows, and by block of common errors.

        The latter (k, q) are in the order of the clause's entries, of each those of its values as they first occur.
        """
        own, common = parts.copy(), {}
        for pattern in self.patterns:
            lines, found = pattern.shared_out(parts[:, pattern.lines].T, self.factor(pattern))
            own[:, pattern.lines], common[pattern.owner] = lines.T, found.T
        return own, common

    @property
    def log_determinant(self) -> float:
        """Of what makes them so."""
        return sum(pattern.log_determinant(self.factor(pattern)) for pattern in self.patterns)

    @property
    def estimated(self) -> bool:
        """More is to be estimated than factors that multiply all of the noise of their blocks."""
        return any(p.unknown or p.lower is not None or p.common is not None for p in self.patterns)

    def pattern(self, owner: int) -> Pattern | None:
        """That of a block."""
        return next((p for p in self.patterns if p.owner == owner), None)

    def replaced(self, pattern: Pattern) -> Structure:
        """The same with another pattern of its block."""
        return replace(self, patterns=tuple(pattern if p.owner == pattern.owner else p for p in self.patterns))
