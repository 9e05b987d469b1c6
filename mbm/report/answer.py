"""The result as Python users hold it: estimates by name, tables, pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.report.document import document, lazy_document
from mbm.report.encode import encode, to_bytes
from mbm.report.named import Named, named
from mbm.report.solve_columns import solve_columns
from mbm.report.table import table as text_table
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    Mask,
    Observability,
    ResidualRow,
    Result,
    SolveReport,
)
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbm.report.budgets.types import Budget
    from mbm.report.correlations import Correlation
    from mbm.report.trajectories.types import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """What ``Problem.solve`` answers. Attributes that belong to one solve are those of the first (often the only)."""

    result: Result

    @property
    def status(self) -> str:
        """``ok`` or ``attention``."""
        return self.result.status.value

    @property
    def solves(self) -> Sequence[SolveReport]:
        """One report for each solve."""
        return self.result.solves

    @property
    def first(self) -> SolveReport:
        """The first solve.

        Raises:
            LookupError: there is no solve: ``for-each`` met no key.

        """
        if not self.result.solves:
            message = "there is no solve: `for-each` met no key"
            raise LookupError(message)
        return self.result.solves[0]

    def __getitem__(self, name: str) -> Named:
        """An estimate or derived quantity of the only solve by name.

        Raises:
            LookupError: there is no solve, or there are several.
            KeyError: nothing is called so.

        """
        if len(self.result.solves) > 1:
            message = f"there are {len(self.result.solves)} solves: `{name}` of each is in `.table()`, or in `.solves`"
            raise LookupError(message)
        first = self.first
        for item in self._items():
            if item.quantity.name == name:
                return named(item, first.coverage)
        message = f"`{name}` is neither estimated nor derived; there are {', '.join(self)}"
        raise KeyError(message)

    def __iter__(self) -> Iterator[str]:
        """The names of all estimates, then those of all derived quantities; of several solves, those of the first."""
        return iter(self.keys())

    def __contains__(self, name: object) -> bool:
        """Whether something is called so."""
        return name in self.keys()

    def keys(self) -> tuple[str, ...]:
        """The names of all estimates, then those of all derived quantities; of several solves, those of the first."""
        return tuple(item.quantity.name for item in self._items())

    def _items(self) -> list[Estimate | DerivedValue]:
        return [*self.first.estimates, *self.first.derived] if self.result.solves else []

    @property
    def covariance(self) -> CovarianceMatrix | None:
        """Names and matrix (n, n) of the estimates' covariance, in the units of their sigmas; None without estimates.

        ``matrix`` is NaN where the data determine nothing, and None where it was left out for its size.
        """
        found = self.first.covariance
        if found is None or found.matrix is None:
            return found
        factors = np.array(found.factors)
        return replace(found, matrix=found.matrix / np.outer(factors, factors), factors=(1.0,) * len(factors))

    @property
    def correlation(self) -> Correlation | None:
        """Names and matrix (n, n) of the correlations of estimates, then derived quantities; None without estimates.

        NaN where one of two has no standard deviation; ``matrix`` is None where it was left out for its size.
        """
        from mbm.report.correlations import correlation_of

        return correlation_of(self.first)

    def budget(self, name: str, *, by_row: bool = False) -> Budget:
        """The uncertainty budget of one number of the only solve: ``h``, ``p[1]``, ``q["waist"]``.

        Args:
            name: as the covariance names it.
            by_row: rows of tables one by one; else those of a clause together.

        Raises:
            LookupError: there is no solve, or there are several.
            MbmError: unknown-quantity (also of several numbers, see ``budgets``), no-budget.

        """
        from mbm.report.budgets import faults

        found = self.budgets(name, by_row=by_row)
        if len(self.result.solves) > 1:
            message = f"there are {len(self.result.solves)} solves: `.budgets({name!r})` has those of each"
            raise LookupError(message)
        if len(found) > 1:
            raise MbmError(faults.several_quantities(name, [budget.quantity for budget in found]))
        return found[0]

    def budgets(self, *names: str, by_row: bool = False) -> tuple[Budget, ...]:
        """The budgets of all numbers of the quantities ``names``, or of all that there are, solve after solve.

        Raises:
            LookupError: there is no solve.
            MbmError: unknown-quantity; no-budget: nothing that was asked for has one.

        """
        from mbm.report.budgets.answer import answer_of

        _ = self.first
        return answer_of(self.result, names, by_row=by_row).budgets

    @property
    def observability(self) -> Observability | None:
        """The rank decision, and what is free."""
        return self.first.observability

    def residuals(self, clause: str | None = None) -> tuple[ResidualRow, ...]:
        """The residuals of one clause, or of all."""
        return tuple(r for r in self.first.rows() if clause is None or r.clause == clause)

    def document(self) -> dict[str, Any]:
        """The result document of CONTRACT §2."""
        return document(self.result)

    def to_json(self, path: str | Path | None = None) -> str:
        """The document as JSON text; written to ``path`` if one is given.

        Raises:
            MbmError: the file cannot be written (`not-writable`), or the result was made from it (`would-overwrite`).

        """
        text = encode(lazy_document(self.result))
        if path is not None:
            from mbm.files.writing import write_whole

            write_whole(path, to_bytes(text), reads=self.result.reads)
        return text

    def write(self, form: str, folder: str | Path, *, force: bool = False) -> None:
        """Write the estimates as files of other programs into a folder, with a list of them.

        ``form`` is ``colmap``, ``bundler``, ``opencv-yaml``, ``ply``, ``g2o``, ``tum`` or ``kitti``; ``force`` writes
        into a folder that holds other things, too. Lengths are in metres, images in px.

        Raises:
            MbmError: the problem lacks what the format needs (`format-needs`), `unknown-output`, `foreign-folder`,
                `would-overwrite`, `not-writable`; nothing was written.

        """
        from mbm.report.scenes.formats import write

        write(self.result, form, Path(folder), force=force, reads=self.result.reads)

    def trajectory(self, *deltas: str, observation: str | None = None) -> Trajectory:
        """The errors of the trajectory that an observation of the only solve lays on a reference.

        Args:
            deltas: steps of relative errors: ``10f`` rows, ``0.5s`` times, ``2m`` of the reference's path. Without any
                they are those of the pairs of the table with itself, else one row.
            observation: which one, where several could be meant.

        Raises:
            LookupError: there is no solve, or there are several.
            MbmError: no-trajectory, several-trajectories, bad-delta.

        """
        from mbm.report.trajectories.answer import trajectories_of

        if len(self.result.solves) > 1:
            message = f"there are {len(self.result.solves)} solves; the errors are those of one trajectory"
            raise LookupError(message)
        _ = self.first
        return trajectories_of(self.result, deltas, observation)[0]

    def predict(self, name: str, at: object = None, *, level: float | None = None, clause: str | None = None) -> Any:
        """A derived quantity at other values, and the interval of a new reading there.

        Args:
            name: the derived quantity, ``:over`` a grid or a table.
            at: the values: a table (as ``solve(data=…)`` takes) with the columns that its form depends on, in the units
                of the grid or table, or a list of numbers if there is one such column. None: those of the problem.
            level: the coverage probability of the intervals, between 0 and 1. None: that of the solve.
            clause: the observation whose noise a new reading has, if several have the quantity for their MODEL.

        Returns:
            One row for each value: the columns, ``value``, ``sigma``, ``low`` and ``high`` of the quantity, and
            ``reading_low`` and ``reading_high`` of a new reading, if the form is the MODEL of one observation; in the
            unit of the quantity. A pandas frame, else a dict of arrays. A reading scatters by the noise of the
            observation, beside what is uncertain of the quantity (Draper and Smith 1998, §3.1).

        Raises:
            LookupError: there is no solve, or there are several.
            KeyError: no derived quantity is called so.
            MbmError: `not-predicted`, or what is wrong with the table.

        """
        from mbm.report.predictions import predicted, prediction_table

        if len(self.result.solves) > 1:
            message = f"there are {len(self.result.solves)} solves; a prediction is made with one"
            raise LookupError(message)
        return prediction_table(predicted(self.first, name, at, level=level, clause=clause))

    def table(self) -> Any:
        """One row per solve: keys, status, cost, dof, scalars and sigmas (or low and high).

        A pandas frame, else a dict of arrays.
        """
        found = solve_columns(self.result.solves)
        arrays = {name: np.asarray([key.get(name) for key in found.keys]) for name in found.key_names}
        arrays["status"] = np.asarray([status.value for status in found.statuses])
        arrays |= {name: np.asarray(found.fits[name]) for name in ("cost", "dof")}
        for scalar in found.scalars:
            for end, numbers in (("", scalar.values), *scalar.sides):
                name = scalar.name + end
                arrays[name] = numbers if scalar.there.all() else _with_gaps(numbers, scalar.there)
        try:
            from pandas import DataFrame
        except ImportError:
            return arrays
        return DataFrame(arrays)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Residuals, ellipses, data against model: a matplotlib figure; drawn into ``path`` if one is given.

        Raises:
            MbmError: as for ``to_json``, and `plot-format`, `missing-extra`.

        """
        from mbm.report.plots import draw, save

        if path is not None:
            save(self.result, path)
        return draw(self.result)

    def __str__(self) -> str:
        return text_table(self.result)

    def __repr__(self) -> str:
        found = self.result
        return f"Solved(problem={found.problem!r}, status={self.status!r}, solves={len(found.solves)})"

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(str(self))}</pre>"


def _with_gaps(numbers: Floats, there: Mask) -> NDArray[np.object_]:
    """The numbers, None where they are not there."""
    found = numbers.astype(object)
    found[~there] = None
    return found
