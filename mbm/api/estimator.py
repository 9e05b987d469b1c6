"""The bare estimator: arrays of measured values in, arrays of estimates out, for streams of data sets of one shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbm import compiler
from mbm.api import arguments, faults
from mbm.api.varied import Varied, varied
from mbm.compiler import Inputs, SolveSettings
from mbm.problem.checks import check_data
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.report.geometric import GEOMETRIC, number_factors
from mbm.report.types import SolveReport, SolveStatus
from mbm.solution.native.stream import Stream, stream_of, threads
from mbm.solution.types import Floats, Mask
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin
    from mbm.solution.native.robust_stream import RobustStream

CONVERGED = SolveStatus.CONVERGED.label
FLOAT64 = np.dtype(np.float64)
LABEL = f"<U{max(len(status.label) for status in SolveStatus)}"
"""The type of arrays of statuses."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Estimates of one data set, or of T: then everything but ``names`` has a leading axis of T.

    ``values`` (N,) are the numbers of all unknowns one after the other, as ``result[name].value`` has them and in its
    unit; ``found[name]`` are those of one unknown in its shape. ``covariance`` (n, n) is that of the estimated
    coordinates ``names``, as ``result.covariance`` has it. ``cost`` is ``Σ r²``, ``status`` how the solve ended
    (`converged`, `unobservable`, `not-converged`, …). ``clean``: the fast path found a minimum that determines
    everything and fits as stated noise lets expect; else the estimates are those of the general path.
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    cost: Floats | float
    status: NDArray[np.str_] | str
    clean: Mask | bool
    places: Mapping[str, tuple[slice, tuple[int, ...]]] = field(repr=False)

    @property
    def sigma(self) -> Floats:
        """Standard deviations of the estimated coordinates (n,)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    def __getitem__(self, name: str) -> Floats:
        """The estimates of one unknown in its own shape.

        Raises:
            KeyError: no unknown is called so.

        """
        place, shape = self.places[name]
        return self.values[..., place].reshape((*self.values.shape[:-1], *shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimator:
    """A compiled problem as a function from columns to estimates. Not to be shared between threads.

    All that is not an input stays as it was compiled: other columns, constants, noise, which rows count. ``inputs`` are
    the columns in the order in which arrays are taken, each as long as its table and in the unit that its data clause
    states. Each solve begins at the problem's start; at the estimates for the compiled data where it states none.

    ``fast``: there is native code for the problem. A data set that this does not solve cleanly, and every one without
    it, goes the general way, which takes milliseconds and misses nothing.
    """

    inputs: tuple[str, ...]
    names: tuple[str, ...]
    fast: bool
    _varied: tuple[Varied, ...] = field(repr=False)
    _entries: tuple[tuple[tuple[int, ...], Callable[[Floats], None]], ...] = field(repr=False)
    _stream: Stream | RobustStream | None = field(repr=False)
    _general: General = field(repr=False)
    _factors: Floats = field(repr=False)
    _outer: Floats = field(repr=False)
    _plain: bool = field(repr=False)
    _places: Mapping[str, tuple[slice, tuple[int, ...]]] = field(repr=False)

    def __call__(self, *columns: ArrayLike) -> Estimates:
        """Solve for one data set: for each input an array (rows,).

        Raises:
            MbmError: the arrays do not fit (`wrong-input`), or the data do not go with the problem.

        """
        ends = None if self._stream is None else self._quickly(self._stream, columns)
        if ends is not None:
            values, covariance, cost = ends
            if not self._plain:
                values, covariance = self._in_units(values, covariance)
            return Estimates(self.names, values, covariance, cost, CONVERGED, True, self._places)
        given = self._numbers(columns)
        self._check(given, None)
        report = self._general.report(self._varied, given)
        return Estimates(self.names, *self._answer(report), False, self._places)

    def _quickly(
        self, stream: Stream | RobustStream, columns: tuple[ArrayLike, ...]
    ) -> tuple[Floats, Floats, float] | None:
        """The solve by native code; None where it is not clean, or the arrays do not fit."""
        try:
            for (shape, enter), column in zip(self._entries, columns, strict=True):
                cells = np.asarray(column)
                if cells.dtype is not FLOAT64:
                    cells = arguments.real(cells)
                if cells.shape != shape:
                    return None
                enter(cells)
        except (TypeError, ValueError, OverflowError):
            return None
        return stream.solved_one()

    def many(self, *columns: ArrayLike, workers: int | None = None) -> Estimates:
        """Solve T data sets: for each input an array (T, rows).

        Args:
            columns: the arrays.
            workers: threads; None: one a processor. Answers do not change.

        Raises:
            MbmError: the arrays do not fit (`wrong-input`), `workers` is no number of threads, or a data set does not
                go with the problem.

        """
        workers = arguments.threads(workers)
        given = self._numbers(columns)
        count = len(given[0]) if given and given[0].ndim else 0
        self._check(given, count)
        n = len(self.names)
        if self._stream is None:
            values, covariance = np.empty((count, len(self._factors))), np.empty((count, n, n))
            cost, clean = np.empty(count), np.zeros(count, dtype=bool)
        else:
            parameters = self._stream.parameters(count)
            for each, cells in zip(self._varied, given, strict=True):
                each.enter(cells, parameters)
            ends = self._stream.solved(count, threads(workers, count))
            values, covariance, cost, clean = ends.numbers, ends.covariance, ends.cost, ends.clean
            if not self._plain:
                values, covariance = self._in_units(values, covariance)
        status = np.full(count, CONVERGED, dtype=LABEL)
        for t in np.flatnonzero(~clean).tolist():
            report = self._general.report(self._varied, [cells[t] for cells in given])
            values[t], covariance[t], cost[t], status[t] = self._answer(report)
        return Estimates(self.names, values, covariance, cost, status, clean, self._places)

    def _numbers(self, columns: tuple[ArrayLike, ...]) -> list[Floats]:
        """The arrays that are given, one for each input."""
        if len(columns) != len(self._varied):
            raise MbmError(faults.wrong_count(self.inputs, len(columns)))
        given = []
        for name, column in zip(self.inputs, columns, strict=True):
            try:
                given.append(arguments.real(column))
            except (TypeError, ValueError, OverflowError) as error:
                raise MbmError(faults.no_numbers(name)) from error
        return given

    def _check(self, given: list[Floats], sets: int | None) -> None:
        """Compare the shapes of the arrays with those of the tables; ``sets`` None: of one data set."""
        leading = () if sets is None else (sets,)
        for name, each, cells in zip(self.inputs, self._varied, given, strict=True):
            if cells.shape != (*leading, each.rows):
                raise MbmError(faults.wrong_shape(name, cells.shape, each.rows, sets))

    def _in_units(self, values: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Values and covariance in the units of the report."""
        return values / self._factors, covariance / self._outer

    def _answer(self, report: SolveReport) -> tuple[Floats, Floats, float, str]:
        n = len(self.names)
        found = report.covariance
        matrix = np.full((n, n), np.nan) if found is None or found.matrix is None else found.matrix / self._outer
        cost = np.nan if report.cost is None else report.cost
        return numbers_of(report) / self._factors, matrix, cost, report.status.label


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class General:
    """The general path for tables of which some columns are replaced."""

    compilation: Compilation
    origin: Origin
    inputs: Inputs

    def report(self, columns: tuple[Varied, ...] = (), given: list[Floats] | None = None) -> SolveReport:
        """The solve of the compiled data, with ``given`` (rows,) in place of some columns.

        Raises:
            MbmError: the data do not go with the problem.

        """
        found = self.compilation.elaborated
        tables = dict(found.tables)
        for each, cells in zip(columns, given or (), strict=True):
            tables[each.table] = _replaced(tables[each.table], each, cells)
        errors, _ = check_data(found.problem, tables)
        if errors:
            raise MbmError(*errors)
        result = compiler.solved(
            replace(found, tables=tables),
            self.compilation.kernels,
            self.inputs,
            SolveSettings(covariance_full=True),
            self.compilation.cache,
            self.origin.file,
            self.origin.registry,
        )
        return result.solves[0]


def _replaced(table: Table, column: Varied, cells: Floats) -> Table:
    before = table.columns[column.name]
    numbers = np.array(cells) * column.factor
    return replace(table, columns={**table.columns, column.name: replace(before, numbers=numbers)})


def numbers_of(report: SolveReport) -> Floats:
    """The numbers of all unknowns (N,) in SI."""
    return np.concatenate([np.ravel(estimate.value) for estimate in report.estimates])


def estimator(compilation: Compilation, origin: Origin, inputs: Inputs, columns: tuple[str, ...]) -> Estimator:
    """The estimator of a compiled problem that takes the ``columns``; without any, all measured ones.

    Raises:
        MbmError: a column cannot be an input, the problem asks for several solves, the compiled data do not go with it.

    """
    from mbm.solution.estimate import assemble
    from mbm.solution.settings import settings_of

    found = compilation.elaborated
    problem, tables = found.problem, found.tables
    _one_descent(problem)
    starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    equations, _ = assemble(problem, compilation.kernels, tables, starts, compilation.cache)
    if equations.implicit is not None:
        equations = equations.straightened() or equations
    chosen = varied(problem, tables, (*equations.groups, *equations.constraints), columns)
    general = General(compilation=compilation, origin=origin, inputs=inputs)
    first = general.report()
    if first.covariance is None:
        raise TypeError(first.status)
    factors = np.array(first.covariance.factors)
    settings = settings_of(problem.request, forms=origin.registry.closed_forms)
    stream = stream_of(problem, equations, settings, numbers_of(first))
    places, scales, offset = {}, [], 0
    for estimate in first.estimates:
        quantity, size = estimate.quantity, estimate.value.size
        per_number = number_factors(quantity) if quantity.kind in GEOMETRIC else np.array([quantity.factor])
        scales.append(np.resize(per_number, size))
        places[quantity.name] = (slice(offset, offset + size), estimate.value.shape)
        offset += size
    return Estimator(
        inputs=tuple(f"{each.table}.{each.name}" for each in chosen),
        names=first.covariance.names,
        fast=stream is not None,
        _varied=chosen,
        _entries=() if stream is None else tuple(((each.rows,), each.entry(stream.single)) for each in chosen),
        _stream=stream,
        _general=general,
        _factors=np.concatenate(scales),
        _outer=np.outer(factors, factors),
        _plain=all(bool((each == 1.0).all()) for each in (factors, *scales)),
        _places=MappingProxyType(places),
    )


def _one_descent(problem: Problem) -> None:
    """Refuse what asks for several solves or starts."""
    request = problem.request
    asked = {"`for-each`": request.for_each, "`window`": request.window, "`:starts`": request.starts}
    for what, stated in asked.items():
        if stated:
            raise MbmError(faults.not_a_stream(what))
