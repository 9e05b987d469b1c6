"""Values of the simulation: what is asked for, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from types import MappingProxyType

from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Indices
from mbm.expression.evaluate import Calls
from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey
from mbm.text.types import Diagnostic
from mbm.values import dataclass

ValuesFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The true values (SI, by name) for the solve with a key; NaN or absent where none is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownNoise:
    """What is known of unknown noise: a factor, the correlation of neighbours, the covariance (k, k) of a row."""

    factor: float | None = None
    rho: float | None = None
    covariance: Floats | None = None


NoiseFinder = Callable[[Mapping[str, CellKey]], Mapping[str, KnownNoise]]
"""What is known of unknown noise, by clause or factor, for the solve with a key."""

NOT_KNOWN = KnownNoise()
"""Factor 1, rows that are independent, components of variance 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outliers:
    """Gross errors: each equation and row has one with probability ``fraction``, of ``size`` standard deviations.

    Its direction in the space of the whitened components is random, or all of them grow if ``one_sided``.
    """

    fraction: float
    size: float
    one_sided: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulating:
    """How to simulate: a data set for each of the ``seeds``, one below the other.

    ``measured`` names the columns of observations whose equations leave open what they measure. With ``kernels`` (and
    their cache), what has a prior is drawn from it. ``carrying`` (the same) carries states from step to step. ``calls``
    calls functions in Python. ``exact``: without noise.
    """

    seeds: tuple[int, ...]
    outliers: Outliers | None = None
    measured: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    kernels: tuple[KernelSet, EvaluationCache] | None = None
    carrying: tuple[KernelSet, EvaluationCache] | None = None
    calls: Calls | None = None
    exact: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """New numbers (SI) for cells of a column; ``rows`` are numbers from 1 in the unfiltered table, each once.

    They go on from one data set to the next, as if the table stood there again and again.
    """

    table: str
    column: str
    rows: Indices
    numbers: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """The true values of one solve: ``numbers`` (N,) as its layout has them; ``outliers`` rows by observation."""

    key: Mapping[str, CellKey]
    layout: Layout
    numbers: Floats
    outliers: Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulation:
    """What was simulated: cells of columns, the truth of each solve, and what had to be assumed (warnings)."""

    cells: tuple[Cells, ...]
    truths: tuple[Truth, ...]
    notes: tuple[Diagnostic, ...]
