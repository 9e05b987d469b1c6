"""How derived quantities vary with the states of their own step, and together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.sequences.own_steps import SEVERAL
from mbm.estimation.sequences.types import Track
from mbm.values import dataclass

ONE_AT_A_TIME = "this method keeps no covariance between different steps (`:method batch` does)"

TOGETHER = 2000
"""Derived numbers up to which the covariance of all of them is a matrix."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """A derived quantity in each row: its ``steps`` (rows,), and ``lines`` (rows, size, n), the deviations that the
    normal variates of its step give it: their products are covariances. NaN where there are none.
    """

    steps: Indices
    lines: Floats

    @staticmethod
    def blank(rows: int, size: int, dimension: int) -> Deviations:
        """With nothing known."""
        return Deviations(steps=np.zeros(rows, dtype=np.int64), lines=np.full((rows, size, dimension), np.nan))

    def put(self, positions: Indices, steps: Indices, slopes: Floats, track: Track) -> None:
        """Let rows at ``positions`` have these slopes (rows, size, n) by what varies at their ``steps``."""
        known = (steps != SEVERAL) & (steps < track.made)
        at = np.where(known, steps, 0)
        lines = np.einsum("rfn,ron->rof", track.factors[at], slopes)
        loose = (np.where(track.touched[at][:, None, :], slopes, 0.0) != 0.0).any(axis=2)
        self.steps[positions] = steps
        self.lines[positions] = np.where((known[:, None] & ~loose)[..., None], lines, np.nan)

    @property
    def sigma(self) -> Floats:
        """Standard deviations (rows, size); NaN where a step is not determined, or several are in one row."""
        return np.asarray(np.sqrt(np.square(self.lines).sum(axis=2)))


def joint(derived: Sequence[Deviations]) -> Floats | None:
    """The covariance of derived quantities (k, k), NaN between different steps; None where there are too many."""
    sizes = [each.lines.shape[0] * each.lines.shape[1] for each in derived]
    if not sizes or sum(sizes) > TOGETHER:
        return None
    lines = np.concatenate([each.lines.reshape(-1, each.lines.shape[2]) for each in derived])
    steps = np.concatenate([np.repeat(each.steps, each.lines.shape[1]) for each in derived])
    return np.where(steps[:, None] == steps, lines @ lines.T, np.nan)
