"""The answer of one solve, before it is made into a report: values, why it stopped, and how good the point is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.binding import Group
from mbm.equations.layout import Layout
from mbm.equations.spreads import Followed, Freedom, Influence, Limited
from mbm.equations.types import Covariance, Fit, Floats, Indices, Mask, Minimum, Noise, Observability
from mbm.problem.tables import CellKey, Table
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.corrected import CorrectedColumn
    from mbm.estimation.search.search import Alternative, Tally


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedSolution:
    """A derived quantity: ``values`` and ``sigma`` (rows, size), sigma NaN where the data do not determine it.

    ``freedom`` is that of the sigmas. ``reason`` says why the method has no sigma that the data would determine,
    ``undefined`` why a value that is not finite is none, where a call in it knows. ``gradient`` (rows·size, n) is with
    respect to the free numbers; None where it was left out for its size.
    """

    owner: int
    values: Floats
    sigma: Floats
    freedom: Freedom
    gradient: Floats | None
    reason: str | None = None
    undefined: str | None = None


Elsewhere: TypeAlias = Callable[[int, Table], DerivedSolution]
"""What derives a quantity, by its number, for the rows of another table in the place of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """One solve of several that could not be set up with its data: nothing was solved, ``diagnostics`` say why."""

    key: Mapping[str, CellKey]
    diagnostics: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Skipped:
    """A window with fewer rows than it should have: nothing was solved, and nothing is wrong."""

    key: Mapping[str, CellKey]
    rows: int
    wanted: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A hypothesis of a filter at the last step: numbers (N,) and sigma (n,) as a `Solution` has them, NaN elsewhere.

    ``weight`` is its probability among all that are followed.
    """

    cost: float
    weight: float
    numbers: Floats
    sigma: Floats


def no_alternatives() -> tuple[Alternative, ...]:
    """There are no other minima, or nobody asks for them."""
    return ()


def all_examined() -> Mapping[str, str]:
    """Everything was examined."""
    return {}


def no_profiles() -> Followed | None:
    """The linear intervals are right, or nothing is known of it."""
    return None


def no_doubts() -> tuple[Diagnostic, ...]:
    """Nothing more is to be said."""
    return ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """One solve.

    ``numbers`` (N,) are all unknowns in SI, ``free`` the positions of the estimated coordinates; ``noise`` has an entry
    for each block with an unknown factor; ``factors`` are the noise factors per residual that the estimates hold with
    (None: all 1); ``residuals`` are all whitened ones without losses, those of rows left out included, ``weights``
    (same shape, None: all 1) what they counted, ``outliers`` which of them are taken for such (None: none);
    ``robust_cost`` is the sum of the losses, None without one; ``unused`` are coordinates of members that no equation
    mentions. ``origin`` says where the start came from.
    ``corrections`` has those of measured columns with errors, ``hypotheses`` those that a filter follows at the last
    step, and ``followed`` says how many there were after each. ``freedom`` are the degrees of freedom of the standard
    deviations, ``limited`` hard limits (None: there are none). ``influence`` tells what the covariance is the sum of
    (None: of a filter, which has no sum over rows). ``elsewhere`` derives for other rows (None: nothing can be).
    ``doubts`` looks for further ``diagnostics``, ``doubts_of`` for those that other residuals (m,) with such a fit
    would give reason for (None: nothing is known of it), ``alternatives`` for other minima, ``profiles`` for intervals
    where the linear ones are wrong (None: nowhere). ``unexamined`` says what was not looked at, and why. Whatever is
    worked out with the ``groups`` holds the ``lock``: other solves put their numbers into the same inputs of kernels.
    """

    key: Mapping[str, CellKey]
    tables: Mapping[str, Table]
    layout: Layout
    groups: tuple[Group, ...]
    constraints: tuple[Group, ...]
    numbers: Floats
    free: Indices
    minimum: Minimum
    residuals: Floats
    weights: Floats | None
    outliers: Mask | None
    robust_cost: float | None
    log_likelihood: float | None = None
    alternatives: Callable[[], tuple[Alternative, ...]] = no_alternatives
    tally: Tally | None
    origin: str
    observability: Observability
    covariance: Covariance
    derived_covariance: NDArray[np.float64] | None
    derived: tuple[DerivedSolution, ...]
    fit: Fit
    noise: Mapping[int, Noise]
    factors: Floats | None
    sigma_known: bool
    freedom: Freedom
    limited: Limited | None
    unused: Indices
    corrections: tuple[CorrectedColumn, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()
    followed: tuple[int, ...] = ()
    method: str
    iterations: int
    evaluations: int
    seconds: float
    diagnostics: tuple[Diagnostic, ...]
    doubts: Callable[[], tuple[Diagnostic, ...]] = no_doubts
    doubts_of: Callable[[Floats, Fit], tuple[Diagnostic, ...]] | None = None
    profiles: Callable[[], Followed | None] = no_profiles
    unexamined: Callable[[], Mapping[str, str]] = all_examined
    influence: Influence | None = None
    elsewhere: Elsewhere | None = None
    lock: AbstractContextManager[object]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alone:
    """A solve that was made one by one where others are made together, and its number (from 0) among all."""

    place: int
    solution: Solution | Failure | Skipped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawRows:
    """What the equations of a block say, MODEL − MEASURED, in one solve or in many: rows of one case of its equations.

    ``values`` (R, outputs) of solve ``solve`` (R,), ascending; ``counting`` (R, outputs) says which of them count,
    ``behind`` (R,) where a point is behind its camera (None: there is none). ``rows`` (R,) are those of the unfiltered
    table, from 1.
    """

    owner: int
    case: int
    solve: Indices
    values: Floats
    counting: Mask
    behind: Mask | None
    rows: Indices
