"""Groups of equations: kernels with the rows that they hold for, and what is kept of them from data set to data set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from threading import RLock
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mbm.equations.gathering import Gathered, Sampled
from mbm.equations.layout import Layout
from mbm.equations.layouts import Layouts
from mbm.equations.likelihoods import Readings
from mbm.equations.scatter import Scatter, scatter
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.expression.evaluate import Values, evaluate
from mbm.kernels.types import Backend, Evaluation, Kernel, Stream
from mbm.problem.overrides import ConstantValue
from mbm.problem.rows import Positions, lookup
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Equation, Problem
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.losses import LossFunction

INPUTS_AT_A_TIME = 32_768
"""Numbers that a kernel takes for many points at a time: 256 kB stay in the cache, which more than halves the time of
39 unknowns at 78 points (measured)."""

ROWS_IN_PARTS = 50_000
"""Rows that take their inputs a part at a time: from here on kernels are fast, however few they are called with."""

DENSE_PART = 20_000_000
"""Numbers in a dense Jacobian of some rows that is made at once: 160 MB."""

WHITENED = 8_192
"""Numbers of a Jacobian that are whitened together: beside them their copy stays in the cache."""

MOST_PREPARED_ROWS = 1_000_000
"""Rows of all prepared kernels together; growing windows would prepare every size there is."""


ALL = slice(None)
"""All rows."""

Kind: TypeAlias = tuple[tuple[str, ...], tuple[int, ...]]
"""Names of the unknowns and numbers of rows of the kernels: what decides which closed forms are made for equations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slots:
    """Which numbers a kernel takes: ``index``, ``columns``, ``shared`` and ``shared_columns`` of a `Group`.

    One row stands for all where rows pick no members of families: then they are the same for all data sets that have
    the ``layout``.
    """

    layout: Layout
    kernel: Kernel
    index: Indices
    columns: Indices
    shared: tuple[bool, ...]
    shared_columns: tuple[bool, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StatedNoise:
    """What whitens an equation."""

    equation: Equation
    whitener: Whitener


class EvaluationCache:
    """Prepared kernels by number of rows, so that a stream of data sets of one size prepares them once.

    Local to one compiled problem. An evaluation is filled anew before each use, by one thread at a time: whoever
    solves, or works something out of a solution later, holds the ``lock``. Sets of unknowns and numbers of rows for
    which no closed form is made are remembered too, and in ``native`` what native solves share.
    ``constants``, ``slots`` (by kernel) and ``stated`` noise (by kernel and equation) are what no data decide, and
    ``last`` what `assembling` keeps of the last equations: the next are most often like them.
    """

    def __init__(self, backend: Backend, without_closed_form: Iterable[Kind] = ()) -> None:
        self.backend = backend
        self.lock = RLock()
        self.without_closed_form: set[Kind] = set(without_closed_form)
        self.layouts = Layouts()
        self.native: dict[str, object] = {}
        self.constants: tuple[tuple[ConstantValue, ...], Mapping[str, float]] | None = None
        self.slots: dict[int, Slots] = {}
        self.stated: dict[tuple[int, int], StatedNoise] = {}
        self.last: object = None
        self._prepared: dict[tuple[int, int], Evaluation] = {}
        self._prepared_rows = 0
        self._streams: dict[int, Stream] = {}

    def stream(self, number: int, kernel: Kernel) -> Stream:
        """Kernel ``number`` for any number of rows."""
        found = self._streams.get(number)
        if found is None:
            found = self._streams[number] = self.backend.stream(kernel)
        return found

    def evaluation(self, number: int, kernel: Kernel, rows: int) -> Evaluation:
        """The evaluation of kernel ``number`` for ``rows`` rows."""
        found = self._prepared.get((number, rows))
        if found is None:
            if self._prepared_rows + rows > MOST_PREPARED_ROWS:
                self._prepared.clear()
                self._prepared_rows = 0
            found = self.backend.prepare(kernel, rows)
            self._prepared[number, rows] = found
            self._prepared_rows += rows
        return found


BESIDE = -1_000_000
"""Below it are the numbers of kernels beside that of a likelihood, in caches."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """A kernel bound to the rows it holds for.

    ``positions`` (from 0) in the block's table, None without one; ``index`` (rows, variables) gives for each input of
    unknowns its place in the vector of all numbers, ``columns`` (rows, tangents) for each tangent its place in that of
    all coordinates; ``shared[j]`` and ``shared_columns[j]`` say that variable or tangent j is the same in all rows.
    Residuals stand at ``first …`` in the vector of all, units (one equation in one row) at ``first_unit …``. ``number``
    is the kernel's in the set of all, ``cache`` keeps what was made of it. ``gathered`` are the aggregates that a
    derived quantity takes. ``trusted`` (rows,) are those that no outlier rule may reject (None: none). ``readings``:
    what belongs to residuals that are those of a likelihood (None: they are not). ``equations`` are the
    kernel's, if it is one of equations.
    """

    kernel: Kernel
    evaluation: Evaluation
    positions: Positions | None
    index: Indices
    columns: Indices
    shared: tuple[bool, ...]
    shared_columns: tuple[bool, ...]
    parameters: Floats
    role: BlockRole = BlockRole.OBSERVATION
    whiteners: tuple[Whitener, ...] = ()
    losses: tuple[LossFunction, ...] = ()
    first: int = 0
    first_unit: int = 0
    number: int
    cache: EvaluationCache
    sampled: tuple[Sampled, ...] = ()
    gathered: Gathered | None = None
    trusted: Mask | None = None
    readings: Readings | None = None
    equations: tuple[Equation, ...] = ()

    @property
    def places(self) -> Indices:
        """``index`` with one row in place of equal ones."""
        return self.index[:1] if all(self.shared) else self.index

    @property
    def touched(self) -> Indices:
        """``columns`` with one row in place of equal ones."""
        return self.columns[:1] if all(self.shared_columns) else self.columns

    @property
    def reached(self) -> Indices:
        """The coordinates that the rows depend on, also by what they gather; those of aggregates lie behind all."""
        own = self.touched.ravel()
        return own if self.gathered is None else np.concatenate([own, self.gathered.touched])

    @property
    def units(self) -> Indices:
        """The unit of each scalar output, shape (rows, outputs)."""
        sizes = [w.last - w.first for w in self.whiteners]
        of_output = np.repeat(np.arange(len(sizes)), sizes)
        return self.first_unit + np.arange(self.rows)[:, None] * len(sizes) + of_output

    @property
    def written(self) -> Group:
        """The group with its equations as they are written, model − measured; itself where it has no likelihood."""
        return self.seen(plain=True)

    def seen(self, *, plain: bool) -> Group:
        """The group as its equations are written, or else by what they tell; itself where it has no likelihood."""
        kernel, stated = self.kernel.plain if plain else self.kernel.information, self.readings
        if kernel is None or stated is None:
            return self
        number = BESIDE - 2 * self.number - int(plain)
        return replace(
            self,
            kernel=kernel,
            number=number,
            evaluation=self.cache.evaluation(number, kernel, self.rows),
            whiteners=stated.plain if plain else self.whiteners,
            readings=None,
        )

    @property
    def counting(self) -> Mask:
        """Which outputs (outputs,) are part of χ²."""
        return np.ones(self.kernel.outputs, dtype=bool) if self.readings is None else ~self.readings.uncounted

    @property
    def left_out(self) -> Mask:
        """Which units (rows, units of a row) have a weight of zero: they take no part, and are no outliers either."""
        found = np.zeros((self.rows, len(self.whiteners)), dtype=bool)
        for k, each in enumerate(self.whiteners):
            found[:, k] = (each.weights[:, 0] if each.weights.ndim == 2 else each.weights[:, 0, 0]) == 0.0
        return found

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.index)

    @property
    def count(self) -> int:
        """Number of scalar outputs."""
        return self.rows * self.kernel.outputs

    def fill(self, numbers: Floats) -> None:
        """Put the vector of all numbers (N,) and the data into the inputs."""
        variables = self.index.shape[1]
        numbers = numbers if self.gathered is None else self.gathered.extended(numbers)
        self.evaluation.inputs[:, :variables] = numbers[self.places]
        self.evaluation.inputs[:, variables:] = self.parameters
        for each in self.sampled:
            each.fill(self.evaluation.inputs[:, variables:], lambda places: numbers[places], np.arange(self.rows))

    def sampled_inside(self, numbers: Floats) -> Mask:
        """Which rows (rows,) are sampled within the spans of the tables."""
        rows = np.arange(self.rows)
        inside = [each.inside(lambda places: numbers[places], rows) for each in self.sampled]
        return np.asarray(np.logical_and.reduce(inside)) if inside else np.ones(self.rows, dtype=bool)

    def values(self, numbers: Floats) -> Floats:
        """Outputs (rows, outputs), not whitened; of very many rows without memory for all their inputs."""
        if self.rows >= ROWS_IN_PARTS:
            return np.asarray(self.values_at(numbers[None])[0])
        self.fill(numbers)
        return self.evaluation.values()

    def values_at(self, points: Floats) -> Floats:
        """The same at points (P, N), many of them or a part of the rows in one call: (P, rows, outputs)."""
        stream, width = self.cache.stream(self.number, self.kernel), self.index.shape[1] + self.parameters.shape[1]
        result = np.empty((len(points), self.rows, self.kernel.outputs))
        step = max(INPUTS_AT_A_TIME // max(self.rows * width, 1), 1)
        height = max(INPUTS_AT_A_TIME // max(width, 1), 1)
        for first in range(0, len(points), step):
            for rows in (slice(top, top + height) for top in range(0, self.rows, height)):
                part = result[first : first + step, rows]
                part[...] = stream.values(self.inputs_at(points[first : first + step], rows)).reshape(part.shape)
        return result

    def inputs_at(self, points: Floats, rows: slice) -> Floats:
        """What the kernel is called with for some rows (P·some, variables + parameters), those of a point together."""
        parameters, variables = self.parameters[rows], self.index.shape[1]
        if self.gathered is not None:
            points = np.stack([self.gathered.extended(point) for point in points])
        inputs = np.empty((len(points), len(parameters), variables + parameters.shape[1]))
        inputs[:, :, :variables] = points[:, self.places if all(self.shared) else self.index[rows]]
        inputs[:, :, variables:] = parameters
        for each in self.sampled:
            each.fill(inputs[:, :, variables:], lambda places: points[:, places], np.arange(self.rows)[rows])
        return inputs.reshape(len(points) * len(parameters), inputs.shape[2])

    def whitened(self, values: Floats) -> Floats:
        """Outputs divided by their noise, shape (…, rows, outputs)."""
        if len(self.whiteners) == 1:
            return self.whiteners[0].apply(values)
        return np.concatenate([w.apply(values) for w in self.whiteners], axis=-1)

    def whiten_rows(self, derivatives: Floats) -> None:
        """Divide derivatives (rows, outputs, width) by the equations' own noise, in place."""
        for whitener in self.whiteners:
            lines = derivatives[:, whitener.first : whitener.last]
            if whitener.weights.ndim == 2:
                lines *= whitener.weights[:, :, None]
            else:
                step = max(WHITENED // lines[0].size, 1) if lines.size else 1
                for rows in (slice(start, start + step) for start in range(0, len(lines), step)):
                    lines[rows] = whitener.weights[rows] @ lines[rows]

    def scatter(self, columns: Indices) -> Scatter:
        """Where the Jacobian goes; ``columns`` (M,) gives the column of each coordinate, -1: nowhere."""
        kernel = self.kernel
        return scatter(kernel.jacobian_rows, kernel.jacobian_columns, self.columns, self.shared_columns, columns)

    def dense_jacobian(self, numbers: Floats, columns: Indices, width: int) -> Floats:
        """Jacobian, not whitened, shape (rows, outputs, width); ``columns`` (M,) places each coordinate, or -1."""
        if self.gathered is not None:
            inner, inputs, chain = self._by_aggregates(self.gathered, numbers, columns, width)
            return chain(inner.dense_jacobian(*inputs))
        result = np.zeros((self.rows, self.kernel.outputs, width))
        self.add_jacobian(numbers, self.scatter(columns), result)
        return result

    def dense_slopes(self, numbers: Floats, columns: Indices, width: int) -> Iterator[tuple[slice, Floats]]:
        """``dense_jacobian`` a part of the rows at a time: which ones, and theirs."""
        if self.gathered is not None:
            inner, whole, chain = self._by_aggregates(self.gathered, numbers, columns, width)
            yield from ((lines, chain(dense)) for lines, dense in inner.dense_slopes(*whole))
            return
        step = max(DENSE_PART // max(self.kernel.outputs * width, 1), 1)
        if step >= self.rows:
            yield slice(0, self.rows), self.dense_jacobian(numbers, columns, width)
            return
        self.fill(numbers)
        nonzeros = self.evaluation.values_and_jacobian()[1].copy()
        outputs, inputs = self.kernel.jacobian_rows, self.kernel.jacobian_columns
        for start in range(0, self.rows, step):
            rows = slice(start, min(start + step, self.rows))
            part = np.zeros((rows.stop - rows.start, self.kernel.outputs, width))
            scatter(outputs, inputs, self.columns[rows], self.shared_columns, columns).add(nonzeros[rows], part)
            yield rows, part

    def slope_lengths(self, numbers: Floats, weights: Floats) -> Floats:
        """The lengths (rows, outputs) of the slopes, each times the weight (M,) of its coordinate; of no aggregates."""
        self.fill(numbers)
        nonzeros = self.evaluation.values_and_jacobian()[1]
        terms = np.square(nonzeros * weights[self.touched[:, self.kernel.jacobian_columns]])
        of_output = self.kernel.jacobian_rows[:, None] == np.arange(self.kernel.outputs)
        return np.asarray(np.sqrt(terms @ of_output))

    def _by_aggregates(
        self, gathered: Gathered, numbers: Floats, columns: Indices, width: int
    ) -> tuple[Group, tuple[Floats, Indices, int], Callable[[Floats], Floats]]:
        """The group that takes aggregates as it takes unknowns, what it is called with, and the rest of the chain."""
        whole = np.concatenate([columns, width + np.arange(gathered.count)])
        inputs = (gathered.extended(numbers), whole, width + gathered.count)
        return replace(self, gathered=None), inputs, gathered.chained(numbers, columns, width)

    def add_jacobian(self, numbers: Floats, places: Scatter, target: Floats) -> Floats:
        """Add the Jacobian, not whitened, to ``target`` (rows, outputs, width); the ``values`` are the answer."""
        self.fill(numbers)
        values, nonzeros = self.evaluation.values_and_jacobian()
        places.add(nonzeros, target)
        return values


def all_seen(groups: tuple[Group, ...], *, plain: bool) -> tuple[Group, ...]:
    """All groups as their equations are written, or by what they tell, one after the other."""
    found, first, first_unit = [], 0, 0
    for each in groups:
        group = replace(each.seen(plain=plain), first=first, first_unit=first_unit)
        found.append(group)
        first += group.count
        first_unit += group.rows * len(group.whiteners)
    return tuple(found)


def block_rows(groups: Sequence[Group], number: int) -> Indices:
    """Positions in the vector of all residuals of the rows of block ``number``."""
    parts = [np.arange(g.first, g.first + g.count) for g in groups if g.kernel.owner == number]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)


def measured_side(
    problem: Problem, group: Group, tables: Mapping[str, Table], lines: Indices | slice = ALL
) -> Floats | None:
    """The measured values (rows, outputs) of some rows of a group, or None where an equation has no measured side."""
    block = problem.blocks[group.kernel.owner]
    table = tables[block.table] if block.table is not None else None
    positions = None if group.positions is None else group.positions[lines]
    columns: list[Values] = []
    for equation in block.cases[group.kernel.case].equations:
        if equation.measured is None:
            return None
        columns.extend(evaluate(equation.measured, lookup(table, positions, tables)))
    result = np.empty((1 if positions is None else len(positions), len(columns)))
    for j, column in enumerate(columns):
        result[:, j] = column
    return result


def affine(group: Group, mask: Mask) -> bool:
    """Whether the outputs of a group are affine in the coordinates that ``mask`` (M,) picks."""
    if group.gathered is not None or any(bool(mask[sampled.coordinates].any()) for sampled in group.sampled):
        return False
    touched = np.asarray(mask[group.touched].any(axis=0), dtype=bool)
    return group.kernel.affine_in(touched)


def mentioned(groups: tuple[Group, ...], size: int) -> Mask:
    """Which of all coordinates (M,) some equation in use depends on."""
    used = np.zeros(size, dtype=bool)
    for group in groups:
        # counted, as np.unique would load NumPy's masked arrays at every start
        columns = np.flatnonzero(np.bincount(group.kernel.jacobian_columns, minlength=len(group.kernel.tangents)))
        used[group.touched[:, columns].ravel()] = True
    return used
