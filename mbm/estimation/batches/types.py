"""Values of many solves in columns: arrays over the solves in place of one object for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.layout import Entry, Layout
from mbm.equations.spreads import Freedom, Limited
from mbm.equations.types import Floats, Indices, Mask, Reason
from mbm.estimation.search.solution import Failure, RawRows, Skipped, Solution
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DegreesColumns:
    """Of T solves the freedom (T, n) of the estimates, and (T, size) of each derived quantity.

    ``poor`` (T,): some intervals fall short even so. ``limited`` (T, n) are hard limits of the estimates (None: there
    are none).
    """

    estimates: Freedom
    derived: tuple[Freedom, ...]
    poor: Mask
    limited: Limited | None = None

    def first(self, count: int) -> DegreesColumns:
        """Those of the first ``count`` solves."""
        return DegreesColumns(
            estimates=self.estimates.first(count),
            derived=tuple(each.first(count) for each in self.derived),
            poor=self.poor[:count],
            limited=None if self.limited is None else self.limited.first(count),
        )


if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from mbm.equations.assembly import Assembled
    from mbm.equations.corrections.measured import Measured
    from mbm.text.types import Diagnostic

REASONS = tuple(Reason)
"""Reasons by number: ``Columns.reason`` counts in this order."""


Remarks: TypeAlias = "Mapping[int, tuple[Callable[[], Diagnostic], ...]]"
"""What makes the warnings, by the place of the solve, in the order of a solve by itself."""

Which: TypeAlias = range | Indices
"""Some solves by number: consecutive ones, or any."""


def places_of(which: Which) -> Indices | slice:
    """What picks some solves from arrays over all."""
    return slice(which.start, which.stop) if isinstance(which, range) else which


Begun: TypeAlias = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]] | Mapping[str, Floats]
"""The starts (SI, by name) for the solve with a key, or those of all solves."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """Where the descents of K solves ended.

    ``points`` (K, N); ``cost`` (K,) ``Σ r²``, ``Σ ρ`` with losses; ``reason`` (K,) numbers of ``REASONS``, -1 where
    another method is to take over; ``held`` (K,): some coordinate is at a bound.
    ``kept``: what consensus left in (None: everything). ``given`` (K,): the descent began at a stated start, which a
    closed form may challenge (None: all did). ``compared`` (K,): it was compared with one on the way (None: none was).
    ``factors`` (K, blocks) are those of unknown noises that are several
    (None: there is one at most). ``multipliers`` (K, k) are those of the constraints of each solve, as `Minimum` has
    them, the first ones (None: there are no constraints).
    """

    points: Floats
    cost: Floats
    reason: NDArray[np.int64]
    iterations: Indices
    evaluations: Indices
    held: Mask
    multipliers: Floats | None = None
    kept: Kept | None = None
    given: Mask | None = None
    compared: Mask | None = None
    factors: Floats | None = None

    @property
    def minima(self) -> Mask:
        """Which are minima (K,) away from bounds, with a finite cost."""
        converged = np.array([reason.converged for reason in REASONS])
        return np.asarray((self.reason >= 0) & converged[self.reason] & ~self.held & np.isfinite(self.cost))

    def part(self, which: Which) -> Ends:
        """Those of some solves."""
        every = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "kept"}
        return replace(self, **{n: each[places_of(which)] for n, each in every.items() if each is not None})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """What consensus keeps of the equations that K solves have.

    ``outputs`` (rows, outputs) of the K solves in each group say what is kept (None: everything), ``left`` (the same)
    is κ of it (`consensus.units.consistency`, None: 1), ``information`` (the same) what it informs by (`inform_units`,
    None: 1); ``count`` (K,) how many scalars are kept.
    """

    outputs: tuple[Mask | None, ...]
    left: tuple[Floats | None, ...]
    information: tuple[Floats | None, ...]
    count: Indices

    def of(self, solves: Sequence[Indices], some: Indices) -> Kept:
        """What is kept in ``some`` of the solves, ascending; ``solves`` (rows,) own the rows of each group."""
        mine = [np.isin(solve, some) for solve in solves]

        def picked(each: tuple[Floats | None, ...]) -> tuple[Floats | None, ...]:
            return tuple(None if one is None else one[m] for one, m in zip(each, mine, strict=True))

        return Kept(
            outputs=tuple(None if o is None else o[m] for o, m in zip(self.outputs, mine, strict=True)),
            left=picked(self.left),
            information=picked(self.information),
            count=self.count[some],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Rows of which something is to be said: ``positions`` in ``table``, those of solve k from ``first[k]`` on."""

    table: Table
    positions: Indices
    first: Indices

    @classmethod
    def of_rows(cls, table: Table, positions: Indices, solve: Indices, solves: int) -> Rows:
        """The ``positions`` (R,) of the rows of so many solves, each of which belongs to ``solve`` (R,), ascending."""
        ends = np.cumsum(np.bincount(solve, minlength=solves))
        return cls(table=table, positions=positions, first=np.concatenate([np.zeros(1, dtype=np.int64), ends]))

    def joined(self, other: Rows) -> Rows:
        """These and others of the same table."""
        solves = len(self.first) - 1
        parts = [np.repeat(np.arange(solves), np.diff(each.first)) for each in (self, other)]
        positions, solve = np.concatenate([self.positions, other.positions]), np.concatenate(parts)
        order = np.lexsort((positions, solve))
        return Rows.of_rows(self.table, positions[order], solve[order], solves)

    def of(self, place: int) -> list[int]:
        """The positions of one solve, ascending."""
        found: list[int] = self.positions[self.first[place] : self.first[place + 1]].tolist()
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """The constraints of T solves, of blocks ``owners`` (k), none of them violated.

    ``values`` (T, k) as `ConstraintReport` has them; ``active`` (T, k): at the limit; ``pushed`` (T, k): some
    inequality of the block keeps the estimates from moving; ``rows`` (T, k) how often the block is there, ``at_limit``
    the rows at their limits of inequalities over tables (None: of others). ``multipliers`` (T, c) as `Ends` has them.
    ``dimension`` (T,), all of it determined, as `Observability` has it; ``moving`` (T,) is that without what equations
    determine.
    """

    owners: tuple[int, ...]
    values: Floats
    active: Mask
    pushed: Mask
    rows: Indices
    at_limit: tuple[Rows | None, ...]
    multipliers: Floats
    dimension: Indices
    moving: Indices

    def first(self, count: int) -> Limits:
        """Those of the first ``count`` solves."""
        whole = ("owners", "at_limit")  # rows are looked up by the number of a solve
        return replace(self, **{f.name: getattr(self, f.name)[:count] for f in fields(self) if f.name not in whole})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """Answers of T solves.

    ``points`` (T, N), ``sigma`` (T, n), ``factor`` (T, n, n) with ``factor @ factorᵀ`` the covariance; ``cost``,
    ``reason``, ``iterations``, ``evaluations`` as `Ends` has them; ``dof``, ``sigma0`` and ``chi2_p`` (NaN:
    there is none), ``noise`` (T, blocks) the factors of unknown noise (1 where it is stated); ``least`` is `Ends.cost`,
    ``robust_cost`` that without what is no part of χ², ``Σ ρ``; ``root`` (T, n, n) and ``scale`` (T, n) are those of
    `Factors` of the Jacobian; ``derived`` has for each derived quantity its values (T, numbers), its sigmas (T, size),
    and its gradient times ``factor`` (T, size, n); ``rms`` and ``used`` (T, blocks) are the normalised root mean square
    of the residuals of each block of equations (NaN: there is none), and its rows in use. ``solved`` (T,): the end is a
    minimum that determines everything; ``clean`` (T,): and there is nothing else to be said of it. Where it is not,
    columns hold anything. ``expected`` (T,): the fit is as good as stated noise lets expect. ``challenged`` (T,): the
    minimum is to be compared with what closed forms lead to. ``outliers`` are the rows of each block that were left
    out, or are far off under a loss (None: none are looked for). ``priors`` (T, k): how far estimates are from the k
    means that are known beforehand, not whitened, equation by equation. ``counting`` (T, m): the residuals that count
    (None: all that there are). ``seconds`` (T,).
    ``degrees`` are those of freedom; ``log_likelihood`` (T,), where some errors are not normal with stated weights;
    ``remarks`` are warnings whose numbers are those of the solve, by its place;
    ``limits`` are the constraints (None: there are none); with these, columns of ``factor`` and ``root`` are zero for
    the dimensions that they take away.
    """

    points: Floats
    cost: Floats
    least: Floats
    robust_cost: Floats
    reason: NDArray[np.int64]
    iterations: Indices
    evaluations: Indices
    dof: Indices
    sigma0: Floats
    chi2_p: Floats
    noise: Floats
    sigma: Floats
    factor: Floats
    root: Floats
    scale: Floats
    derived: tuple[tuple[Floats, Floats, Floats], ...]
    rms: Floats
    used: Indices
    clean: Mask
    solved: Mask
    expected: Mask
    challenged: Mask
    outliers: tuple[Rows | None, ...]
    priors: Floats
    counting: Mask | None
    seconds: Floats
    degrees: DegreesColumns
    remarks: Remarks
    limits: Limits | None = None
    log_likelihood: Floats | None = None

    def first(self, count: int) -> Columns:
        """The columns of the first ``count`` solves."""
        whole = (
            "derived",
            "outliers",
            "degrees",
            "remarks",
            "limits",
        )  # outliers are looked up by the number of a solve
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in whole}
        return replace(
            self,
            **{name: each[:count] for name, each in own.items() if each is not None},
            derived=tuple((a[:count], b[:count], c[:count]) for a, b, c in self.derived),
            degrees=self.degrees.first(count),
            remarks={place: each for place, each in self.remarks.items() if place < count},
            limits=None if self.limits is None else self.limits.first(count),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Errors:
    """Errors in measured columns: the equations that take these as ``exact``, and the values that are corrected."""

    problem: Problem
    exact: Assembled
    measured: Measured


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corrections:
    """The corrections of the uncertain values of one column in K solves, to be added, and their sigma, in SI.

    Those of solve k stand from ``first[k]`` (K + 1,) on; ``rows`` count from 1 in the unfiltered table, ``keys`` are
    those of the rows where the table has a key.
    """

    table: str
    column: str
    first: Indices
    rows: Indices
    keys: Sequence[CellKey | None] | None
    value: Floats
    sigma: Floats


Descent: TypeAlias = Callable[[Which], Ends]
"""Solves some consecutive solves from their starts; may be called by several threads at once."""

Solver: TypeAlias = Callable[[Which, Floats], Ends]
"""Solves some solves from points (K, N); may be called by several threads at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """Some consecutive solves: those of ``which``, with their ``columns``; ``apart`` has those that are not clean.

    ``rows`` (solves, blocks) are the rows of the tables, used or not. ``names`` are the key columns and ``keys`` their
    cells in all solves; ``layout`` and ``free`` say what the numbers are, ``members`` has the keys, solve by solve, of
    the members of unknowns for which each solve has its own. ``make`` gives all that is to be said of a
    solve whose columns are clean. ``places`` (solves,) are the numbers of the solves among all of the problem.
    ``corrections`` finds those of the columns with errors, ``raw`` what the equations of observations say. The ``lock``
    is that of a `Solution`.
    """

    which: range
    names: tuple[str, ...]
    keys: Sequence[tuple[CellKey, ...]]
    columns: Columns
    rows: Indices
    apart: Mapping[int, Solution | Failure | Skipped]
    make: Callable[[int, Columns, int], Solution]
    layout: Layout
    free: Indices
    members: Mapping[str, Sequence[CellKey]]
    places: Indices
    corrections: Callable[[], tuple[Corrections, ...]]
    raw: Callable[[], Iterator[RawRows]]
    lock: AbstractContextManager[object]

    def member_keys(self, entry: Entry, place: int) -> tuple[CellKey, ...] | None:
        """The keys of the members of an unknown in the solve at a place (from 0); None without a family."""
        own = self.members.get(entry.unknown.name)
        first = (self.which.start + place) * entry.members
        return entry.keys if own is None else tuple(own[first : first + entry.members])

    def solution(self, number: int) -> Solution | Failure | Skipped:
        """One solve of ``which``, made now if it was left in the columns."""
        found = self.apart.get(number)
        if found is not None:
            return found
        with self.lock:
            return self.make(number, self.columns, number - self.which.start)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tangents:
    """Orthonormal directions ``basis`` (K, n, n) along what holds, in coordinates of the ``scale`` (K, n).

    Columns that are ``gone`` (K, n), the first ones, are zero: as many as there are independent constraints that hold,
    of which ``equalities`` (K,) are equations. ``clear`` (K,): no constraint is violated, and how many dimensions they
    take away is beyond doubt, and not all.
    """

    basis: Floats
    scale: Floats
    gone: Mask
    equalities: Indices
    clear: Mask

    @property
    def taken(self) -> Indices:
        """Dimensions (K,) that constraints take away."""
        return np.asarray(self.gone.sum(axis=1))
