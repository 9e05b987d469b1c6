"""Result → the result document of CONTRACT §2: a tree of dictionaries, lists, texts and numbers that JSON can hold.

The documents of many solves from their columns: that of one of them with the numbers of the others in its places.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from mbm.estimation.batches.types import REASONS
from mbm.problem.types import BlockRole
from mbm.report.blocks import BlockReports, ManyReports, kept
from mbm.report.constraints import limit_reports
from mbm.report.elements import GEOMETRIC, plain_key, shown_sigma, written as written_geometry
from mbm.report.encode import plain
from mbm.report.filled import conditions, noise_at, own_names, prior_names
from mbm.report.intervals import interval_document, intervals
from mbm.report.numbers import NUMBERS
from mbm.report.solve_document import constraint_document, corrections_document, raw_document, solve_document, solve_key
from mbm.report.types import CovarianceMatrix, DerivedValue, Estimate, Floats, Mask, Result, SolveReport
from mbm.text.render import as_json


def document(result: Result) -> dict[str, Any]:
    """The document of a result; keys stand in the contract's order, so equal results give equal texts.

    Numbers are in the units of their quantities, undefined ones None with a ``reason`` (or ``reasons``) beside them.
    What belongs to later versions (gauges) has its key and an empty value.
    """
    written = lazy_document(result)
    written["solves"] = [_copied(solve) for solve in written["solves"]]
    return written


def _copied(entry: Any) -> Any:
    """A tree of dictionaries and lists of its own, so that solves share nothing that a caller may change."""
    if type(entry) is dict:
        return {name: _copied(each) for name, each in entry.items()}
    return [_copied(each) for each in entry] if type(entry) is list else entry


def lazy_document(result: Result) -> dict[str, Any]:
    """The document, the solves of which are made while one goes through them: to be written, and not to be changed."""
    return {
        "mbm": result.version,
        "file": result.file,
        "problem": result.problem,
        "status": result.status.value,
        "seed": result.seed,
        "options": {name: plain(value) for name, value in result.options.items()},
        "inputs": [{"path": entry.path, "sha256": entry.sha256, "rows": entry.rows} for entry in result.inputs],
        "diagnostics": [as_json(diagnostic) for diagnostic in result.diagnostics],
        "solves": _Solves(result.solves),
    }


class _Solves(Sequence[dict[str, Any]]):
    """The documents of solves, made anew each time that one goes through them."""

    def __init__(self, solves: Sequence[SolveReport]) -> None:
        self._solves = solves

    def __len__(self) -> int:
        return len(self._solves)

    def __getitem__(self, index: Any) -> Any:
        return list(self)[index]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        if not isinstance(self._solves, ManyReports):
            yield from map(solve_document, self._solves)
            return
        # Loaded where there are many solves only, so that the others start at once.

        yield from self._solves.each(block_documents, solve_document)


def block_documents(reports: BlockReports) -> Iterator[dict[str, Any]]:
    """The documents of the solves of a block, one after the other; they may share parts that are the same in all."""
    filled = _Filled(reports) if reports.from_columns.any() and reports.complete else None
    for place in range(len(reports)):
        if filled is not None and filled.complete[place]:
            yield filled.document(place)
        else:
            yield solve_document(reports.report(place))


class _Filled:
    """Documents that differ from that of a model in numbers alone; ``complete`` (K,) says which all are finite."""

    def __init__(self, reports: BlockReports) -> None:
        self._block = block = reports.block
        self._reports = reports
        self._model = solve_document(reports.model)
        self._models: dict[bytes, dict[str, Any]] = {}
        columns = block.columns
        self._condition = conditions(columns, np.arange(len(reports))).tolist()
        summary: dict[str, Floats] = {
            name: getattr(columns, name) for name in ("iterations", "evaluations", "seconds")
        } | {number.name: number.columns(columns) for number in NUMBERS if self._model.get(number.name) is not None}
        self._observed = [i for i, b in enumerate(reports.problem.blocks) if b.role is BlockRole.OBSERVATION]
        self._priors, self._known = columns.priors.tolist(), reports.model.priors
        self._rms = np.where(columns.used == 0, np.array(None), columns.rms).tolist()
        self._rows, self._used = block.rows.tolist(), columns.used.tolist()
        items = [(item, _Item(item, reports.problem.request.coverage)) for item in reports.items]
        self._estimates = {i.quantity.name: each for i, each in items if isinstance(i, Estimate)}
        self._derived = {i.quantity.name: each for i, each in items if isinstance(i, DerivedValue)}
        images = [image for _, _, image in columns.derived]
        self._covariances = {
            name: _scaled(columns_factor, covariance)
            for name, columns_factor, covariance in (
                ("covariance", columns.factor, reports.model.covariance),
                ("derived_covariance", np.hstack(images) if images else None, reports.model.derived_covariance),
            )
        }
        self._numbers = {name: numbers.tolist() for name, numbers in summary.items()}
        self.complete = self._complete(reports, summary.values())

    def _complete(self, reports: BlockReports, summary: Iterable[Floats]) -> Mask:
        """The solves all numbers of which are finite."""
        columns = self._block.columns
        found = reports.from_columns.copy()
        for numbers in summary:
            found &= np.isfinite(numbers)
        unused = columns.used[:, self._observed] == 0  # and said so by the model of the kind
        found &= (unused | np.isfinite(columns.rms[:, self._observed])).all(axis=1)
        found &= np.isfinite(columns.priors).all(axis=1)
        found &= np.isfinite(self._condition) & np.isfinite(columns.noise).all(axis=1)
        if columns.limits is not None:
            found &= np.isfinite(columns.limits.values).all(axis=1)
        for each in (*self._estimates.values(), *self._derived.values()):
            found &= each.finite
        for factor in (columns.factor, *(image for _, _, image in columns.derived)):
            found &= np.isfinite(factor).all(axis=(1, 2))
        return found

    def document(self, place: int) -> dict[str, Any]:
        """The document of one solve, whose parts without numbers are those of the model."""
        model, block, limits = self._like(place), self._block, self._block.columns.limits
        written = {**model, **{name: numbers[place] for name, numbers in self._numbers.items()}}
        written["key"] = solve_key(dict(zip(block.names, block.keys[block.which.start + place], strict=True)))
        written["diagnostics"] = [*map(as_json, self._reports.remarks(place)), *model["diagnostics"]]
        written["message"] = REASONS[block.columns.reason[place]].sentence
        for kind, items in (("estimates", self._estimates), ("derived", self._derived)):
            written[kind] = {name: {**entry, **items[name].numbers(place)} for name, entry in model[kind].items()}
        for entry in block.layout.entries:
            name = entry.unknown.name
            if name in block.members:
                written["estimates"][name]["keys"] = list(map(plain_key, block.member_keys(entry, place) or ()))
        for name, matrices in self._covariances.items():
            if matrices is not None:
                written[name] = {**model[name], "matrix": matrices(place)}
        if block.members and written["covariance"] is not None:
            names = list(own_names(self._reports.problem, block, place))
            written["covariance"] = {**written["covariance"], "names": names}
        if model["observability"] is not None:
            written["observability"] = {**model["observability"], "condition": self._condition[place]}
            if limits is not None:
                dimension = int(limits.dimension[place])
                written["observability"] |= {"rank": dimension, "dimension": dimension}
        if limits is not None:
            reports = limit_reports(self._reports.problem, limits, place)
            written["constraints"] = [constraint_document(report) for report in reports]
        corrections = self._reports.corrected(place)
        if corrections:
            written["corrections"] = corrections_document(corrections)
        residuals, raw = {}, self._reports.raw_residuals(place)
        for i, (name, summary) in zip(self._observed, model["residuals"].items(), strict=True):
            found = self._block.columns.outliers[i]
            bad = [] if found is None else sorted(int(found.table.rows[position]) for position in found.of(place))
            own = {"rows": self._rows[place][i], "used": self._used[place][i], "rms": self._rms[place][i]}
            own |= raw_document(raw[name])
            residuals[name] = {**summary, **own, "outliers": bad}
        written["noise"] = noise_at(model["noise"], self._reports.problem, block.columns, place)
        written["residuals"] = residuals
        written["priors"] = [
            {**prior, "name": name, "value": known.mean + away, "residual": away / known.sigma}
            for prior, known, name, away in zip(
                model["priors"],
                self._known,
                prior_names(self._reports.model, block, place),
                self._priors[place],
                strict=True,
            )
        ]
        return written

    def _like(self, place: int) -> dict[str, Any]:
        """The document of a solve of the same kind."""
        kind = self._reports.kind(place)
        found = self._models.get(kind)
        if found is None:
            found = solve_document(self._reports.like(place))
            kept(self._models, kind, found)
        return found


class _Item:
    """An estimate or a derived quantity of all solves of a block, as documents hold it: ``finite`` (K,), ``sigma``."""

    def __init__(self, item: Estimate | DerivedValue, coverage: float) -> None:
        sigma = shown_sigma(item)
        self._quantity = item.quantity
        self._values: Floats | list[Any] = item.value
        if item.quantity.kind not in GEOMETRIC:
            self._values = item.quantity.scale.from_si(np.asarray(item.value, dtype=np.float64)).tolist()
        self.sigma: list[Any] = sigma.tolist()
        self.finite: Mask = _finite(np.asarray(item.value)) & _finite(sigma)
        self._intervals = intervals(item, coverage)

    def numbers(self, place: int) -> dict[str, Any]:
        """Value, sigma and interval of one solve."""
        found = {"value": self.value(place), "sigma": self.sigma[place]}
        return found | interval_document(self._intervals.at((place,)))

    def value(self, place: int) -> Any:
        """The value of one solve."""
        value = self._values[place]
        if self._quantity.kind not in GEOMETRIC:
            return value
        if value.ndim == 1:
            return written_geometry(self._quantity, value)
        return [written_geometry(self._quantity, numbers) for numbers in value]


def _finite(values: Floats) -> Mask:
    return np.asarray(np.isfinite(values).reshape(len(values), -1).all(axis=1))


def _scaled(factor: Floats | None, model: CovarianceMatrix | None) -> Callable[[int], list[list[float]]] | None:
    """What gives the covariance matrix of one solve in the units that are shown; None where there is none."""
    if factor is None or model is None or model.matrix is None:
        return None
    factors = np.array(model.factors)
    units = np.outer(factors, factors)

    def matrix(place: int) -> list[list[float]]:
        found: list[list[float]] = (factor[place] @ factor[place].T / units).tolist()
        return found

    return matrix
