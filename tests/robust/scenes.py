"""Measurement problems written in NumPy alone, with outliers, as consensus sees them (protocol ``Trials``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbm.solution.robust.units import Units
from mbm.solution.solvers.batched import minimise_all
from mbm.target.decisions import STATED


@dataclass(frozen=True)
class Model:
    """Residuals (T, m) and Jacobians (T, m, n) of points (T, n): any vectorised function of real unknowns."""

    evaluate: object
    dimension: int
    units: Units

    def linearised(self, points):
        return self.evaluate(points)

    def residuals(self, points):
        return self.evaluate(points)[0]

    def coordinates(self, points):
        return points

    def moved(self, points, steps):
        return points + steps

    def fitted(self, starts, subsets):
        always = np.flatnonzero(self.units.of_row < 0)
        rows = np.where(subsets >= 0, subsets, 0)[:, :, None] == self.units.of_row[None, None, :]
        weights = (rows & (subsets >= 0)[:, :, None]).any(axis=1).astype(float)
        weights[:, always] = 1.0
        return minimise_all(_Stack(self, weights), starts, iterations=20).points, np.arange(len(subsets))


@dataclass(frozen=True)
class _Stack:
    model: Model
    weights: np.ndarray

    @property
    def dimension(self):
        return self.model.dimension

    @property
    def count(self):
        return self.weights.shape[1]

    @property
    def lower(self):
        return np.full(self.dimension, -np.inf)

    @property
    def upper(self):
        return np.full(self.dimension, np.inf)

    @property
    def positive(self):
        return np.zeros(self.dimension, dtype=bool)

    def linearised(self, points, which):
        residuals, jacobian = self.model.evaluate(points)
        weights = self.weights[which]
        return residuals * weights, jacobian * weights[:, :, None]

    def coordinates(self, points):
        return points

    def moved(self, points, steps):
        return points + steps


def scalar_units(count, *, unknown=False):
    """Units of one component each, with stated noise or with one unknown factor."""
    return Units(
        of_row=np.arange(count),
        components=np.ones(count, dtype=np.int64),
        group=np.full(count, 0 if unknown else STATED),
        number=np.arange(count),
        rounding=np.full(count, 1e-28),
    )


def linear_model(design, values, *, unknown):
    """``values ≈ design @ x`` with noise 1."""

    def evaluate(points):
        return points @ design.T - values, np.tile(design, (len(points), 1, 1))

    return Model(evaluate, design.shape[1], scalar_units(len(values), unknown=unknown))


def range_model(stations, ranges, sigma, *, unknown=False):
    """Distances from an unknown place to known stations."""

    def evaluate(points):
        away = points[:, None, :] - stations
        distance = np.linalg.norm(away, axis=2)
        return (distance - ranges) / sigma, away / distance[:, :, None] / sigma

    return Model(evaluate, stations.shape[1], scalar_units(len(ranges), unknown=unknown))


CEILING = np.array([[x, y, 2.7] for x in np.linspace(1.0, 2.5, 6) for y in np.linspace(0.7, 2.8, 8)])
"""48 receivers in a ceiling, in m."""
