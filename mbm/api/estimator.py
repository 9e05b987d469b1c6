"""The bare estimator: arrays of measured values in, arrays of estimates out, for streams of data sets of one shape."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbm.api import arguments, faults
from mbm.api.shapes import General, Shape, Shapes
from mbm.compiler import Inputs
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.stream import Stream, threads
from mbm.problem.types import Problem
from mbm.report.elements import GEOMETRIC, number_factors, quaternion_places
from mbm.report.types import SolveReport, SolveStatus
from mbm.rotations import signed
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin
    from mbm.api.pickled import Written
    from mbm.estimation.batches.robust_stream import RobustStream

CONVERGED = SolveStatus.CONVERGED.value
FLOAT64 = np.dtype(np.float64)
LABEL = f"<U{max(len(status.value) for status in SolveStatus)}"
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

    def __iter__(self) -> Iterator[str]:
        """The names of the unknowns."""
        return iter(self.places)

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
    the columns in the order in which arrays are taken, in the unit that their data clause states. Where they are all
    that equations use of a table, and nothing but values depends on its rows, data sets may have any number of rows of
    it; of other tables they have those that were compiled. What solves so many rows is made ready when they first come.
    Each solve begins at the problem's start; at the estimates for the compiled data where it states none.

    ``fast``: there is native code for the problem; where there is none ``reason`` says why. A data set that this does
    not solve cleanly, and every one without it, goes the general way, which takes milliseconds and misses nothing.
    """

    inputs: tuple[str, ...]
    names: tuple[str, ...]
    fast: bool
    reason: str | None
    _shapes: Shapes = field(repr=False)
    _first: Shape = field(repr=False)
    _factors: Floats = field(repr=False)
    _zeros: Floats = field(repr=False)
    _outer: Floats = field(repr=False)
    _quaternions: Indices = field(repr=False)
    _plain: bool = field(repr=False)
    _places: Mapping[str, tuple[slice, tuple[int, ...]]] = field(repr=False)
    _made_of: tuple[Origin, Inputs, str] = field(repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as text and data, and is compiled again from them."""
        from mbm.api.pickled import Written, portable

        origin, inputs, backend = self._made_of
        return estimator_again, (Written.of(origin), portable(inputs), backend, self.inputs)

    def __call__(self, *columns: ArrayLike) -> Estimates:
        """Solve for one data set: for each input an array (rows,).

        Raises:
            MbmError: the arrays do not fit (`wrong-input`), or the data do not go with the problem.

        """
        shape = self._first
        ends = None if shape.stream is None else _quickly(shape, shape.stream, columns)
        if ends is None:
            given = self._numbers(columns)
            shape = self._shapes.of(given, None)
            if shape is not self._first and shape.stream is not None:
                ends = _quickly(shape, shape.stream, given)
            if ends is None:
                return Estimates(self.names, *self._answer(self._shapes.solved(shape, given)), False, self._places)
        values, covariance, cost = ends
        if not self._plain:
            values, covariance = self._in_units(values, covariance)
        clean = shape.stream is not None and cost < shape.stream.usual
        return Estimates(self.names, values, covariance, cost, CONVERGED, clean, self._places)

    def many(self, *columns: ArrayLike, rows: ArrayLike | None = None, workers: int | None = None) -> Estimates:
        """Solve T data sets: for each input an array (T, rows).

        Args:
            columns: the arrays.
            rows: how many numbers of its lines, from the first, each data set has (T,), where lines are filled up to
                one length; None: all of them.
            workers: threads; None: one a processor. Answers do not change.

        Raises:
            MbmError: the arrays do not fit (`wrong-input`), `workers` is no number of threads, or a data set does not
                go with the problem.

        """
        workers = arguments.threads(workers)
        given = self._numbers(columns)
        count = len(given[0]) if given and given[0].ndim else 0
        if rows is None:
            return self._alike(given, count, workers)
        lengths = self._lengths(given, count, rows)
        n = len(self.names)
        found = Estimates(
            self.names,
            np.empty((count, len(self._factors))),
            np.empty((count, n, n)),
            np.empty(count),
            np.full(count, CONVERGED, dtype=LABEL),
            np.zeros(count, dtype=bool),
            self._places,
        )
        for length in np.unique(lengths).tolist():
            which = np.flatnonzero(lengths == length)
            part = self._alike([cells[which, :length] for cells in given], len(which), workers)
            for name in ("values", "covariance", "cost", "status", "clean"):
                getattr(found, name)[which] = getattr(part, name)
        return found

    def _alike(self, given: list[Floats], count: int, workers: int | None) -> Estimates:
        """So many data sets that have as many rows."""
        shape = self._shapes.of(given, count)
        n = len(self.names)
        if shape.stream is None:
            values, covariance = np.empty((count, len(self._factors))), np.empty((count, n, n))
            cost, clean = np.empty(count), np.zeros(count, dtype=bool)
        else:
            parameters = shape.stream.parameters(count)
            for each, cells in zip(shape.columns, given, strict=True):
                each.enter(cells, parameters)
            ends = shape.stream.solved(count, threads(workers, count))
            values, covariance, cost, clean = ends.numbers, ends.covariance, ends.cost, ends.clean
            if not self._plain:
                values, covariance = self._in_units(values, covariance)
        status = np.full(count, CONVERGED, dtype=LABEL)
        for t in np.flatnonzero(~clean).tolist():
            report = self._shapes.solved(shape, [cells[t] for cells in given])
            values[t], covariance[t], cost[t], status[t] = self._answer(report)
        if shape.stream is not None:
            clean &= cost < shape.stream.usual
        return Estimates(self.names, values, covariance, cost, status, clean, self._places)

    def _numbers(self, columns: tuple[ArrayLike, ...]) -> list[Floats]:
        """The arrays that are given, one for each input."""
        if len(columns) != len(self.inputs):
            raise MbmError(faults.wrong_count(self.inputs, len(columns)))
        given = []
        for name, column in zip(self.inputs, columns, strict=True):
            try:
                given.append(arguments.real(column))
            except (TypeError, ValueError, OverflowError) as error:
                raise MbmError(faults.no_numbers(name)) from error
        return given

    def _lengths(self, given: list[Floats], count: int, rows: ArrayLike) -> Indices:
        """How many rows each data set has (T,)."""
        lengths = np.asarray(rows) if np.size(rows) else np.zeros(np.shape(rows), dtype=np.int64)
        most = min((cells.shape[-1] for cells in given if cells.ndim == 2), default=0)
        whole = lengths.dtype.kind in "iu" and lengths.shape == (count,)
        if not whole or any(cells.ndim != 2 for cells in given) or bool(((lengths < 0) | (lengths > most)).any()):
            raise MbmError(faults.wrong_rows(most, count))
        return lengths.astype(np.int64)

    def _in_units(self, values: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Values and covariance in the units and with the signs of the report."""
        found = (values - self._zeros) / self._factors
        if self._quaternions.size:
            found[..., self._quaternions] = signed(found[..., self._quaternions])
        return found, covariance / self._outer

    def _answer(self, report: SolveReport) -> tuple[Floats, Floats, float, str]:
        n = len(self.names)
        found = report.covariance
        matrix = np.full((n, n), np.nan) if found is None or found.matrix is None else found.matrix
        numbers = np.concatenate([np.ravel(estimate.value) for estimate in report.estimates])
        cost = np.nan if report.cost is None else report.cost
        return *self._in_units(numbers, matrix), cost, report.status.value


def _quickly(
    shape: Shape, stream: Stream | RobustStream, columns: Sequence[ArrayLike]
) -> tuple[Floats, Floats, float] | None:
    """The solve of one data set by native code; None where it is not clean, or the arrays do not fit."""
    try:
        for (wanted, enter), column in zip(shape.entries, columns, strict=True):
            cells = np.asarray(column)
            if cells.dtype is not FLOAT64:
                cells = arguments.real(cells)
            if cells.shape != wanted:
                return None
            enter(cells)
    except (TypeError, ValueError, OverflowError):
        return None
    return stream.solved_one()


def estimator(
    compilation: Compilation, origin: Origin, inputs: Inputs, backend: str, columns: tuple[str, ...]
) -> Estimator:
    """The estimator of a compiled problem that takes the ``columns``; without any, all measured ones.

    Raises:
        MbmError: a column cannot be an input, the problem asks for several solves, the compiled data do not go with it.

    """
    _one_descent(compilation.elaborated.problem)
    shapes = Shapes(General(compilation=compilation, origin=origin, inputs=inputs), columns)
    first = shapes.report
    if first.covariance is None:
        raise TypeError(first.status)
    factors = np.array(first.covariance.factors)
    places, scales, zeros, quaternions, offset = {}, [], [], [], 0
    for estimate in first.estimates:
        quantity, size = estimate.quantity, estimate.value.size
        per_number = number_factors(quantity) if quantity.kind in GEOMETRIC else np.array([quantity.scale.factor])
        scales.append(np.resize(per_number, size))
        zeros.append(np.full(size, 0.0 if quantity.kind in GEOMETRIC else quantity.scale.zero))
        places[quantity.name] = (slice(offset, offset + size), estimate.value.shape)
        quaternions += [range(offset + q, offset + q + 4) for q in quaternion_places(quantity, size)]
        offset += size
    return Estimator(
        inputs=shapes.inputs,
        names=first.covariance.names,
        fast=shapes.first.stream is not None,
        reason=shapes.first.reason,
        _shapes=shapes,
        _first=shapes.first,
        _factors=np.concatenate(scales),
        _zeros=np.concatenate(zeros),
        _outer=np.outer(factors, factors),
        _quaternions=np.array(quaternions, dtype=np.int64),
        _plain=all(bool((each == 1.0).all()) for each in (factors, *scales))
        and not any(each.any() for each in zeros)
        and not quaternions,
        _places=places,
        _made_of=(origin, inputs, backend),
    )


def estimator_again(written: Written, inputs: Inputs, backend: str, columns: tuple[str, ...]) -> Estimator:
    """The estimator that was pickled."""
    from mbm.api.compilation import compilation_of

    origin = written.origin()
    return estimator(compilation_of(origin, inputs, backend), origin, inputs, backend, columns)


def _one_descent(problem: Problem) -> None:
    """Refuse what asks for several solves or starts."""
    request = problem.request
    asked: dict[str, object] = {"`for-each`": request.for_each, "`window`": request.window, "`:starts`": request.starts}
    asked["a constant with an uncertainty"] = any(constant.sigmas for constant in problem.constants)
    asked["nothing to estimate"] = not problem.unknowns
    for what, stated in asked.items():
        if stated:
            raise MbmError(faults.not_a_stream(what))
