"""Values of the report stage: what a solved problem is, before it becomes a document, a table or a picture.

Numbers are SI throughout; a `Quantity` says in which unit they are shown, and every output uses its scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.corrected import CorrectedColumn
from mbm.files.journal import Read
from mbm.report.row_data import Map, NoiseReport, PlotData, RawResiduals, ResidualRow, ResidualSummary, RowData
from mbm.report.spreads import ConsideredConstant, Spread
from mbm.scales import SI, Scale
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.search.search import Tally
    from mbm.estimation.search.solution import Solution
    from mbm.problem.types import Problem
    from mbm.report.options import PropagationSettings
    from mbm.report.view.seeings import Seen

Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Key: TypeAlias = str | float


class Kind(StrEnum):
    """What a quantity is; ``Kind("angle")`` reads the word."""

    REAL = "real"
    POSITIVE = "positive"
    ANGLE = "angle"
    VECTOR = "vector"
    ARRAY = "array"
    DIRECTION = "direction"
    ROTATION = "rotation"
    POSE = "pose"
    SIMILARITY = "similarity"


class SolveStatus(StrEnum):
    """How a solve ended: the word is what documents hold, ``sentence`` what people read."""

    CONVERGED = ("converged", "the estimates are a minimum and the data determine all of them")
    NOT_CONVERGED = ("not-converged", "the iteration stopped before it reached a minimum")
    SKIPPED = ("skipped", "the window has too few rows")
    INFEASIBLE = ("infeasible", "no point meets all constraints")
    UNOBSERVABLE = ("unobservable", "the data leave some of the unknowns, or a combination of them, free")

    sentence: str

    def __new__(cls, word: str, sentence: str) -> Self:
        """The status called ``word``."""
        status = str.__new__(cls, word)
        status._value_, status.sentence = word, sentence
        return status

    @property
    def trusted(self) -> bool:
        """The solve needs no attention."""
        return self in (SolveStatus.CONVERGED, SolveStatus.SKIPPED)


class ResultStatus(StrEnum):
    """Status of the document: ``attention`` if any solve should not be trusted as it stands (exit status 1)."""

    OK = "ok"
    ATTENTION = "attention"


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """What is estimated or derived.

    ``shape`` is ``()`` for a number, ``(n,)`` for a vector, ``(n,)`` or ``(n, m)`` for an array (of one family member);
    directions, rotations, poses and similarities have the shape of the numbers that hold them, and a ``dimension``.
    ``unit`` is what documents show (None: none is known); ``scale`` its numbers in SI; ``over`` names steps.
    """

    name: str
    kind: Kind = Kind.REAL
    shape: tuple[int, ...] = ()
    dimension: int = 0
    unit: str | None = None
    scale: Scale = SI
    doc: str | None = None
    over: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """An unknown's estimate.

    ``value``, ``sigma``, ``fixed``, ``at_bound`` all have ``quantity.shape``, for a family with a leading axis over
    ``keys``; of directions, rotations, poses and similarities all but ``value`` have the tangent coordinates instead.
    ``sigma`` is the standard deviation (SI); NaN where the data do not determine one, None if none was computed;
    ``reason`` then says why. ``fixed`` elements were not estimated. ``at_bound`` ones (None: none) are at a hard bound.
    Outputs take sigmas from `elements.shown_sigma`: 0 where fixed, NaN at a bound. Angles are wrapped to (-pi, pi].
    ``per`` is what the family ranges over (a table, or ``table.column``).
    ``bounds`` (SI) has the shape of ``sigma`` and a last axis [low, high]: guaranteed ones, in place of ``sigma``.
    ``spread`` (None: unknown) makes intervals.
    """

    quantity: Quantity
    value: Floats
    sigma: Floats | None
    fixed: Mask
    keys: tuple[Key, ...] | None = None
    per: str | None = None
    at_bound: Mask | None = None
    reason: str | None = None
    bounds: Floats | None = None
    spread: Spread | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedValue:
    """A derived quantity: as `Estimate`; ``keys`` and ``over`` (a table) where there is one value for each row."""

    quantity: Quantity
    value: Floats
    sigma: Floats | None
    keys: tuple[Key, ...] | None = None
    over: str | None = None
    reason: str | None = None
    bounds: Floats | None = None
    spread: Spread | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CovarianceMatrix:
    """Covariance of named scalars in SI: ``matrix`` (n, n), NaN where undetermined and for scalars held at a bound.

    ``names`` as CONTRACT §2 writes them (``p[1]``, ``theta[2,1]``, ``q["waist"]``), fixed elements left out.
    ``factors`` has one factor per row, that of its quantity: documents hold ``matrix[i, j] / (factors[i] factors[j])``.
    ``matrix`` is None where it was left out for its size; ``reason`` then says so.
    """

    names: tuple[str, ...]
    factors: tuple[float, ...]
    matrix: Floats | None
    reason: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeDirection:
    """A combination of unknowns that the data cannot see.

    ``sentence`` says it in words ("`a` and `b` scale together"); ``unknowns`` are the quantities concerned,
    ``coefficients`` the movement of each scalar (by its covariance name) along the direction, SI.
    """

    sentence: str
    unknowns: tuple[str, ...]
    coefficients: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonDirection:
    """A motion of the whole scene that no equation notices: what it is, in how many directions, what takes part."""

    sentence: str
    motion: str
    dimensions: int
    unknowns: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observability:
    """The rank decision. ``unused`` names unknowns (or members, ``cam["left"]``) that no equation mentions.

    ``condition`` is that of the scaled Jacobian on its estimable part. ``gauge`` names the free common motions.
    """

    rank: int
    dimension: int
    condition: float
    unobservable: tuple[FreeDirection, ...] = ()
    gauge: tuple[CommonDirection, ...] = ()
    unused: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorReport:
    """A ``normal`` (or a prior of ``:sigma``) at the estimates: ``residual = (value - mean)/sigma``, one per scalar."""

    name: str
    value: float
    mean: float
    sigma: float
    residual: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintReport:
    """A constraint at the estimates.

    ``kind`` is how it is written (``=``, ``<=`` …). ``value`` in SI is what is left to its limit, negative beyond it;
    of an equation the difference of its sides, of several elements or rows the worst. ``violation`` is 0 where it holds
    as far as the arithmetic can tell; ``active``: it is at its limit (equations always are). With a table ``over``,
    ``rows`` of it are constrained, and the lists hold rows from 1 of the unfiltered table.
    """

    name: str
    kind: str
    value: float
    violation: float
    active: bool
    violated: bool
    over: str | None = None
    rows: int = 1
    violated_rows: tuple[int, ...] = ()
    active_rows: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative:
    """Another minimum: its ``cost`` and ``robust_cost`` as `SolveReport` has them, how many ``starts`` led to it.

    ``remark`` says more in words; ``weight`` is the probability of a hypothesis of a filter among all that it follows.
    """

    cost: float
    starts: int
    estimates: tuple[Estimate, ...]
    robust_cost: float | None = None
    remark: str | None = None
    weight: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """A part of the set of solutions that is separate from the others: its bounds."""

    estimates: tuple[Estimate, ...]
    derived: tuple[DerivedValue, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Examined:
    """What a look around a minimum finds: other minima, what was not looked at of intervals and why, and doubts."""

    alternatives: tuple[Alternative, ...] = ()
    not_examined: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    diagnostics: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolveReport:
    """One solve.

    ``key`` holds the key values of ``for-each``, empty with one solve. ``cost``, ``dof``, ``sigma0``, ``chi2_p`` are as
    CONTRACT §2 defines them and None where there is no such number; ``robust_cost`` is the sum of the losses, None
    without one; ``boxes`` were examined by interval methods, which find separate ``pieces``; ``reasons`` says why by
    the field's name. ``noise`` and ``noise_units`` of observation clauses are as `mbm.report.noise` has them.
    Functions make the residuals (``rows``), of each observation ``summaries``, ``raw_residuals`` and ``row_data``,
    and of plots the data (``pictures``) and ``maps``; ``made_from`` gives what was solved and how.
    ``hypotheses`` are those of a filter at the last step, ``followed`` how many there were after each; ``considered``
    are uncertain constants. ``examination`` is made when it is asked for.
    """

    status: SolveStatus
    message: str
    key: Mapping[str, Key] = field(default_factory=lambda: MappingProxyType({}))
    method: str | None = None
    iterations: int = 0
    evaluations: int = 0
    seconds: float = 0.0
    cost: float | None = None
    dof: int | None = None
    sigma0: float | None = None
    chi2_p: float | None = None
    robust_cost: float | None = None
    log_likelihood: float | None = None
    boxes: int | None = None
    reasons: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    estimates: tuple[Estimate, ...] = ()
    covariance: CovarianceMatrix | None = None
    derived: tuple[DerivedValue, ...] = ()
    derived_covariance: CovarianceMatrix | None = None
    observability: Observability | None = None
    noise: Mapping[str, NoiseReport] = field(default_factory=lambda: MappingProxyType({}))
    noise_units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    summaries: Callable[[], Mapping[str, ResidualSummary]] = dict
    raw_residuals: Callable[[], Mapping[str, RawResiduals]] = dict
    rows: Callable[[], tuple[ResidualRow, ...]] = tuple
    row_data: Callable[[], Mapping[str, RowData]] = dict
    pictures: Callable[[], tuple[PlotData, ...]] = tuple
    maps: Callable[[], tuple[Map, ...]] = tuple
    priors: tuple[PriorReport, ...] = ()
    corrections: tuple[CorrectedColumn, ...] = ()
    constraints: tuple[ConstraintReport, ...] = ()
    pieces: tuple[Piece, ...] = ()
    hypotheses: tuple[Alternative, ...] = ()
    followed: tuple[int, ...] = ()
    starts: Tally | None = None
    coverage: float = 0.95
    examination: Examined | Callable[[], Examined] = field(default_factory=lambda: Examined())
    considered: tuple[ConsideredConstant, ...] = ()
    made_from: Callable[[], tuple[Problem, Solution]] | None = None

    def examined(self) -> Examined:
        """What a look around the minimum finds, made now if it was left for later."""
        return self.examination() if callable(self.examination) else self.examination

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The other minima."""
        return self.examined().alternatives

    @property
    def not_examined(self) -> Mapping[str, str]:
        """What was not looked at of intervals, and why."""
        return self.examined().not_examined

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What speaks against trusting the numbers."""
        return self.examined().diagnostics

    @property
    def residual_summaries(self) -> Mapping[str, ResidualSummary]:
        """Rows, rows used, root mean square and outliers of each observation, made now if they were left for later."""
        return self.summaries()


@dataclass(frozen=True, slots=True, kw_only=True)
class InputFile:
    """A file that was read: the path as messages print it, SHA-256 (None for tables given through the API), rows."""

    path: str
    sha256: str | None
    rows: int


def statuses_of(solves: Sequence[SolveReport]) -> Sequence[SolveStatus]:
    """The status of each solve; solves that have ``statuses`` know them before their reports are made."""
    return list(getattr(solves, "statuses", lambda: [solve.status for solve in solves])())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """Everything that a run of one problem answers. ``file`` is None for problems that were built without one.

    ``solves`` may make a report when it is asked for. ``complete`` is False where the run was interrupted before all
    were made. ``reads`` are the files that it was made from. ``seen`` tells which equations compare images,
    ``described`` the derived equations in words; ``source`` is the problem's text; ``propagate`` makes a `Propagated`.
    """

    version: str
    file: str | None
    problem: str
    seed: int | None
    solves: Sequence[SolveReport]
    options: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    inputs: tuple[InputFile, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    complete: bool = True
    reads: tuple[Read, ...] = ()
    seen: Callable[[], Seen] | None = None
    propagate: Callable[[PropagationSettings], object] | None = None
    source: str | None = None
    described: Callable[[], str] | None = None

    @property
    def status(self) -> ResultStatus:
        """``ok`` if every solve was made, there is one, and each can be trusted, else ``attention``."""
        each = statuses_of(self.solves)
        trusted = self.complete and each and all(status.trusted for status in each)
        return ResultStatus.OK if trusted else ResultStatus.ATTENTION
