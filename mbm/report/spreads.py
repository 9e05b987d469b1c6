"""How well a standard deviation is known, and what limits the value that it belongs to; all in SI."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.spreads import Moved
from mbm.problem.overrides import Law
from mbm.problem.tables import Table
from mbm.scales import Scale
from mbm.values import dataclass, replace

Floats: TypeAlias = NDArray[np.float64]

Ends: TypeAlias = Callable[[float], tuple[Floats, Floats]]
"""From a level to how far intervals of it reach below and above the values, NaN where the linear interval is right."""


@dataclass(frozen=True, slots=True, eq=False)
class Released:
    """Values without the limits that hold them, the values themselves where none does (NaN: not known); and the ends
    of intervals beside uncertain constants, which move all coordinates (M,) of the unknowns.
    """

    values: Callable[[], Floats]
    ends: Callable[[Moved], Ends]

    def each(self, change: Callable[[Floats], Floats]) -> Released:
        """The same with all arrays changed alike."""
        values, ends = self.values, self.ends
        return Released(lambda: change(values()), lambda moved: changed_ends(ends(moved), change))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Beside the standard deviations of an estimate or derived quantity, arrays of the same shape as these.

    ``dof`` are the effective degrees of freedom (infinite where the noise is stated), ``inflation`` by how much an
    interval is wider than these say; ``lower`` and ``upper`` are hard limits of the value (None: there are none);
    ``ends`` finds intervals where the curvature of the model misplaces the linear ones (None: nobody looks). Where a
    limit may hold something, ``released`` is what `considered` needs of it (None: nothing is held).
    """

    dof: Floats
    inflation: Floats
    lower: Floats | None = None
    upper: Floats | None = None
    ends: Ends | None = None
    released: Released | None = None

    def at(self, place: int | slice) -> Spread:
        """A part along the leading axis: one of many solves, or some coordinates."""
        return self.each(lambda values: np.asarray(values[place]))

    def shaped(self, shape: tuple[int, ...]) -> Spread:
        """The same in another shape."""
        return self.each(lambda values: values.reshape(shape))

    def each(self, change: Callable[[Floats], Floats]) -> Spread:
        """The same with all arrays changed alike, those of the ends too."""

        def other(values: Floats | None) -> Floats | None:
            return None if values is None else change(values)

        return replace(
            self,
            dof=change(self.dof),
            inflation=change(self.inflation),
            lower=other(self.lower),
            upper=other(self.upper),
            ends=None if self.ends is None else changed_ends(self.ends, change),
            released=None if self.released is None else self.released.each(change),
        )


def changed_ends(ends: Ends, change: Callable[[Floats], Floats]) -> Ends:
    """The same ends in other arrays."""

    def changed(level: float) -> tuple[Floats, Floats]:
        below, above = ends(level)
        return change(below), change(above)

    return changed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsideredConstant:
    """A constant (or an element of one) with a standard deviation ``sigma``: what it does to all that is reported.

    ``estimates`` and ``derived`` hold, for each of these and of the shape of its sigmas, the change that goes with one
    standard deviation of the constant. All in SI; ``unit`` with its ``scale`` is how it is shown (None: none is known).
    ``dof`` are the degrees of freedom of ``sigma``, ``law`` is that of the constant. ``elsewhere`` has that change of a
    derived quantity, by its name, for the rows of another table in the place of its own.
    """

    name: str
    value: float
    sigma: float
    unit: str | None
    scale: Scale
    dof: float
    law: Law
    estimates: tuple[Floats, ...] = ()
    derived: tuple[Floats, ...] = ()
    elsewhere: Callable[[str, Table], Floats] | None = None
