"""The nonlinear regression sets of the NIST Statistical Reference Datasets: their models, and equations made of them.

Data and certified values are works of the Fused States government (NIST/ITL StRD, https://www.itl.nist.gov/div898/strd/).
Jacobians are by the complex step (Squire and Trapp 1998), exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceSet:
    """One set: data, the two starts, certified values, standard deviations and residual sum of squares."""

    name: str
    x: np.ndarray
    y: np.ndarray
    starts: tuple[np.ndarray, np.ndarray]
    certified: np.ndarray
    deviations: np.ndarray
    sum_of_squares: float
    model: Callable


def exponentials(b, x):
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def gauss(b, x):
    return (
        b[0] * np.exp(-b[1] * x)
        + b[2] * np.exp(-((x - b[3]) ** 2) / b[4] ** 2)
        + b[5] * np.exp(-((x - b[6]) ** 2) / b[7] ** 2)
    )


def chwirut(b, x):
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


def enso(b, x):
    turn = 2 * np.pi * x
    return (
        b[0]
        + b[1] * np.cos(turn / 12)
        + b[2] * np.sin(turn / 12)
        + b[4] * np.cos(turn / b[3])
        + b[5] * np.sin(turn / b[3])
        + b[7] * np.cos(turn / b[6])
        + b[8] * np.sin(turn / b[6])
    )


def cubic_over_cubic(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


MODELS: dict[str, Callable] = {
    "Chwirut1": chwirut,
    "Chwirut2": chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": enso,
    "Gauss1": gauss,
    "Gauss2": gauss,
    "Gauss3": gauss,
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": exponentials,
    "Lanczos2": exponentials,
    "Lanczos3": exponentials,
    "Misra1a": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "BoxBOD": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Thurber": cubic_over_cubic,
    "Hahn1": cubic_over_cubic,
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
}


def numbers(text: str) -> np.ndarray:
    return np.array([float(v) for v in text.split()])


def typed(
    name: str, x: str, y: str, starts: tuple[str, str], certified: str, deviations: str, squares: float
) -> ReferenceSet:
    """A set whose columns are given as texts."""
    return ReferenceSet(
        name=name,
        x=numbers(x),
        y=numbers(y),
        starts=(numbers(starts[0]), numbers(starts[1])),
        certified=numbers(certified),
        deviations=numbers(deviations),
        sum_of_squares=squares,
        model=MODELS[name],
    )


class Regression:
    """A reference set as equations: residual = model - y."""

    linear = False

    def __init__(self, reference: ReferenceSet) -> None:
        self.reference = reference
        self.dimension = len(reference.certified)
        self.count = len(reference.y)
        self.lower = np.full(self.dimension, -np.inf)
        self.upper = np.full(self.dimension, np.inf)
        self.positive = np.zeros(self.dimension, bool)
        self.calls = 0

    def residuals(self, x):
        self.calls += 1
        with np.errstate(all="ignore"):
            return self.reference.model(x, self.reference.x) - self.reference.y

    def jacobian(self, x):
        columns = []
        for j in range(self.dimension):
            moved = x.astype(complex)
            moved[j] += 1e-100j
            with np.errstate(all="ignore"):
                value = self.reference.model(moved, self.reference.x)
            columns.append((np.broadcast_to(value, self.reference.y.shape)).imag / 1e-100)
        return np.array(columns).T

    def coordinates(self, x):
        return x

    def placed(self, x, coordinates):
        return coordinates

    def retract(self, x, step):
        return x + step


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Fewest correct digits (log relative error) of the parameters, at most the 11 that are certified."""
    error = np.max(np.abs(found - certified) / np.abs(certified))
    return float(min(11.0, -np.log10(error))) if error > 0 else 11.0
