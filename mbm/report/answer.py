"""The result as Python users hold it: estimates by name, tables, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.report.document import document, lazy_document
from mbm.report.elements import shown_sigma
from mbm.report.encode import encode, to_bytes
from mbm.report.geometric import GEOMETRIC, number_factors
from mbm.report.intervals import Intervals, intervals
from mbm.report.solve_columns import solve_columns
from mbm.report.table import table as text_table
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    Key,
    Mask,
    Observability,
    ResidualRow,
    Result,
    SolveReport,
)
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """One estimate or derived quantity in the unit that it is reported in.

    ``value`` and ``sigma`` are NumPy arrays of the quantity's shape (0-d for a number), with a leading axis over
    ``keys`` for families; ``sigma`` is 0 where fixed, NaN where held at a bound or not determined by the data.
    Rotations are unit quaternions (w, x, y, z), or angles in the plane; poses add the translation, similarities the
    scale. Their ``sigma`` is that of rotation vector, translation and logarithm of the scale. ``item`` is what it was
    made from, ``coverage`` that of the solve.
    """

    name: str
    value: Floats
    sigma: Floats
    unit: str | None
    keys: tuple[Key, ...] | None
    item: Estimate | DerivedValue = field(repr=False)
    coverage: float = 0.95

    @property
    def dof(self) -> Floats:
        """Effective degrees of freedom of ``sigma``, of its shape; infinite where the noise was stated."""
        return self._intervals(self.coverage).dof

    @property
    def k(self) -> Floats:
        """The coverage factor at the coverage of the solve, of the shape of ``sigma``."""
        return self._intervals(self.coverage).k

    @property
    def U(self) -> Floats:  # noqa: N802 - the GUM's name of it
        """The expanded uncertainty ``k·sigma``, in the unit of the value."""
        return self._intervals(self.coverage).expanded

    @property
    def interval_kind(self) -> NDArray[np.object_]:
        """How each interval was found: ``t``, ``profile`` or ``limited``; None where there is none."""
        return self._intervals(self.coverage).names()

    def interval(self, level: float | None = None) -> Floats:
        """Low and high end along the last axis, in the unit of the value; ``level`` None: the coverage of the solve.

        NaN where no standard deviation is known, infinite where a profile has no end.

        Raises:
            ValueError: the level does not lie between 0 and 1.

        """
        level = self.coverage if level is None else level
        if not 0.0 < level < 1.0:
            message = f"the level of an interval lies between 0 and 1, and {level!r} does not"
            raise ValueError(message)
        found = self._intervals(level)
        return np.stack([found.low, found.high], axis=-1)

    def _intervals(self, level: float) -> Intervals:
        return intervals(self.item, level)


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
        items: list[Estimate | DerivedValue] = [*self.first.estimates, *self.first.derived]
        for item in items:
            if item.quantity.name == name:
                return _named(item, self.first.coverage)
        known = ", ".join(i.quantity.name for i in items)
        message = f"`{name}` is neither estimated nor derived; there are {known}"
        raise KeyError(message)

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

    def table(self) -> Any:
        """One row per solve: keys, status, cost, dof, scalars and sigmas; a pandas frame, else a dict of arrays."""
        found = solve_columns(self.result.solves)
        arrays = {name: np.asarray([key.get(name) for key in found.keys]) for name in found.key_names}
        arrays["status"] = np.asarray([status.value for status in found.statuses])
        arrays |= {name: np.asarray(found.fits[name]) for name in ("cost", "dof")}
        for scalar in found.scalars:
            for name, numbers in ((scalar.name, scalar.values), (f"{scalar.name}.sigma", scalar.sigmas)):
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


def _named(item: Estimate | DerivedValue, coverage: float) -> Named:
    factor = number_factors(item.quantity) if item.quantity.kind in GEOMETRIC else item.quantity.factor
    value = np.asarray(item.value / factor)
    return Named(item.quantity.name, value, shown_sigma(item), item.quantity.unit, item.keys, item, coverage)
