"""Conformance of methods that find minima, on small problems whose answers are known."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import field

import numpy as np

from mbm.equations.types import Equations, Floats, Mask, Minimum, Reason
from mbm.testing.requirement import require, require_close
from mbm.values import dataclass

ITERATIONS = 500
"""Steps within which every sample has to be solved: far more than any sound method takes."""

DIGITS = 1e-6
"""Relative error of an answer: half the digits of a number, which any second-order method exceeds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Equations written by hand, where they are solved from, and where their minimum lies."""

    name: str
    function: Callable[[Floats], Floats] = field(repr=False)
    derivative: Callable[[Floats], Floats] = field(repr=False)
    start: Floats
    answer: Floats
    lower: Floats
    upper: Floats
    linear: bool = False

    @property
    def dimension(self) -> int:
        """n."""
        return len(self.start)

    @property
    def count(self) -> int:
        """m."""
        return len(self.function(self.answer))

    @property
    def positive(self) -> Mask:
        """No coordinate has to be positive."""
        return np.zeros(self.dimension, dtype=bool)

    def residuals(self, x: Floats) -> Floats:
        """r(x), shape (m,)."""
        with np.errstate(all="ignore"):
            return self.function(x)

    def jacobian(self, x: Floats) -> Floats:
        """dr/dx, shape (m, n)."""
        with np.errstate(all="ignore"):
            return self.derivative(x)

    def coordinates(self, x: Floats) -> Floats:
        """``x``."""
        return x

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        """The coordinates are the point."""
        return coordinates

    def retract(self, x: Floats, step: Floats) -> Floats:
        """``x + step``."""
        moved: Floats = x + step
        return moved


def _sample(
    name: str,
    function: Callable[[Floats], Floats],
    derivative: Callable[[Floats], Floats],
    start: list[float],
    answer: list[float],
    *,
    upper: float = np.inf,
    linear: bool = False,
) -> Sample:
    count = len(start)
    return Sample(
        name=name,
        function=function,
        derivative=derivative,
        start=np.array(start),
        answer=np.array(answer),
        lower=np.full(count, -np.inf),
        upper=np.full(count, upper),
        linear=linear,
    )


TIMES = np.array([0.0, 1.0, 2.0, 3.0])


def samples() -> tuple[Sample, ...]:
    """The problems: linear, curved, with a bound in the way, and with a region where the model has no value."""
    line = np.stack([np.ones(4), TIMES], axis=1)
    return (
        _sample(
            "a line through (0 1) (1 3) (2 4) (3 4)",
            lambda x: line @ x - np.array([1.0, 3.0, 4.0, 4.0]),
            lambda _: line,
            [0.0, 0.0],
            [1.5, 1.0],
            linear=True,
        ),
        _sample(
            "Rosenbrock's valley",
            lambda x: np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]),
            lambda x: np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]]),
            [-1.2, 1.0],
            [1.0, 1.0],
        ),
        _sample(
            "an exponential decay",
            lambda x: x[0] * np.exp(-x[1] * TIMES) - 2.0 * np.exp(-0.5 * TIMES),
            lambda x: np.stack([np.exp(-x[1] * TIMES), -x[0] * TIMES * np.exp(-x[1] * TIMES)], axis=1),
            [1.0, 1.0],
            [2.0, 0.5],
        ),
        _sample(
            "a point beyond the bound 1",
            lambda x: np.array([x[0] - 2.0, x[1] - 0.25]),
            lambda _: np.eye(2),
            [0.0, 0.0],
            [1.0, 0.25],
            upper=1.0,
        ),
        _sample(
            "a logarithm, undefined below 0",
            lambda x: np.array([3.0 * np.log(x[0]) - 3.0, 0.0]),
            lambda x: np.array([[3.0 / x[0]], [0.0]]),
            [20.0],
            [float(np.e)],
        ),
    )


Minimise = Callable[[Equations, Floats, int], Minimum]
"""The minimum of equations from a start, after so many iterations at most."""


def check_method(name: str, minimise: Minimise, suited: Iterable[Sample] | None = None) -> None:
    """Whether a method keeps what is promised of all, on those of the `samples` that it is made for (None: all).

    Raises:
        NotConformingError: it does not; the text says what was promised.

    """
    for sample in samples() if suited is None else suited:
        _check_sample(minimise, sample, f"method `{name}`, {sample.name}")


def _check_sample(minimise: Minimise, sample: Sample, subject: str) -> None:
    before = float(np.square(sample.residuals(sample.start)).sum())
    for most in range(ITERATIONS):
        found, again = (minimise(sample, sample.start.copy(), most) for _ in range(2))
        require(bool(np.array_equal(found.point, again.point)), subject, "the same start leads to the same point")
        inside = (found.point >= sample.lower) & (found.point <= sample.upper)
        require(bool(inside.all()), subject, f"it never leaves the bounds: {found.point}")
        require(found.cost <= before * (1 + 1e-12), subject, f"the cost never grows: {before} → {found.cost}")
        before = found.cost
        if found.reason is not Reason.MAX_ITERATIONS:
            break
        require(found.iterations <= most, subject, f"it stops after {most} iterations where it is told to")
    else:
        require(kept=False, subject=subject, promise=f"it finishes within {ITERATIONS} steps")
        return
    require(found.reason.converged, subject, f"it converges; it stopped because {found.reason.sentence}")
    require_close(found.point, sample.answer, DIGITS, subject, "the minimum is where it is known to be")
    _check_consistency(sample, found, subject)


def _check_consistency(sample: Sample, minimum: Minimum, subject: str) -> None:
    residuals = sample.residuals(minimum.point)
    require_close(minimum.residuals, residuals, 1e-12, subject, "residuals are those at the point")
    require_close(minimum.jacobian, sample.jacobian(minimum.point), 1e-12, subject, "the Jacobian is that at the point")
    require_close(minimum.cost, residuals @ residuals, 1e-12, subject, "the cost is the sum of squares at the point")
    held = np.where(sample.answer == sample.upper, 1, 0)
    require_close(minimum.at_bound, held, 0.0, subject, "`at_bound` is +1 at an upper bound and 0 elsewhere")
