"""Small constrained problems written down by hand, in the shape that the solvers take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Function = Callable[[Floats], Floats]


def differences(function: Function, x: Floats) -> Floats:
    """Jacobian by complex steps: exact to rounding for the analytic functions of the tests."""
    columns = []
    for j in range(x.size):
        moved = x.astype(np.complex128)
        moved[j] += 1e-30j
        columns.append(np.imag(np.asarray(function(moved))) / 1e-30)  # type: ignore[arg-type]
    return np.array(columns).T.reshape(-1, x.size)


@dataclass(frozen=True, kw_only=True)
class Toy:
    """``min Σ r²`` with ``equal = 0`` and ``below <= 0``, in the box."""

    function: Function
    size: int
    rows: int
    equal: Function | None = None
    below: Function | None = None
    low: Floats | None = None
    high: Floats | None = None
    linear: bool = False
    counts: tuple[int, int] = field(default=(0, 0))

    @property
    def dimension(self) -> int:
        return self.size

    @property
    def count(self) -> int:
        return self.rows

    @property
    def lower(self) -> Floats:
        return np.full(self.size, -np.inf) if self.low is None else self.low

    @property
    def upper(self) -> Floats:
        return np.full(self.size, np.inf) if self.high is None else self.high

    @property
    def positive(self) -> NDArray[np.bool_]:
        return np.zeros(self.size, dtype=bool)

    @property
    def equality(self) -> NDArray[np.bool_]:
        return np.arange(sum(self.counts)) < self.counts[0]

    def residuals(self, x: Floats) -> Floats:
        return np.asarray(self.function(x), dtype=np.float64)

    def jacobian(self, x: Floats) -> Floats:
        return differences(self.function, x)

    def constraint_values(self, x: Floats) -> Floats:
        parts = [np.asarray(f(x), dtype=np.float64) for f in (self.equal, self.below) if f is not None]
        return np.concatenate(parts) if parts else np.zeros(0)

    def constraint_jacobian(self, x: Floats) -> Floats:
        parts = [differences(f, x) for f in (self.equal, self.below) if f is not None]
        return np.vstack(parts) if parts else np.zeros((0, self.size))

    def retract(self, x: Floats, step: Floats) -> Floats:
        return x + step

    def coordinates(self, x: Floats) -> Floats:
        return x

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        return coordinates


def toy(
    function: Function,
    start: Floats,
    *,
    equal: Function | None = None,
    below: Function | None = None,
    low: Floats | None = None,
    high: Floats | None = None,
    linear: bool = False,
) -> Toy:
    """A problem; the numbers of rows are found at the start."""
    counts = tuple(0 if f is None else len(np.atleast_1d(f(start))) for f in (equal, below))
    return Toy(
        function=function,
        size=start.size,
        rows=len(function(start)),
        equal=equal,
        below=below,
        low=low,
        high=high,
        linear=linear,
        counts=(counts[0], counts[1]),
    )
