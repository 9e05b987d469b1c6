"""What ``:loss`` says as functions of residuals: the formulas of `mbm.solver.losses`, element by element.

A parameter that is not stated gives 95 % of the efficiency of least squares where there are no outliers. For a residual
r of d independent components with variance 1, and ψ(r) = ρ'(|r|²) r, the asymptotic efficiency is
``(E[ρ' s])² / (d E[ρ'² s])`` with s = |r|² ~ χ²_d (Hampel et al. 1986, 2.3; ``E tr Dψ = E ψ·r`` by Stein's lemma).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from itertools import pairwise
from math import lgamma, log, sqrt
from typing import Any, TypeAlias

import numpy as np

from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Floats
from mbm.problem.kinds import LossKind
from mbm.problem.types import Loss
from mbm.solver import losses as formulas
from mbm.solver.loss_spread import loss_trace
from mbm.values import dataclass

RelativeWeight = Callable[[Floats], Floats]
"""ρ' as a function of t = s/c²."""
EFFICIENCY = 0.95
LEAST, MOST = 1e-3, 1e3
"""The parameter in units of √d lies between these for every loss that has one."""
NODES = 100
REACH = 14.0
"""χ_d lies below √d + this but for 1e-40: nothing of the integrals is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFunction:
    """A loss with its parameter ``scale`` c > 0 in standard deviations; ``shape`` is that of Barron's family.

    ``squares`` are s ≥ 0 of any shape, which the answers have too. Residuals with equal losses are treated together.
    """

    kind: LossKind
    scale: float
    shape: float = 0.0

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r."""
        traits = formulas.LOSSES[self.kind]
        return traits.convex if traits.convex_from is None else self.shape >= traits.convex_from

    @property
    def number(self) -> int:
        """Its kind for the solver."""
        return formulas.LOSSES[self.kind].number

    def weight(self, squares: Floats) -> Floats:
        """ρ'(s): the weight of the residual in iterated reweighting, 1 at s = 0."""
        return of_arrays(formulas.loss_weight)(self.number, squares, self.scale, self.shape)

    def trace(self, squares: Floats, components: int) -> Floats:
        """tr Dψ of residuals of so many components."""
        return of_arrays(loss_trace)(self.number, squares, self.scale, self.shape, components)

    def root_factor(self, squares: Floats) -> Floats:
        """``q = √(ρ(s)/s)``, so that ``r̃ = q r`` has ``|r̃|² = ρ(s)``."""
        return of_arrays(formulas.root_factor)(self.number, squares, self.scale, self.shape)

    def root_slope(self, squares: Floats, factor: Floats) -> Floats:
        """dq/ds where the ``factor`` is q."""
        return of_arrays(formulas.root_slope)(self.number, squares, self.scale, self.shape, factor)


def loss_function(asked: Loss, components: int) -> LossFunction:
    """The loss for residuals of so many components; a parameter left out is the one of 95 % efficiency."""
    shape = 0.0 if asked.shape is None else asked.shape
    if asked.scale is not None:
        return LossFunction(kind=asked.kind, scale=asked.scale, shape=shape)
    known = formulas.LOSSES[asked.kind].scales
    if components <= len(known):
        return LossFunction(kind=asked.kind, scale=known[components - 1], shape=shape)
    unit = LossFunction(kind=asked.kind, scale=1.0, shape=shape)
    return LossFunction(kind=asked.kind, scale=tuned(unit.weight, components), shape=shape)


def rooted(loss: LossFunction, residuals: Floats) -> Floats:
    """``r̃ = r √(ρ(s)/s)`` for each unit; ``residuals`` (…, components), whitened."""
    return np.asarray(residuals * loss.root_factor(np.square(residuals).sum(axis=-1))[..., None])


def rooted_jacobian(loss: LossFunction, residuals: Floats, jacobian: Floats) -> Floats:
    """dr̃/dx = q J + 2 q' r (rᵀJ), exact; ``jacobian`` (units, components, n) belongs to the plain ``residuals``."""
    squares = np.square(residuals).sum(axis=1)
    factor = loss.root_factor(squares)
    change = loss.root_slope(squares, factor)
    along = np.einsum("uk,ukn->un", residuals, jacobian)
    bent = (2.0 * change[:, None] * residuals)[:, :, None] * along[:, None, :]
    return np.asarray(factor[:, None, None] * jacobian + bent)


Acting: TypeAlias = tuple[LossFunction, Any]
"""A loss, and the index that picks the residuals (units, components) of its units from all of them."""


def rooted_residuals(acting: Iterable[Acting], plain: Floats) -> Floats:
    """Residuals in square-root form, of the shape of the ``plain`` ones."""
    result = plain.copy()
    for loss, at in acting:
        result[at] = rooted(loss, plain[at])
    return result


def rooted_slopes(acting: Iterable[Acting], plain: Floats, slopes: Floats) -> Floats:
    """Their derivatives, from those of the ``plain`` ones; both of the shape of these and one axis more."""
    result = slopes.copy()
    for loss, at in acting:
        result[at] = rooted_jacobian(loss, plain[at], slopes[at])
    return result


def loss_weights(acting: Iterable[Acting], plain: Floats) -> Floats:
    """ρ' of the ``plain`` residuals; 1 without a loss."""
    weights = np.ones(plain.shape)
    for loss, at in acting:
        weights[at] = loss.weight(np.square(plain[at]).sum(axis=-1))[..., None]
    return weights


def efficiency(weight: RelativeWeight, scale: float, components: int) -> float:
    """The asymptotic efficiency of the loss with the parameter ``scale``, for residuals of so many components."""
    norms, density = _chi(scale, components)
    squares = np.square(norms)
    weights = weight(squares / (scale * scale))
    slope = float((density * weights * squares).sum())
    spread = float((density * np.square(weights) * squares).sum())
    return slope * slope / (components * spread)


def tuned(weight: RelativeWeight, components: int, wanted: float = EFFICIENCY) -> float:
    """The least parameter with the efficiency ``wanted``; √d where all have more than that (many components, a = 2)."""
    root = sqrt(components)
    low, high = LEAST * root, MOST * root
    if efficiency(weight, low, components) >= wanted:
        return root
    while high - low > 1e-13 * high:
        middle = sqrt(low * high)
        if middle in (low, high):
            break
        if efficiency(weight, middle, components) < wanted:
            low = middle
        else:
            high = middle
    return high


@cache
def _gauss(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights; to make a hundred takes longer than the integral."""
    found: tuple[Floats, Floats] = np.polynomial.legendre.leggauss(count)  # loaded here, for few losses ask for it
    return found


def _chi(scale: float, components: int) -> tuple[Floats, Floats]:
    """Nodes on the norms and the χ_d density times the weights; the loss's corner at ``scale`` lies between two."""
    top = sqrt(components) + REACH
    ends = (0.0, min(scale, top), top)
    nodes, weights = _gauss(NODES)
    norms = np.concatenate([a + (b - a) * 0.5 * (nodes + 1.0) for a, b in pairwise(ends)])
    widths = np.concatenate([0.5 * (b - a) * weights for a, b in pairwise(ends)])
    logarithm = (components - 1) * np.log(np.maximum(norms, 1e-300)) - 0.5 * norms * norms
    front = (1.0 - 0.5 * components) * log(2.0) - lgamma(0.5 * components)
    return norms, np.asarray(widths * np.exp(front + logarithm))
