"""One solve as Python users hold it: estimates by name, what the document says, tables, files, pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.report import faults
from mbm.report.document import document, lazy_document
from mbm.report.elements import element_names
from mbm.report.encode import encode, to_bytes
from mbm.report.named import Named, named
from mbm.report.said import Said
from mbm.report.solve_document import shown_observability
from mbm.report.table import table as text_table
from mbm.report.types import (
    Alternative,
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Observability,
    Piece,
    Result,
    SolveReport,
)
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbm.report.budgets.types import Budget
    from mbm.report.correlations import Correlation
    from mbm.report.regions import Region
    from mbm.report.trajectories.types import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimum:
    """Another minimum, hypothesis of a filter or separate piece: its ``estimates`` in the units of the report.

    ``cost`` and ``robust_cost`` as a solve has them (None: bounds have none), ``starts`` that led to it, ``weight`` of
    a hypothesis among all, a ``remark`` in words.
    """

    estimates: tuple[Named, ...]
    derived: tuple[Named, ...] = ()
    cost: float | None = None
    robust_cost: float | None = None
    starts: int | None = None
    weight: float | None = None
    remark: str | None = None

    def __getitem__(self, name: str) -> Named:
        """An estimate or derived quantity by name. Raises KeyError."""
        return _called(name, (*self.estimates, *self.derived))


@dataclass(frozen=True, slots=True, eq=False)
class Solve(Said):
    """One solve. Estimates and derived quantities are in the units of the report everywhere, all else as documented."""

    result: Result

    @property
    def record(self) -> SolveReport:
        """What the other attributes are made from, in SI."""
        return self.result.solves[0]

    @property
    def estimates(self) -> tuple[Named, ...]:
        """The estimates, as ``solve[name]`` has them."""
        return tuple(named(item, self.record.coverage) for item in self.record.estimates)

    @property
    def derived(self) -> tuple[Named, ...]:
        """The derived quantities, as ``solve[name]`` has them."""
        return tuple(named(item, self.record.coverage) for item in self.record.derived)

    def __getitem__(self, name: str) -> Named:
        """An estimate or derived quantity by name.

        Raises:
            LookupError: there is no solve, or there are several.
            KeyError: nothing is called so.

        """
        return _called(name, (*self.estimates, *self.derived))

    def __iter__(self) -> Iterator[str]:
        """The names of all estimates, then those of all derived quantities; of several solves, those of the first."""
        return iter(self.keys())

    def __contains__(self, name: object) -> bool:
        """Whether something is called so."""
        return name in self.keys()

    def keys(self) -> tuple[str, ...]:
        """The names of all estimates, then those of all derived quantities; of several solves, those of the first."""
        return tuple(item.quantity.name for item in self._items())

    def _items(self) -> tuple[Estimate | DerivedValue, ...]:
        solves = self.result.solves
        return (*solves[0].estimates, *solves[0].derived) if solves else ()

    @property
    def covariance(self) -> CovarianceMatrix | None:
        """Names and matrix (n, n) of the estimates' covariance, in the units of their sigmas; None without estimates.

        ``matrix`` is NaN where the data determine nothing, and None where it was left out for its size.
        """
        return _shown(self.record.covariance)

    @property
    def derived_covariance(self) -> CovarianceMatrix | None:
        """The same of the derived quantities; None where there are none."""
        return _shown(self.record.derived_covariance)

    @property
    def correlation(self) -> Correlation | None:
        """Names and matrix (n, n) of the correlations of estimates, then derived quantities; None without estimates.

        NaN where one of two has no standard deviation; ``matrix`` is None where it was left out for its size.
        """
        from mbm.report.correlations import correlation_of

        return correlation_of(self.record)

    @property
    def noise_dof(self) -> Mapping[str, float]:
        """The degrees of freedom of each estimated noise factor, by the names that ``noise`` has."""
        from mbm.report.budgets.budget import noise_dof

        return noise_dof(self.record)

    def budget(self, name: str, *, by_row: bool = False) -> Budget:
        """The uncertainty budget of one number of the only solve: ``h``, ``p[1]``, ``q["waist"]``.

        Args:
            name: as the covariance names it.
            by_row: rows of tables one by one; else those of a clause together.

        Raises:
            LookupError: there is no solve, or there are several.
            MbmError: unknown-quantity (also of several numbers, see ``budgets``), no-budget.

        """
        from mbm.report.budgets import faults as budget_faults

        _ = self.record
        found = self.budgets(name, by_row=by_row)
        if len(found) > 1:
            raise MbmError(budget_faults.several_quantities(name, [budget.quantity for budget in found]))
        return found[0]

    def budgets(self, *names: str, by_row: bool = False) -> tuple[Budget, ...]:
        """The budgets of all numbers of the quantities ``names``, or of all that there are, solve after solve.

        Raises:
            MbmError: unknown-quantity; no-budget: nothing that was asked for has one.

        """
        from mbm.report.budgets.answer import answer_of

        return answer_of(self.result, names, by_row=by_row).budgets

    @property
    def observability(self) -> Observability | None:
        """The rank decision, and what is free; coefficients are in the units of the report."""
        found = self.record.observability
        return None if found is None else shown_observability(found, self.record.estimates)

    @property
    def not_examined(self) -> Mapping[str, str]:
        """What was not looked at of the intervals (``curvature``, ``curvature of NAME``), and why."""
        return self.record.not_examined

    @property
    def alternatives(self) -> tuple[Minimum, ...]:
        """The other minima, then the separate pieces of guaranteed bounds."""
        coverage = self.record.coverage
        return (
            *(_minimum(each, coverage) for each in self.record.alternatives),
            *(_piece(each, coverage) for each in self.record.pieces),
        )

    @property
    def hypotheses(self) -> tuple[Minimum, ...]:
        """What a filter follows at the last step, the best first."""
        return tuple(_minimum(each, self.record.coverage) for each in self.record.hypotheses)

    def residuals(self, clause: str | None = None) -> Any:
        """The residuals of one clause, or of all: a pandas frame, else a dict of arrays; a row for each scalar.

        Columns: keys of the solves, ``clause`` (of all), ``row`` (of the unfiltered table, from 1), ``file_row``,
        ``component``, the columns of the clause's table, ``raw`` (MODEL − MEASURED), ``whitened``, ``weight``,
        ``leverage``, ``used``, ``outlier``; numbers are in SI. What the table calls alike is ``table.NAME``.

        Raises:
            MbmError: no clause is called so (`no-such-clause`).

        """
        from mbm.report.frames import frame, residual_columns

        known = list(dict.fromkeys(name for solve in self.result.solves for name in solve.residual_summaries))
        if clause is not None and clause not in known:
            raise MbmError(faults.no_such_clause(clause, known))
        return frame(residual_columns(self.result.solves, clause))

    def profile(self, name: str) -> Any:
        """The intervals of a scalar (``a``, ``p[1]``) at many levels: a pandas frame, else a dict of arrays.

        Columns: ``level``, ``k`` (coverage factor), ``low``, ``high`` (in the unit of the report), ``kind``. Where
        curvature misplaces the linear intervals the profile of the cost is followed (Bates and Watts 1988, chapter 6).

        Raises:
            KeyError: no scalar is called so.

        """
        from mbm.report.frames import frame, profile_columns

        _ = self.record
        for item in self._items():
            names = element_names(item.quantity, item.keys)
            if name in names:
                return frame(profile_columns(item, names.index(name)))
        known = [each for item in self._items() for each in element_names(item.quantity, item.keys)]
        raise KeyError(faults.no_number(name, known))

    def region(self, first: str, second: str, level: float | None = None) -> Region:
        """Where two scalars (``a``, ``p[1]``) of the only solve lie together, with the probability ``level``.

        None: that of the solve. An ellipse, or where the model bends the profile of the cost (Bates and Watts 1988).

        Raises:
            LookupError: there is no solve, or there are several.
            KeyError: no scalar is called so.
            ValueError: the level is no number between 0 and 1.
            MbmError: `no-region`.

        """
        from mbm.report.regions import region

        return region(self.record, (first, second), level)

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
            ValueError: the level is no number between 0 and 1.
            MbmError: `not-predicted`, or what is wrong with the table.

        """
        from mbm.report.predictions import predicted, prediction_table

        return prediction_table(predicted(self.record, name, at, level=level, clause=clause))

    def document(self) -> dict[str, Any]:
        """The result document, as the manual describes it (reference, "The result document")."""
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
        """The errors of the trajectory that an observation lays on a reference.

        Args:
            deltas: steps of relative errors: ``10f`` rows, ``0.5s`` times, ``2m`` of the reference's path. Without any
                they are those of the pairs of the table with itself, else one row.
            observation: which one, where several could be meant.

        Raises:
            LookupError: there is no solve, or there are several.
            MbmError: no-trajectory, several-trajectories, bad-delta.

        """
        from mbm.report.trajectories.answer import trajectories_of

        _ = self.record
        return trajectories_of(self.result, deltas, observation)[0]

    def plot(self, path: str | Path | None = None) -> Figure:
        """Residuals, ellipses, data against model: a matplotlib figure; drawn into ``path`` if one is given.

        Raises:
            MbmError: as for ``to_json``, and `plot-format`, `missing-extra`.

        """
        from mbm.report.plots import draw, save

        if path is not None:
            save(self.result, path)
        return draw(self.result)

    def report(self, path: str | Path) -> None:
        """Write one page with all that is to be said of it: ``.html`` (one file, no script) or ``.pdf``.

        Raises:
            MbmError: as for ``to_json``, and `report-format`, `missing-extra`.

        """
        from mbm.report.page.writing import save_report

        save_report(self.result, path)

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as data: what would be made when it is asked for is made now."""
        from mbm.report.pickled import as_data

        return type(self), (as_data(self.result),)

    def __str__(self) -> str:
        return text_table(self.result)

    def __repr__(self) -> str:
        found = self.record
        key = "".join(f", {name}={value!r}" for name, value in found.key.items())
        return f"Solve(problem={self.result.problem!r}{key}, status={found.status.value!r})"

    def _repr_html_(self) -> str:
        from mbm.report.page.writing import notebook

        return notebook(self.result)


def _called(name: str, items: tuple[Named, ...]) -> Named:
    for item in items:
        if item.name == name:
            return item
    message = f"`{name}` is neither estimated nor derived; there are {', '.join(item.name for item in items)}"
    raise KeyError(message)


def _shown(found: CovarianceMatrix | None) -> CovarianceMatrix | None:
    if found is None or found.matrix is None:
        return found
    factors = np.array(found.factors)
    return replace(found, matrix=found.matrix / np.outer(factors, factors), factors=(1.0,) * len(factors))


def _minimum(found: Alternative, coverage: float) -> Minimum:
    return Minimum(
        estimates=tuple(named(item, coverage) for item in found.estimates),
        cost=found.cost,
        robust_cost=found.robust_cost,
        starts=found.starts,
        weight=found.weight,
        remark=found.remark,
    )


def _piece(found: Piece, coverage: float) -> Minimum:
    estimates, derived = (tuple(named(item, coverage) for item in each) for each in (found.estimates, found.derived))
    return Minimum(estimates=estimates, derived=derived)
