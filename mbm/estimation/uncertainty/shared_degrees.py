"""Degrees of freedom where rows share noise that is estimated, by the rules of Satterthwaite, and Kenward and Roger.

Parameters of noise that rows share: how the covariance of the residuals depends on each.

With residuals made independent, V = 1, and ``G_j = dV/dθ_j`` gives the restricted likelihood's score ``½ (wᵀG_j w −
tr P G_j)`` and its expected information ``½ tr P G_i P G_j``, where P = 1 − hat matrix (Patterson and Thompson 1971).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, sqrt
from typing import Protocol

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.structure import Pattern
from mbm.equations.types import Covariance, Floats, Indices, Minimum, Noise, NoiseState
from mbm.estimation.uncertainty.degrees import UNINFORMED, Freedoms
from mbm.values import dataclass


class NoiseParameter(Protocol):
    """One number that the noise depends on."""

    def image(self, values: Floats) -> Floats:
        """G times values (m, k)."""
        ...

    @property
    def trace(self) -> float:
        """That of G."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scale:
    """The logarithm of the square of a factor: of the ``plain`` residuals, and of ``patterns`` with the factor s."""

    plain: Indices
    patterns: tuple[Pattern, ...]
    factor: float

    def image(self, values: Floats) -> Floats:
        """G times values (m, k)."""
        found = np.zeros_like(values)
        found[self.plain] = values[self.plain]
        for pattern in self.patterns:
            found[pattern.lines] = pattern.scale_image(values[pattern.lines], self.factor)
        return found

    @property
    def trace(self) -> float:
        """That of G."""
        common = sum(float(p.common.shares(self.factor).sum()) for p in self.patterns if p.common is not None)
        return len(self.plain) + sum(len(p.lines) for p in self.patterns) - common


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rho:
    """The correlation of neighbouring rows of a ``pattern`` with the factor s; by arctanh rho, which has no bounds."""

    pattern: Pattern
    factor: float

    @property
    def rate(self) -> float:
        """drho/dz where z = arctanh rho."""
        return 1.0 - self.pattern.chains.rho**2 if self.pattern.chains is not None else 0.0

    def image(self, values: Floats) -> Floats:
        """G times values (m, k)."""
        found = np.zeros_like(values)
        lines = self.pattern.lines
        found[lines] = self.rate * self.pattern.rho_image(values[lines], self.factor)
        return found

    def along_common(self) -> tuple[Floats, Floats, Floats]:
        """Along the directions U of common errors: their shares, UᵀGU of the correlation, and the lengths² of GU."""
        common, chains = self.pattern.common, self.pattern.chains
        if common is None or chains is None:
            return np.zeros(0), np.zeros((0, 0)), np.zeros(0)
        vectors = np.asarray(common.vectors.toarray())
        moved = chains.slope(vectors)
        return common.shares(self.factor), vectors.T @ moved, np.square(moved).sum(axis=0)

    @property
    def trace(self) -> float:
        """That of G."""
        shares, along, _ = self.along_common()
        return self.rate * (self._traces[0] - float(shares @ np.diag(along)))

    @property
    def square_trace(self) -> float:
        """That of G²."""
        shares, along, lengths = self.along_common()
        own = self._traces[1] - 2.0 * float(shares @ lengths) + float(shares @ np.square(along) @ shares)
        return self.rate**2 * own

    @property
    def _traces(self) -> tuple[float, float]:
        return self.pattern.chains.slope_traces if self.pattern.chains is not None else (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """An entry (i, j) of the covariance of the components of a row, as independent residuals have it."""

    pattern: Pattern
    basis: Floats

    def image(self, values: Floats) -> Floats:
        """G times values (m, k)."""
        found = np.zeros_like(values)
        lines = self.pattern.lines
        rows = values[lines].reshape(-1, len(self.basis), values.shape[1])
        found[lines] = np.einsum("ij,rjn->rin", self.basis, rows).reshape(len(lines), -1)
        return found

    @property
    def trace(self) -> float:
        """That of G."""
        return float(np.trace(self.basis)) * self.rows

    @property
    def rows(self) -> int:
        """Rows of the pattern."""
        return len(self.pattern.lines) // len(self.basis)


def entries(pattern: Pattern) -> tuple[Entry, ...]:
    """An orthonormal basis of the symmetric matrices of a pattern with an unknown covariance."""
    size = 0 if pattern.lower is None else len(pattern.lower)
    found = []
    for i in range(size):
        for j in range(i + 1):
            basis = np.zeros((size, size))
            basis[i, j] = basis[j, i] = 1.0 if i == j else sqrt(0.5)
            found.append(Entry(pattern=pattern, basis=basis))
    return tuple(found)


def product_trace(first: NoiseParameter, second: NoiseParameter) -> float:
    """The trace of the product of two G."""
    if isinstance(first, Entry) and isinstance(second, Entry):
        same = first.pattern is second.pattern
        return first.rows * float((first.basis * second.basis).sum()) if same else 0.0
    if isinstance(first, Scale) and isinstance(second, Scale):
        if first is not second:
            return 0.0
        every = [p.common.shares(first.factor) for p in first.patterns if p.common is not None]
        lines = len(first.plain) + sum(len(p.lines) for p in first.patterns)
        return lines - sum(float((1.0 - np.square(1.0 - each)).sum()) for each in every)
    if isinstance(first, Rho) and isinstance(second, Rho):
        return first.square_trace if first.pattern is second.pattern else 0.0
    if isinstance(first, Rho):
        first, second = second, first
    if not (isinstance(first, Scale) and isinstance(second, Rho)):
        return 0.0
    if not any(p is second.pattern for p in first.patterns):
        return 0.0
    shares, along, _ = second.along_common()
    return second.rate * (second._traces[0] - float((1.0 - np.square(1.0 - shares)) @ np.diag(along)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Told:
    """What independent residuals say of p parameters at a minimum.

    ``squares`` and ``expected`` (p,) are wᵀGw and what it is on average; ``information`` (p, p) is tr P G P G, on
    average half of ``observed``, 2 wᵀ G P G w (Gilmour, Thompson and Cullis 1995). With the Jacobian
    times a factor of the covariance, A (m, k): ``grams`` AᵀGA (p, k, k), ``products`` AᵀGGA (p, p, k, k).
    """

    squares: Floats
    expected: Floats
    information: Floats
    observed: Floats
    grams: Floats
    products: Floats


def told(parameters: Sequence[NoiseParameter], residuals: Floats, basis: Floats) -> Told:
    """What residuals (m,) say, where ``basis`` (m, k) is the whitened Jacobian times a factor of the covariance."""
    count = len(parameters)
    moved = [parameter.image(basis) for parameter in parameters]
    grams = np.array([basis.T @ each for each in moved]).reshape(count, basis.shape[1], basis.shape[1])
    products = np.array([[a.T @ b for b in moved] for a in moved]).reshape(count, count, *grams.shape[1:])
    traces = np.array([[product_trace(a, b) for b in parameters] for a in parameters]).reshape(count, count)
    crossed = np.einsum("iab,jba->ij", grams, grams)
    seen = np.array([parameter.image(residuals[:, None])[:, 0] for parameter in parameters]).reshape(count, -1)
    within = seen @ basis
    return Told(
        squares=seen @ residuals,
        observed=2.0 * (seen @ seen.T - within @ within.T),
        expected=np.array([p.trace for p in parameters]) - np.einsum("iaa->i", grams),
        information=traces - 2.0 * np.einsum("ijaa->ij", products) + crossed,
        grams=grams,
        products=products,
    )


def shared_freedoms(
    equations: Assembled,
    minimum: Minimum,
    covariance: Covariance,
    noise: Mapping[int, Noise],
    groups: Sequence[tuple[int, ...]],
) -> Freedoms | None:
    """The degrees of freedom at a minimum; None where all that rows share is stated, but for factors of all of it.

    The covariance of the noise's parameters is the inverse of their expected restricted information.
    """
    parameters = noise_parameters(equations, noise, groups)
    if parameters is None:
        return None
    scaled = [blocks for blocks in groups if noise[blocks[0]].state is NoiseState.ESTIMATED]
    owners = [(each.pattern.owner,) for each in parameters if isinstance(each, Entry)]
    others = [()] * (len(parameters) - len(scaled) - len(owners))
    said = told(parameters, minimum.residuals, minimum.jacobian @ covariance.factor)
    scatter = 2.0 * np.linalg.pinv(said.information, rcond=UNINFORMED, hermitian=True)
    return Freedoms(
        dof=inf,
        factor=covariance.factor,
        grams=said.grams,
        scatter=np.asarray(scatter),
        products=np.einsum("ij,ijab->ab", scatter, said.products),
        estimated=(*scaled, *others, *owners),
    )


def noise_parameters(
    equations: Assembled, noise: Mapping[int, Noise], groups: Sequence[tuple[int, ...]]
) -> list[NoiseParameter] | None:
    """What was estimated of the noise, as `shared_freedoms` has it; ``groups`` are blocks that share a factor."""
    structure = equations.structure
    if structure is None:
        return None
    told_by = {number for number, each in noise.items() if each.state is NoiseState.ESTIMATED}
    mine = [p for p in structure.patterns if p.owner in told_by]
    if not any(p.unknown or p.lower is not None or p.common is not None for p in mine):
        return None
    found: list[NoiseParameter] = [
        scale_of(equations, structure.patterns, blocks, noise[blocks[0]].factor)
        for blocks in groups
        if blocks[0] in told_by
    ]
    found += [Rho(pattern=pattern, factor=structure.factor(pattern)) for pattern in mine if pattern.unknown]
    return [*found, *(entry for pattern in mine for entry in entries(pattern))]


def scale_of(equations: Assembled, patterns: Sequence[Pattern], blocks: Sequence[int], factor: float) -> Scale:
    """The parameter of an unknown factor; patterns without an unknown part are as if their rows were independent."""
    mixed = tuple(p for p in patterns if p.owner in blocks and (p.common is not None or p.unknown))
    plain = [equations.block_rows(number) for number in blocks if number not in {p.owner for p in mixed}]
    lines: Indices = np.concatenate(plain) if plain else np.zeros(0, dtype=np.int64)
    return Scale(plain=lines, patterns=mixed, factor=factor)
