"""What mbm itself makes of the data of compile time: answers to be found again, and what goes into the solver."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.emit.foreign import Foreign
from mbm.solver.range_maps import RangeMaps
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.serialised import BoundRows

Floats: TypeAlias = NDArray[np.float64]

FAILED = "failed"
"""The status of a data set that no solve could be set up for: nothing to compare with."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """What ``mbm solve`` answered for the data of compile time, one for each solve: what the test wants to see again.

    ``numbers`` (N,) are the estimates in SI, ``spread`` (N,) the standard deviations of plain ones (0 else),
    ``covariance`` (n, n) that of the estimated coordinates (NaN: not determined). ``start`` (N,) is where the solver
    begins: as the problem states, and where it states nothing at the answer. ``elsewhere`` (N,) is where the test
    begins instead (None: at ``start``): where that is the answer, or does not lead there. ``derived`` has values and
    standard deviations (rows, size) of each derived quantity. ``condition`` is that of the Jacobian with columns of
    length 1.
    """

    status: str
    numbers: Floats
    spread: Floats
    covariance: Floats
    derived: tuple[tuple[Floats, Floats], ...]
    cost: float
    dof: int
    start: Floats
    elsewhere: Floats | None
    condition: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedRows:
    """The rows of a derived quantity: ``bound`` for each case, and ``values`` at the answer, one case after the other.

    ``rows`` (rows,) are their places in the table, from 0. Each has as many values as ``sigma``, their standard
    deviations (NaN: not known).
    """

    bound: tuple[BoundRows, ...]
    rows: tuple[int, ...]
    values: Floats
    sigma: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whole:
    """All rows of the first solve: the start (N,), the coordinates' names (n,), the rows of each kernel.

    ``residuals`` (m,) and ``jacobian`` (m, n) are the whitened ones at the start. ``derived`` are at ``answer`` (N,),
    whose coordinates have the ``covariance`` (n, n).
    """

    start: Floats
    names: tuple[Foreign, ...]
    bound: tuple[BoundRows, ...]
    residuals: Floats
    jacobian: Floats
    answer: Floats
    covariance: Floats
    derived: tuple[DerivedRows, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """Consensus before a solve, by the estimator ``kind``, as `mbm.solver.consensus_records` has it.

    ``kept``: what does not agree is left out; else it says where losses begin, and how large their noise is; or it is
    asked for a start alone (``begins``), by a solve that has none otherwise. ``rules``
    and ``levels`` are without the capacities, which the data decide. ``maps`` and ``map_places`` (types of units) say
    what the closed form that fits subsets knows of a row, see `mbm.emit.routines.forms`; ``sign`` is that of lines of
    sight. ``startless`` are the unknowns (positions) for which it gives a start where the caller states none.
    """

    kind: str
    kept: bool
    begins: bool
    rules: tuple[int, ...]
    levels: tuple[float, ...]
    map_places: tuple[int, ...]
    maps: tuple[float, ...]
    sign: float
    startless: frozenset[int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answers:
    """What mbm itself makes of the data of compile time, and what it prepares for other data."""

    references: tuple[Reference, ...]
    whole: Whole
    agreement: Agreement | None
    ranges: RangeMaps | None
