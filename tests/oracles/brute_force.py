"""Consensus by brute force: every minimal sample of a few rows is fitted exactly, and scored. Nothing of mbm's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from tests.oracles.kinds import Kind

Columns = dict[str, np.ndarray]
LIMIT = 3.0
"""Standard deviations within which rows agree where noise is stated (docs/explanations/consensus.md)."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A model of rows: its text, residuals (…, m) in units of measurement of points (…, n), fits to minimal samples.

    ``fitted`` gives the points (k, n) that meet a sample of ``size`` rows; ``sigma`` is the noise.
    """

    unknowns: Mapping[str, str]
    equation: str
    size: int
    sigma: float
    draw: Callable[[np.random.Generator, int, int], Columns]
    residuals: Callable[[np.ndarray, Columns], np.ndarray]
    fitted: Callable[[Columns, np.ndarray], np.ndarray]

    def kind(self, noise: str, rule: str, rows: int = 12) -> Kind:
        """The problem as those of `catalogue`, with up to four rows of ``rows`` wrong."""
        data = self.draw(np.random.default_rng(0), rows, 0)
        return Kind(
            unknowns=self.unknowns,
            clauses=f"(observe d {self.equation} :sigma {noise}) (solve :robust {rule})",
            draw=lambda generator: {"d": self.draw(generator, rows, int(generator.integers(0, 5)))},
            residuals=lambda x, tables: self.residuals(x, tables["d"]) / self.sigma,
            start=(0.0,) * self.size,
            given=tuple(f"d.{name}" for name in data),
        )

    def samples(self, data: Columns) -> Iterator[np.ndarray]:
        """The points that minimal samples give."""
        rows = len(next(iter(data.values())))
        for sample in combinations(range(rows), self.size):
            yield from self.fitted(data, np.array(sample))

    def squares(self, point: np.ndarray, data: Columns) -> np.ndarray:
        """Squared residuals (m,) in standard deviations."""
        return (self.residuals(point, data) / self.sigma) ** 2

    def refit(self, data: Columns, inside: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Least squares of some rows."""
        kept = {name: column[inside] for name, column in data.items()}
        found = least_squares(
            lambda x: self.residuals(x, kept) / self.sigma, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, method="lm"
        )
        return np.asarray(found.x)


def truncated(squares: np.ndarray, limit: float = LIMIT**2) -> float:
    """What MSAC minimises (Torr and Zisserman 2000), in units of the limit."""
    return float(np.minimum(squares / limit, 1.0).sum())


def outliers(squares: np.ndarray, limit: float = LIMIT**2) -> int:
    """What RANSAC minimises (Fischler and Bolles 1981)."""
    return int((squares > limit).sum())


def order_statistic(squares: np.ndarray, size: int) -> float:
    """What LMedS minimises: the square of rank ⌊n/2⌋ + ⌊(p + 1)/2⌋ (Rousseeuw and Leroy 1987, 3.4)."""
    return float(np.sort(squares)[min(len(squares) // 2 + (size + 1) // 2, len(squares)) - 1])


def linear(columns: Callable[[Columns], np.ndarray], size: int):
    """Residuals and exact fits of a model that is linear in its unknowns."""

    def residuals(point, data):
        return columns(data) @ point - data["y"]

    def fitted(data, sample):
        matrix = columns(data)[sample]
        if abs(np.linalg.det(matrix)) < 1e-9:
            return np.empty((0, size))
        return np.linalg.solve(matrix, data["y"][sample])[None]

    return {"residuals": residuals, "fitted": fitted, "size": size}


def drawn(columns: Callable[[Columns], np.ndarray], names: str, sigma: float):
    """Data of a linear model, the first rows grossly wrong, each by itself."""

    def draw(generator, rows, wrong):
        data = {name: generator.uniform(-3, 3, rows) for name in names}
        data["y"] = np.zeros(rows)
        matrix = columns(data)
        data["y"] = matrix @ generator.normal(size=matrix.shape[1]) + sigma * generator.normal(size=rows)
        data["y"][:wrong] += generator.uniform(8, 300, wrong) * sigma * generator.choice([-1, 1], wrong)
        return data

    return draw


def level_columns(data):
    return np.ones((len(data["y"]), 1))


def line_columns(data):
    return np.stack([np.ones(len(data["x"])), data["x"]], axis=1)


def plane_columns(data):
    return np.stack([np.ones(len(data["x"])), data["x"], data["z"]], axis=1)


def place_drawn(generator, rows, wrong):
    turn = generator.uniform(0, 2 * np.pi, rows)
    x, y = 10 * np.cos(turn), 10 * np.sin(turn)
    place = generator.uniform(-4, 4, 2)
    r = np.hypot(x - place[0], y - place[1]) + 0.05 * generator.normal(size=rows)
    r[:wrong] += generator.uniform(0.4, 6, wrong)
    return {"x": x, "y": y, "r": r}


def place_residuals(point, data):
    return np.hypot(data["x"] - point[0], data["y"] - point[1]) - data["r"]


def crossings(data, sample):
    """Where two circles meet: none, or two points."""
    a, b = (np.array([data["x"][i], data["y"][i]]) for i in sample)
    across, (r, s) = b - a, data["r"][sample]
    distance = np.hypot(*across)
    along = (distance**2 + r**2 - s**2) / (2 * distance)
    if along**2 > r**2:
        return np.empty((0, 2))
    side = np.sqrt(r**2 - along**2) * np.array([-across[1], across[0]]) / distance
    foot = a + along * across / distance
    return np.stack([foot + side, foot - side])


SCENES = {
    "level": Scene(
        unknowns={"a": ":init 0"}, equation="(= y {a})", sigma=0.1, draw=drawn(level_columns, "", 0.1),
        **linear(level_columns, 1),
    ),
    "line": Scene(
        unknowns={"a": ":init 0", "b": ":init 0"}, equation="(= y (+ {a} (* {b} x)))", sigma=0.1,
        draw=drawn(line_columns, "x", 0.1), **linear(line_columns, 2),
    ),
    "plane": Scene(
        unknowns={"a": ":init 0", "b": ":init 0", "c": ":init 0"}, sigma=0.1,
        equation="(= y (+ {a} (* {b} x) (* {c} z)))",
        draw=drawn(plane_columns, "xz", 0.1), **linear(plane_columns, 3),
    ),
    "place": Scene(
        unknowns={"p": "(vector 2) :init [0.5 0.5]"}, equation="(= r (distance {p} [x y]))", sigma=0.05, size=2,
        draw=place_drawn, residuals=place_residuals, fitted=crossings,
    ),
}  # fmt: skip
