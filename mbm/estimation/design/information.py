"""What sets of measurements tell of a quantity: the covariance of the stated measurements and of some candidates.

The covariance of each set is that of a solve with its rows: the same rank decision, constraints, datum and propagation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.triangle import triangle
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.uncertainty.covariance import covariance, propagate
from mbm.estimation.uncertainty.gauge import with_gauge
from mbm.estimation.uncertainty.observability import observed_at
from mbm.problem.kinds import Gauge
from mbm.solver.decisions import SHARE, decided_rank
from mbm.values import dataclass

SAFE = 1e-6
"""Smallest eigenvalue of I − leverage of the rows left out down to which a covariance without them follows from the one
with them: ten digits are left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expected:
    """What a set of measurements tells of q numbers: their ``matrix`` (q, q), NaN where it does not determine them.

    ``missing`` counts the independent combinations of them that are free; ``estimable`` (q,) are determined.
    """

    matrix: Floats
    estimable: Mask
    missing: int

    @property
    def determined(self) -> bool:
        """Whether all numbers are."""
        return bool(self.estimable.all())

    @property
    def sigma(self) -> Floats:
        """Standard deviations (q,)."""
        return np.asarray(np.sqrt(np.diag(self.matrix)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Information:
    """The whitened Jacobian at a point: ``rows`` (m, n) of what is measured, and (k, n) of each of the ``candidates``.

    ``gradient`` (q, n) is that of the quantity by the free coordinates ``free``, NaN of numbers without a value, which
    nothing determines; ``minimum`` has the point and its constraints.
    """

    minimum: Minimum
    layout: Layout
    free: Indices
    gauge: Gauge
    rows: Floats
    candidates: tuple[Floats, ...]
    gradient: Floats

    def compressed(self) -> Information:
        """The same with n rows at most that tell what the measured ones do: R of their QR decomposition."""
        rows = triangle(self.rows) if len(self.rows) > 2 * self.rows.shape[1] > 0 else self.rows
        return replace(self, rows=rows)

    def stacked(self, counts: Indices) -> Floats:
        """The rows with those of each candidate as often as ``counts`` (c,) says: (p, n)."""
        taken = [np.sqrt(count) * each for count, each in zip(counts.tolist(), self.candidates, strict=True) if count]
        return np.vstack([self.rows, *taken])

    def expected(self, counts: Indices) -> Expected:
        """What the measurements tell together with the candidates, each so many times."""
        return self.told(self.stacked(counts))

    @np.errstate(all="ignore")
    def told(self, rows: Floats) -> Expected:
        """What some rows (p, n) tell."""
        minimum = replace(self.minimum, jacobian=rows, residuals=np.zeros(len(rows)))
        observed = observed_at(minimum, np.zeros(rows.shape[1]))
        observed = with_gauge(observed, self.layout, self.free, minimum.point, self.gauge)
        there: Mask = np.asarray(np.isfinite(self.gradient).all(axis=1))
        gradient = np.where(there[:, None], self.gradient, 0.0)
        found = propagate(gradient, observed, covariance(observed))
        weighted = gradient / observed.scale
        lengths = np.sqrt(np.square(weighted).sum(axis=1, keepdims=True))
        along = (weighted / np.where(lengths > 0.0, lengths, 1.0)) @ observed.null_space
        missing = int(np.linalg.matrix_rank(along, tol=SHARE)) if along.size else 0
        matrix = np.where(there[:, None] & there, found.matrix, np.nan)
        return Expected(matrix=matrix, estimable=found.estimable & there, missing=missing + int((~there).sum()))

    def volume(self, counts: Indices, scale: Floats) -> tuple[int, float]:
        """Rank, and the logarithm of the product of the singular values above zero, of the rows by a ``scale`` (n,)."""
        singular = np.asarray(np.linalg.svd(self.stacked(counts) / scale, compute_uv=False), dtype=np.float64)
        rank = decided_rank(len(singular), singular)
        return rank, float(np.log(singular[:rank]).sum())

    def scale(self) -> Floats:
        """The column norms (n,) of all rows and candidates, 1 for empty columns."""
        norms = np.sqrt(
            sum((np.square(each).sum(axis=0) for each in self.candidates), np.square(self.rows).sum(axis=0))
        )
        return np.where(norms > 0.0, norms, 1.0)

    def without(self, units: tuple[Indices, ...]) -> Floats:
        """Variances (u, q) without the rows of each unit; infinite where they do not determine the number any more.

        With A = rows·factor of the covariance, leaving out the rows A takes ``C(I + Aᵀ(I − AAᵀ)⁻¹A)Cᵀ`` (Sherman,
        Morrison and Woodbury) unless the unit alone determines something: then the rank is decided anew.
        """
        minimum = replace(self.minimum, jacobian=self.rows, residuals=np.zeros(len(self.rows)))
        observed = observed_at(minimum, np.zeros(self.rows.shape[1]))
        observed = with_gauge(observed, self.layout, self.free, minimum.point, self.gauge)
        estimated = covariance(observed)
        whole = propagate(self.gradient, observed, estimated)
        image, lines = self.gradient @ estimated.factor, self.rows @ estimated.factor
        found = np.empty((len(units), len(self.gradient)))
        for number, places in enumerate(units):
            part = lines[places]
            left = np.eye(len(places)) - part @ part.T
            values, vectors = np.linalg.eigh(left)
            if values[0] < SAFE or not bool(whole.estimable.all()):
                told = self.told(np.delete(self.rows, places, axis=0))
                found[number] = np.where(told.estimable, np.diag(told.matrix), np.inf)
                continue
            moved = (image @ part.T) @ vectors
            found[number] = np.square(image).sum(axis=1) + (np.square(moved) / values).sum(axis=1)
        return found
