"""Parameters at which a loss has 95 % of the efficiency of least squares where there are no outliers.

For a residual r of d independent components with variance 1, and ψ(r) = ρ'(|r|²) r, the asymptotic efficiency is
``(E[ρ' s])² / (d E[ρ'² s])`` with s = |r|² ~ χ²_d (Hampel et al. 1986, 2.3; ``E tr Dψ = E ψ·r`` by Stein's lemma).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import lgamma, log, sqrt

import numpy as np

from mbm.equations.types import Floats

RelativeWeight = Callable[[Floats], Floats]
"""ρ' as a function of t = s/c²."""

EFFICIENCY = 0.95
LEAST, MOST = 1e-3, 1e3
"""The parameter in units of √d lies between these for every loss that has one."""

NODES = 100
REACH = 14.0
"""χ_d lies below √d + this but for 1e-40: nothing of the integrals is left out."""


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


def _chi(scale: float, components: int) -> tuple[Floats, Floats]:
    """Nodes on the norms and the χ_d density times the weights; the loss's corner at ``scale`` lies between two."""
    top = sqrt(components) + REACH
    ends = (0.0, min(scale, top), top)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    norms = np.concatenate([a + (b - a) * 0.5 * (nodes + 1.0) for a, b in pairwise(ends)])
    widths = np.concatenate([0.5 * (b - a) * weights for a, b in pairwise(ends)])
    logarithm = (components - 1) * np.log(np.maximum(norms, 1e-300)) - 0.5 * norms * norms
    front = (1.0 - 0.5 * components) * log(2.0) - lgamma(0.5 * components)
    return norms, np.asarray(widths * np.exp(front + logarithm))
