"""Some solves at their minima, as those see them who look at what the residuals tell: one, or many side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.solves import Lines, Solves
from mbm.equations.types import Floats, Mask
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

Said: TypeAlias = Iterator[tuple[int, Callable[[], Diagnostic]]]
"""Warnings, each with the place of the solve (from 0) that it is about."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fits:
    """K solves at their minima.

    ``residuals`` (K, m) are whitened, those with losses in square-root form, 0 where a solve has less; ``pull`` (K, m)
    are the same with losses as they pull: whitened times their weight. They follow the estimates in the orthonormal
    directions ``basis`` (K, m, k); ``image`` (K, m, k) is their Jacobian times a factor of the covariance, but for one
    unknown noise that all rows share: that multiplies standard deviations by ``noise`` (K,). ``held`` (K,): limits hold
    estimates. ``stated`` makes the standard deviations (K, m) without that noise, ``redundancy`` the shares (m,) of the
    residuals of a solve that show in them.
    """

    problem: Problem
    tables: Mapping[str, Table]
    solves: Solves
    residuals: Floats
    pull: Floats
    basis: Floats
    image: Floats
    noise: Floats
    held: Mask
    stated: Callable[[], Floats]
    redundancy: Callable[[int], Floats]

    def deviations(self) -> Floats:
        """The standard deviations (K, m) as estimated."""
        return self.stated() * self.noise[:, None]

    def errors(self) -> Floats:
        """What the model is larger by (K, m) than the readings of rows with one each."""
        return self.residuals * self.stated()

    def of_rows(self, of: Callable[[Lines], NDArray[Any] | None], missing: float = np.nan) -> NDArray[Any]:
        """Numbers (K, m) of residuals, from those (R, outputs) ``of`` the rows of each group (None: ``missing``)."""
        return self.solves.by_slot([of(each) for each in self.solves.lines], missing)

    def column(self, owner: int, table: str, name: str) -> Floats:
        """The numbers (K, m) of a column in the rows of a block of single equations; NaN for other rows."""
        numbers = self.tables[table].numbers(name)
        return self.of_rows(lambda each: numbers[each.positions][:, None] if each.group.kernel.owner == owner else None)


def only(said: Said) -> tuple[Diagnostic, ...]:
    """The warnings about the only solve that there is."""
    return tuple(make() for _, make in said)
