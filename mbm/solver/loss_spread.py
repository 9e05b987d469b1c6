"""The factors of the sandwich covariance ``H⁻¹ G H⁻¹`` (Huber 1967) that one loss contributes, small samples minded.

With the weights w = ρ' of a loss's units and k the number of their components, ``A = Σ w JᵀJ`` is the information that
the weights leave; ``H = Σ tr Dψ/Σ w k A`` and ``G = Σ |ψ|²/Σ w k A``. ``total`` is ``Σ w k``, ``traces`` ``Σ tr Dψ``,
``squared_traces`` ``Σ (tr Dψ)²/k``, ``spread`` ``Σ |ψ|²``, ``count`` ``Σ k``; ``stated`` is ``total`` of the units
whose noise is stated, and ``share`` the number of unknowns that this loss's units determine.
"""

from __future__ import annotations

from math import fabs

from mbm.machine.words import Integer, Real
from mbm.solver.decisions import EXHAUSTED, TOLD
from mbm.solver.losses import loss_slope, loss_weight


def loss_trace(kind: Integer, square: Real, scale: Real, shape: Real, components: Integer) -> Real:
    """tr Dψ of a unit whose whitened residual has the squared norm ``square``: ``k ρ' + 2 ρ'' s``."""
    weight = loss_weight(kind, square, scale, shape)
    return float(components) * weight + 2.0 * loss_slope(kind, square, scale, shape) * square


def curvature_factor(traces: Real, total: Real) -> Real:
    """The factor of A in H, 0 where it is rounding of the weights."""
    slope = traces / max(total, 1e-300)
    return slope if fabs(slope) > EXHAUSTED else 0.0


def spread_factor(
    share: Real, total: Real, traces: Real, squared_traces: Real, spread: Real, count: Real, stated: Real
) -> Real:
    """The factor of A in G with Huber's correction ``K² n/(n − p)``, ``K = 1 + p/n var ψ'/(E ψ')²`` (Huber 1981, 7.6).

    Where p unknowns take up all that the n components say, no residual tells the spread, and what the noise was stated
    to be counts: 1. Where the weights leave fewer than `TOLD` degrees of freedom the factor is no less than that of
    stated noise, with which ``H⁻¹ G H⁻¹ = A⁻¹``, as far as the residuals cannot tell a smaller one.
    """
    freedom = count - share
    if freedom <= EXHAUSTED * count:
        return 1.0
    slope = curvature_factor(traces, total)
    bend = 0.0
    if slope > 0.0:
        bend = max(squared_traces * count / (traces * traces) - 1.0, 0.0)
    safe = max(total, 1e-300)
    whole = 1.0 + share / count * bend
    told = min(max((total - share) / TOLD, 0.0), 1.0)
    least = (1.0 - told) * slope * slope * stated / safe
    return max(spread / safe * whole * whole * count / freedom, least)
