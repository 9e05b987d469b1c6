"""Values of the inner problem: conditions on corrections, and the smallest corrections that meet them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Protocol, TypeVar

from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

ByComponent = TypeVar("ByComponent", bound="DataclassInstance")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """The conditions at a point: ``values`` h (R, k), ``slopes`` B = dh/du (R, k, q) and ``curvature`` (R, q, q), the
    second derivative of λᵀh by u; zero where it is not finite.
    """

    values: Floats
    slopes: Floats
    curvature: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredErrors:
    """P measured values with errors, of ``columns`` (P,), numbers of ``names``: tables and columns.

    ``rows`` (P,) count from 1 in the unfiltered table (below 1: a filter has left the row out), ``values`` are the
    cells, ``sigma`` their standard deviations. ``parts`` (k, P) is what an error of one standard deviation in each does
    to k quantities. All in SI.
    """

    names: tuple[tuple[str, str], ...]
    columns: Indices
    rows: Indices
    values: Floats
    sigma: Floats
    parts: Floats


class Conditions(Protocol):
    """R independent components, each with k equations in q corrections: h(u) = e for fixed unknowns.

    Corrections u are in standard deviations of what they correct. Equations are scaled so that their own noise e has
    variance 1 where ``noisy``, and 0 elsewhere.
    """

    @property
    def noisy(self) -> Mask:
        """Which equations have noise of their own, shape (R, k)."""
        ...

    @property
    def corrections(self) -> int:
        """q, the corrections of one component."""
        ...

    def some(self, components: Indices) -> Conditions:
        """Those of some components."""
        ...

    def at(self, corrections: Floats, multipliers: Floats) -> Local:
        """The conditions at ``corrections`` (R, q), their curvature weighted with ``multipliers`` λ (R, k)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feet:
    """The smallest corrections that meet the conditions: the foot of the measured point on them.

    ``corrections`` u (R, q), ``multipliers`` λ (R, k), ``slopes`` B (R, k, q) there, ``misclosures`` w = h(u) − B u
    (R, k); ``found`` (R,) is False where no foot was found.
    """

    corrections: Floats
    multipliers: Floats
    slopes: Floats
    misclosures: Floats
    found: Mask


def entered(whole: ByComponent, rows: Indices, part: ByComponent) -> ByComponent:
    """What holds arrays by component (R, …), with those of another in place of ``rows``."""
    mixed = {each.name: getattr(whole, each.name).copy() for each in fields(whole)}
    for name, values in mixed.items():
        values[rows] = getattr(part, name)
    return replace(whole, **mixed)
