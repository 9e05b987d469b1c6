"""Test problems of Moré, Garbow and Hillstrom (1981, ACM TOMS 7, 17–41), with the minima they list.

Residuals accept complex arguments, so that Jacobians come exact to rounding by the complex step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(kw_only=True)
class Functions:
    """Equations from a residual function; bounds and the rest as wanted."""

    function: Callable
    start: tuple[float, ...]
    linear: bool = False
    lower: np.ndarray | None = None
    upper: np.ndarray | None = None
    positive: np.ndarray | None = None
    gradient: Callable | None = None
    points: list = field(default_factory=list)

    def __post_init__(self) -> None:
        n = len(self.start)
        self.dimension = n
        self.count = len(np.asarray(self.function(np.array(self.start))))
        self.lower = np.full(n, -np.inf) if self.lower is None else np.asarray(self.lower, float)
        self.upper = np.full(n, np.inf) if self.upper is None else np.asarray(self.upper, float)
        self.positive = np.zeros(n, bool) if self.positive is None else np.asarray(self.positive)

    def residuals(self, x):
        self.points.append(x)
        return np.asarray(self.function(x), dtype=float)

    def jacobian(self, x):
        if self.gradient is not None:
            return np.asarray(self.gradient(x), dtype=float)
        columns = []
        for j in range(self.dimension):
            moved = x.astype(complex)
            moved[j] += 1e-100j
            columns.append(np.asarray(self.function(moved)).imag / 1e-100)
        return np.array(columns).T

    def coordinates(self, x):
        return x

    def placed(self, x, coordinates):
        return coordinates

    def retract(self, x, step):
        return x + step


def numbers(text: str) -> list[float]:
    return [float(v) for v in text.split()]


def rosenbrock(x):
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def freudenstein_roth(x):
    return np.array([-13 + x[0] + ((5 - x[1]) * x[1] - 2) * x[1], -29 + x[0] + ((x[1] + 1) * x[1] - 14) * x[1]])


def powell_badly_scaled(x):
    return np.array([1e4 * x[0] * x[1] - 1, np.exp(-x[0]) + np.exp(-x[1]) - 1.0001])


def brown_badly_scaled(x):
    return np.array([x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2])


def beale(x):
    return np.array([y - x[0] * (1 - x[1] ** i) for i, y in ((1, 1.5), (2, 2.25), (3, 2.625))])


def jennrich_sampson(x):
    i = np.arange(1, 11)
    return 2 + 2 * i - (np.exp(i * x[0]) + np.exp(i * x[1]))


def helical_valley(x):
    angle = np.arctan(x[1] / x[0]) / (2 * np.pi) + (0.5 if x[0].real < 0 else 0.0)
    return np.array([10 * (x[2] - 10 * angle), 10 * (np.sqrt(x[0] ** 2 + x[1] ** 2) - 1), x[2]])


def bard(x):
    y = np.array([0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39])
    u = np.arange(1, 16)
    v = 16 - u
    return y - (x[0] + u / (v * x[1] + np.minimum(u, v) * x[2]))


def meyer(x):
    y = np.array(
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872], float
    )
    return x[0] * np.exp(x[1] / (45 + 5 * np.arange(1, 17) + x[2])) - y


def box_three(x):
    t = 0.1 * np.arange(1, 11)
    return np.exp(-t * x[0]) - np.exp(-t * x[1]) - x[2] * (np.exp(-t) - np.exp(-10 * t))


def powell_singular(x):
    return np.array([x[0] + 10 * x[1], 5**0.5 * (x[2] - x[3]), (x[1] - 2 * x[2]) ** 2, 10**0.5 * (x[0] - x[3]) ** 2])


def wood(x):
    return np.array(
        [
            10 * (x[1] - x[0] ** 2),
            1 - x[0],
            90**0.5 * (x[3] - x[2] ** 2),
            1 - x[2],
            10**0.5 * (x[1] + x[3] - 2),
            10**-0.5 * (x[1] - x[3]),
        ]
    )


def kowalik_osborne(x):
    y = np.array([0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246])
    u = np.array([4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])
    return y - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def brown_dennis(x):
    t = np.arange(1, 21) / 5
    return (x[0] + t * x[1] - np.exp(t)) ** 2 + (x[2] + x[3] * np.sin(t) - np.cos(t)) ** 2


OSBORNE_1 = np.array(
    numbers(
        "0.844 0.908 0.932 0.936 0.925 0.908 0.881 0.850 0.818 0.784 0.751 0.718 0.685 0.658 0.628 0.603 0.580 "
        "0.558 0.538 0.522 0.506 0.490 0.478 0.467 0.457 0.448 0.438 0.431 0.424 0.420 0.414 0.411 0.406 "
    )
)


def osborne_one(x):
    t = 10.0 * np.arange(33)
    return OSBORNE_1 - (x[0] + x[1] * np.exp(-t * x[3]) + x[2] * np.exp(-t * x[4]))


OSBORNE_2 = np.array(
    numbers(
        "1.366 1.191 1.112 1.013 0.991 0.885 0.831 0.847 0.786 0.725 0.746 0.679 0.608 0.655 0.616 0.606 0.602 "
        "0.626 0.651 0.724 0.649 0.649 0.694 0.644 0.624 0.661 0.612 0.558 0.533 0.495 0.500 0.423 0.395 0.375 "
        "0.372 0.391 0.396 0.405 0.428 0.429 0.523 0.562 0.607 0.653 0.672 0.708 0.633 0.668 0.645 0.632 0.591 "
        "0.559 0.597 0.625 0.739 0.710 0.729 0.720 0.636 0.581 0.428 0.292 0.162 0.098 0.054 "
    )
)


def osborne_two(x):
    t = np.arange(65) / 10
    return OSBORNE_2 - (
        x[0] * np.exp(-t * x[4])
        + x[1] * np.exp(-((t - x[8]) ** 2) * x[5])
        + x[2] * np.exp(-((t - x[9]) ** 2) * x[6])
        + x[3] * np.exp(-((t - x[10]) ** 2) * x[7])
    )


CLASSICS: dict[str, tuple[Callable, tuple[float, ...], tuple[float, ...], tuple[int, ...]]] = {
    # name: residuals, standard start, minima of Σ r² in the paper, factors of the start that are solved
    "Rosenbrock": (rosenbrock, (-1.2, 1), (0.0,), (1, 10, 100)),
    "Freudenstein-Roth": (freudenstein_roth, (0.5, -2), (0.0, 48.9842), (1, 10, 100)),
    "Powell badly scaled": (powell_badly_scaled, (0, 1), (0.0,), (1,)),
    "Brown badly scaled": (brown_badly_scaled, (1, 1), (0.0,), (1, 10, 100)),
    "Beale": (beale, (1, 1), (0.0,), (1,)),
    "Jennrich-Sampson": (jennrich_sampson, (0.3, 0.4), (124.362,), (1, 10)),
    "Helical valley": (helical_valley, (-1, 0, 0), (0.0,), (1, 10, 100)),
    "Bard": (bard, (1, 1, 1), (8.21487e-3, 17.42869), (1, 10, 100)),
    "Meyer": (meyer, (0.02, 4000, 250), (87.9458,), (1, 10, 100)),
    "Box three-dimensional": (box_three, (0, 10, 20), (0.0,), (1,)),
    "Powell singular": (powell_singular, (3, -1, 0, 1), (0.0,), (1, 10, 100)),
    "Wood": (wood, (-3, -1, -3, -1), (0.0,), (1, 10, 100)),
    "Kowalik-Osborne": (kowalik_osborne, (0.25, 0.39, 0.415, 0.39), (3.07505e-4, 1.02734e-3), (1, 100)),
    "Brown-Dennis": (brown_dennis, (25, 5, -5, -1), (85822.2,), (1, 10, 100)),
    "Osborne 1": (osborne_one, (0.5, 1.5, -1, 0.01, 0.02), (5.46489e-5,), (1, 10, 100)),
    "Osborne 2": (osborne_two, (1.3, 0.65, 0.65, 0.7, 0.6, 3, 5, 7, 2, 4.5, 5.5), (4.01377e-2,), (1,)),
}
