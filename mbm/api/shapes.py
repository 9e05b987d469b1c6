"""How many rows the tables of a data set have, and what solves data sets with so many: each shape made ready once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from mbm import compiler
from mbm.api import faults
from mbm.api.varied import Varied, held_tables, varied
from mbm.compiler import Inputs
from mbm.equations.types import Floats
from mbm.estimation.batches.stream import Stream, stream_of
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.problem.checks import check_data
from mbm.problem.tables import Table
from mbm.report.options import SolveSettings
from mbm.report.types import SolveReport
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin
    from mbm.equations.assembly import Assembled
    from mbm.estimation.batches.robust_stream import RobustStream

MOST_SHAPES = 256
"""Shapes that are kept; all are forgotten where these are too many."""

Tables = Mapping[str, Table]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """What solves data sets of so many rows: ``entries`` are, input by input, the shape of one array and what puts it
    among the parameters of ``stream`` (None: the general path solves all of them; ``reason`` says why). ``tables`` have
    such rows.
    """

    columns: tuple[Varied, ...]
    entries: tuple[tuple[tuple[int, ...], Callable[[Floats], None]], ...] = field(repr=False)
    stream: Stream | RobustStream | None = field(repr=False)
    reason: str | None
    tables: Tables = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class General:
    """The general path, for the problem as it was compiled."""

    compilation: Compilation
    origin: Origin
    inputs: Inputs

    def report(self, tables: Tables) -> SolveReport:
        """The solve of some tables.

        Raises:
            MbmError: the data do not go with the problem.

        """
        found = replace(self.compilation.elaborated, tables=tables)
        errors, _ = check_data(found.problem, tables)
        if errors:
            raise MbmError(*errors)
        result = compiler.solved(
            found,
            self.compilation.kernels,
            self.inputs,
            SolveSettings(covariance_full=True),
            self.compilation.cache,
            self.origin.file,
            self.origin.registry,
        )
        return result.solves[0]

    def equations(self, tables: Tables) -> Assembled:
        """The equations of some tables.

        Raises:
            MbmError: the data do not go with the problem.

        """
        found = self.compilation.elaborated
        starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
        equations, _ = assemble(found.problem, self.compilation.kernels, tables, starts, self.compilation.cache)
        return equations if equations.implicit is None else equations.straightened() or equations


class Shapes:
    """The shapes of the data sets of an estimator, each made ready when it is first met.

    ``columns`` are its inputs, all measured columns if none are named; ``inputs`` and ``first`` those of the tables as
    they were compiled, whose solve is ``report``. Not to be shared between threads.
    """

    def __init__(self, general: General, columns: tuple[str, ...]) -> None:
        self._general = general
        found = general.compilation.elaborated
        equations = general.equations(found.tables)
        groups = (*equations.groups, *equations.constraints)
        chosen = varied(found.problem, found.tables, groups, columns)
        self.inputs = tuple(f"{each.table}.{each.name}" for each in chosen)
        self.report = general.report(found.tables)
        self._start = np.concatenate([np.ravel(estimate.value) for estimate in self.report.estimates])
        self._held = {
            **held_tables(found.problem, groups, chosen),
            **{name: faults.compiled_empty(name) for name, table in found.tables.items() if not len(table)},
        }
        self.first = self._shape(found.tables, equations, chosen)
        self._others: dict[tuple[int, ...], Shape] = {}

    def of(self, given: Sequence[Floats], sets: int | None) -> Shape:
        """The shape of arrays (rows,), or (``sets``, rows), one for each input.

        Raises:
            MbmError: the arrays do not fit (`wrong-input`), or the data of the first set do not go with the problem.

        """
        leading = () if sets is None else (sets,)
        rows: dict[str, int] = {}
        for name, each, cells in zip(self.inputs, self.first.columns, given, strict=True):
            held = self._held.get(each.table)
            wanted = each.rows if held is not None else rows.get(each.table)
            length = cells.shape[-1] if cells.ndim else 0
            if cells.shape != (*leading, length if wanted is None else wanted):
                raise MbmError(faults.wrong_shape(name, cells.shape, wanted, sets, held))
            rows[each.table] = length
        lengths = tuple(rows[each.table] for each in self.first.columns)
        if lengths == tuple(each.rows for each in self.first.columns):
            return self.first
        found = self._others.get(lengths)
        if found is None:
            if len(self._others) >= MOST_SHAPES:
                self._others.clear()
            one = [cells if sets is None else cells[0] if sets else np.zeros(cells.shape[1:]) for cells in given]
            found = self._others[lengths] = self._other(rows, one)
        return found

    def solved(self, shape: Shape, given: Sequence[Floats]) -> SolveReport:
        """The solve of one data set by the general path.

        Raises:
            MbmError: the data do not go with the problem.

        """
        return self._general.report(_replaced(shape, given))

    def _other(self, rows: Mapping[str, int], given: Sequence[Floats]) -> Shape:
        """The shape of so many ``rows`` of some tables; ``given`` is one data set."""
        compiled = self._general.compilation.elaborated.tables
        again = {name: np.arange(count) % len(compiled[name]) for name, count in rows.items()}
        taken = {name: compiled[name].take(which) for name, which in again.items()}  # inputs replace what is used
        blank = replace(self.first, tables={**compiled, **taken})
        tables = _replaced(blank, given)
        if not all(rows.values()):
            return replace(self.first, tables=tables, stream=None, reason="there are no rows", entries=())
        equations = self._general.equations(tables)
        groups = (*equations.groups, *equations.constraints)
        chosen = varied(self._general.compilation.elaborated.problem, tables, groups, self.inputs)
        found = self._shape(tables, equations, chosen)
        if found.stream is None and self.first.stream is not None:
            self._general.report(tables)  # tells which closed forms there are for so many rows
            found = self._shape(tables, equations, chosen)
        return found

    def _shape(self, tables: Tables, equations: Assembled, chosen: tuple[Varied, ...]) -> Shape:
        problem = self._general.compilation.elaborated.problem
        settings = settings_of(problem.request, forms=self._general.origin.registry.closed_forms)
        made = stream_of(problem, equations, settings, self._start, [each.cells for each in chosen])
        stream = None if isinstance(made, str) else made
        entries = () if stream is None else tuple(((each.rows,), each.entry(stream.single)) for each in chosen)
        return Shape(
            columns=chosen,
            entries=entries,
            stream=stream,
            reason=made if isinstance(made, str) else None,
            tables=tables,
        )


def _replaced(shape: Shape, given: Sequence[Floats]) -> Tables:
    """The tables of a shape, with ``given`` (rows,) in place of the columns that are inputs."""
    tables = dict(shape.tables)
    for each, cells in zip(shape.columns, given, strict=True):
        table = tables[each.table]
        column = replace(table.columns[each.name], numbers=each.scale.to_si(np.array(cells)))
        tables[each.table] = replace(table, columns={**table.columns, each.name: column})
    return tables
