"""What sets of measurements tell of a quantity: the covariance of the stated measurements and of some candidates.

The covariance of each set is that of a solve with its rows: the same rank decision, constraints, datum and propagation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.triangle import triangle
from mbm.equations.types import Floats, Indices, Mask, Minimum, Observability
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
    nothing determines; ``minimum`` has the point and its constraints. ``moves`` (q, c) are what a standard deviation of
    each uncertain constant does to the numbers in a solve with all rows and candidates; what it leaves of their
    residuals stands in c further columns of ``rows`` and ``candidates``.
    """

    minimum: Minimum
    layout: Layout
    free: Indices
    gauge: Gauge
    rows: Floats
    candidates: tuple[Floats, ...]
    gradient: Floats
    moves: Floats

    def compressed(self) -> Information:
        """The same with n + c rows at most that tell what the measured ones do: R of their QR decomposition."""
        rows = triangle(self.rows) if len(self.rows) > 2 * self.rows.shape[1] > 0 else self.rows
        return replace(self, rows=rows)

    def stacked(self, counts: Indices) -> Floats:
        """The rows with those of each candidate as often as ``counts`` (one for each) says: (p, n + c)."""
        taken = [np.sqrt(count) * each for count, each in zip(counts.tolist(), self.candidates, strict=True) if count]
        return np.vstack([self.rows, *taken])

    def expected(self, counts: Indices) -> Expected:
        """What the measurements tell together with the candidates, each so many times."""
        return self.told(self.stacked(counts))

    @np.errstate(all="ignore")
    def told(self, rows: Floats) -> Expected:
        """What some rows (p, n + c) tell.

        From the numbers of all rows, moved with the constants, to those of some is a step −C·Jᵀr of least squares with
        the residuals r that all rows leave; it keeps to the constraints, as C does.
        """
        jacobian, left = np.split(rows, [self.gradient.shape[1]], axis=1)
        observed = self._observed(jacobian)
        there: Mask = np.asarray(np.isfinite(self.gradient).all(axis=1))
        gradient = np.where(there[:, None], self.gradient, 0.0)
        estimated = covariance(observed)
        found = propagate(gradient, observed, estimated)
        shift = self.moves - (gradient @ estimated.factor) @ (estimated.factor.T @ (jacobian.T @ left))
        weighted = gradient / observed.scale
        lengths = np.sqrt(np.square(weighted).sum(axis=1, keepdims=True))
        along = (weighted / np.where(lengths > 0.0, lengths, 1.0)) @ observed.null_space
        missing = int(np.linalg.matrix_rank(along, tol=SHARE)) if along.size else 0
        matrix = np.where(there[:, None] & there, found.matrix + shift @ shift.T, np.nan)
        return Expected(matrix=matrix, estimable=found.estimable & there, missing=missing + int((~there).sum()))

    def _observed(self, jacobian: Floats) -> Observability:
        """The rank decision for some rows."""
        minimum = replace(self.minimum, jacobian=jacobian, residuals=np.zeros(len(jacobian)))
        observed = observed_at(minimum, np.zeros(jacobian.shape[1]))
        return with_gauge(observed, self.layout, self.free, minimum.point, self.gauge)

    def volume(self, counts: Indices, scale: Floats) -> tuple[int, float]:
        """Rank, and the logarithm of the product of the singular values above zero, of the rows by a ``scale`` (n,)."""
        singular = np.asarray(
            np.linalg.svd(self._slopes(self.stacked(counts)) / scale, compute_uv=False), dtype=np.float64
        )
        rank = decided_rank(len(singular), singular)
        return rank, float(np.log(singular[:rank]).sum())

    def scale(self) -> Floats:
        """The column norms (n,) of all rows and candidates, 1 for empty columns."""
        norms = np.sqrt(sum(np.square(self._slopes(each)).sum(axis=0) for each in (self.rows, *self.candidates)))
        return np.where(norms > 0.0, norms, 1.0)

    def _slopes(self, rows: Floats) -> Floats:
        """Rows (p, n + c) without what belongs to the constants."""
        return rows[:, : self.gradient.shape[1]]

    def without(self, units: tuple[Indices, ...]) -> Floats:
        """Variances (u, q) without the rows of each unit; infinite where they do not determine the number any more.

        With A = rows·factor of the covariance, leaving out the rows A takes ``C(I + Aᵀ(I − AAᵀ)⁻¹A)Cᵀ`` (Sherman,
        Morrison and Woodbury) unless the unit alone determines something: then the rank is decided anew.
        """
        jacobian, left_over = np.split(self.rows, [self.gradient.shape[1]], axis=1)
        observed = self._observed(jacobian)
        estimated = covariance(observed)
        whole = propagate(self.gradient, observed, estimated)
        image, lines = self.gradient @ estimated.factor, jacobian @ estimated.factor
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
            pulled = lines.T @ left_over - part.T @ left_over[places]
            shift = self.moves - (image + (moved / values) @ vectors.T @ part) @ pulled
            found[number] += np.square(shift).sum(axis=1)
        return found
