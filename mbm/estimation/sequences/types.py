"""What a walk of a filter or smoother begins with, goes by, and ends with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.problem.tables import CellKey
from mbm.values import dataclass

Name: TypeAlias = tuple[str, CellKey | None, int]
"""A number or coordinate of a step: its unknown, the key of its member of a family, and which one of it it is."""

LEFT_OF_ROUNDINGS = 1e-9
"""Share of the longest direction below which another one is what roundings leave of it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """What is known before the first step: a point (N,), and a factor U (n, n) of the covariance ``UᵀU``, which may be
    singular.

    Nothing is known in the directions ``open`` (d, n), of which the covariance says nothing.
    """

    point: Floats
    factor: Floats
    open: Floats

    @staticmethod
    def of(point: Floats, covariance: Floats, unknown: Mask) -> Prior:
        """That of a covariance (n, n), nothing known of coordinates ``unknown`` (n,), whose rows are 0."""
        values, vectors = np.linalg.eigh(covariance)
        factor = np.ascontiguousarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
        return Prior(point=point, factor=factor, open=np.eye(len(covariance))[unknown])

    def filled(self) -> Prior:
        """The same with 0 where there is no start."""
        return replace(self, point=np.nan_to_num(self.point))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Carried:
    """A prior, and where each of its numbers (N,) and coordinates (n,) stands in it."""

    prior: Prior
    numbers: Mapping[Name, int]
    coordinates: Mapping[Name, int]

    def named(self, numbers: Sequence[Name], coordinates: Sequence[Name], starts: Floats) -> Prior:
        """The prior of these; what is not in it begins with ``starts`` (numbers,), and nothing is known of it."""
        point = starts.copy()
        for place, name in enumerate(numbers):
            if name in self.numbers:
                point[place] = self.prior.point[self.numbers[name]]
        there = np.array([name in self.coordinates for name in coordinates], dtype=bool)
        kept = [self.coordinates[name] for name in coordinates if name in self.coordinates]
        factor, none = np.zeros((len(there), len(there))), np.eye(len(there))[~there]
        known = np.linalg.qr(self.prior.factor[:, kept], mode="r")
        factor[: len(known), there] = known
        loose = np.zeros((len(self.prior.open), len(there)))
        loose[:, there] = self.prior.open[:, kept]
        _, sizes, directions = np.linalg.svd(loose, full_matrices=False)
        span = directions[sizes > LEFT_OF_ROUNDINGS * sizes.max(initial=0.0)]
        return Prior(point=point, factor=factor, open=np.concatenate([none, span]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """How a walk goes: ``iterations`` of an update at most, ``smooth`` with a ``lag`` in steps (None: all of them).

    ``cut``: inequalities cut; a cut beyond ``skip`` deviations is left out by a filter. A smoother that cuts takes
    ``sweeps`` over all steps at most until the cuts fit one another. ``tolerance`` in standard deviations.
    So many ``hypotheses`` at most are followed by a filter. ``endless``: steps come one by one, and the sequence holds
    as many as there is room for.
    """

    iterations: int = 1
    cut: bool = False
    skip: float = 3.0
    sweeps: int = 100
    tolerance: float = 1e-9
    smooth: bool = False
    hypotheses: int = 1
    lag: int | None = None
    endless: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A point (N,), the factor (n, n) of its covariance, and its cost."""

    point: Floats
    factor: Floats
    cost: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """What a walk says: points (T, N), factors (T, n, n) of covariances, open directions (T,), and costs (T,).

    ``followed`` (T,) hypotheses there were, and those of the last step are the ``crowd``, that of least cost first.
    ``touched`` (T, n) are the coordinates that open directions touch.

    So many ``equations`` among the constraints told something that was not known before.
    ``made`` steps were made: fewer than T where something was not finite at the next, or the user interrupted.
    """

    points: Floats
    factors: Floats
    opens: Indices
    touched: Mask
    followed: Indices
    crowd: tuple[Hypothesis, ...]
    costs: Floats
    cost: float
    made: int
    failed: bool
    settled: bool
    equations: int
    iterations: int
    evaluations: int

    @property
    def covariances(self) -> Floats:
        """(T, n, n)."""
        return np.asarray(np.swapaxes(self.factors, 1, 2) @ self.factors)
