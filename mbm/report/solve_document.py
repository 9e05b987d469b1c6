"""One solve → its part of the result document (CONTRACT §2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from mbm.equations.corrected import CorrectedColumn
from mbm.report.elements import GEOMETRIC, plain_key, shown_bounds, shown_sigma, unit_text, written as written_geometry
from mbm.report.encode import number, numbers
from mbm.report.intervals import interval_document, intervals
from mbm.report.numbers import NUMBERS, USUAL
from mbm.report.row_data import RawResiduals, ResidualSummary
from mbm.report.types import (
    Alternative,
    ConstraintReport,
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    Key,
    Observability,
    Piece,
    SolveReport,
)
from mbm.text.render import as_json


def solve_key(key: Mapping[str, Key]) -> dict[str, Any]:
    """The key of a solve as documents hold it: whole numbers as integers."""
    return {name: plain_key(value) for name, value in key.items()}


def solve_document(solve: SolveReport) -> dict[str, Any]:
    """The document of one solve."""
    fit = {each.name: number(getattr(solve, each.name)) for each in NUMBERS}
    reasons = {name: solve.reasons.get(name) or _why_missing(solve, name) for name in USUAL if fit[name] is None}
    written: dict[str, Any] = {
        "key": solve_key(solve.key),
        "status": solve.status.value,
        "message": solve.message,
        "method": solve.method,
        "iterations": solve.iterations,
        "evaluations": solve.evaluations,
        "seconds": number(solve.seconds),
        **{name: found for name, found in fit.items() if name in USUAL or getattr(solve, name) is not None},
    }
    if reasons:
        written["reasons"] = reasons
    corrections = {"corrections": corrections_document(solve.corrections)} if solve.corrections else {}
    return written | {
        "estimates": {
            item.quantity.name: _with_followed(_estimate(item, solve.coverage), item, solve) for item in solve.estimates
        },
        "covariance": _covariance(solve.covariance),
        "derived": {item.quantity.name: _derived(item, solve.coverage) for item in solve.derived},
        "derived_covariance": _covariance(solve.derived_covariance),
        "observability": _observability(solve.observability, solve.estimates),
        "noise": {name: n if isinstance(n, Mapping) else number(n) for name, n in solve.noise.items()},
        "residuals": _residuals(solve),
        **corrections,
        "constraints": [constraint_document(constraint) for constraint in solve.constraints],
        "priors": [{name: x if name == "name" else number(x) for name, x in asdict(p).items()} for p in solve.priors],
        "alternatives": [*map(_alternative, solve.alternatives), *map(_piece, solve.pieces)],
        **({"hypotheses": [_hypothesis(found) for found in solve.hypotheses]} if solve.hypotheses else {}),
        "starts": None if solve.starts is None else asdict(solve.starts),
        **({"not_examined": dict(solve.not_examined)} if solve.not_examined else {}),
        "diagnostics": [as_json(diagnostic) for diagnostic in solve.diagnostics],
    }


def corrections_document(columns: tuple[CorrectedColumn, ...]) -> dict[str, Any]:
    """Corrections by table and column, in SI."""
    written: dict[str, Any] = {}
    for each in columns:
        keys = {} if each.keys is None else {"keys": [None if k is None else plain_key(k) for k in each.keys]}
        written.setdefault(each.table, {})[each.column] = {
            "rows": list(each.rows),
            **keys,
            "value": numbers(each.value),
            "sigma": numbers(each.sigma),
        }
    return written


def _alternative(found: Alternative) -> dict[str, Any]:
    robust = {} if found.robust_cost is None else {"robust_cost": number(found.robust_cost)}
    written: dict[str, Any] = {
        "cost": number(found.cost),
        **robust,
        "starts": found.starts,
        "estimates": {item.quantity.name: _estimate(item) for item in found.estimates},
    }
    return written if found.remark is None else written | {"remark": found.remark}


def _piece(found: Piece) -> dict[str, Any]:
    return {
        "estimates": {item.quantity.name: _estimate(item) for item in found.estimates},
        "derived": {item.quantity.name: _derived(item, None) for item in found.derived},
    }


def _hypothesis(found: Alternative) -> dict[str, Any]:
    return {
        "cost": number(found.cost),
        "weight": number(found.weight),
        "estimates": {item.quantity.name: _estimate(item) for item in found.estimates},
    }


def _with_followed(written: dict[str, Any], item: Estimate, solve: SolveReport) -> dict[str, Any]:
    """A state with the number of hypotheses per step, where there were several."""
    several = item.quantity.over is not None and any(count > 1 for count in solve.followed)
    return written | {"hypotheses": list(solve.followed)} if several else written


def _why_missing(solve: SolveReport, name: str) -> str:
    return "it was not computed" if getattr(solve, name) is None else "the value is not finite"


def _estimate(item: Estimate, coverage: float | None = None) -> dict[str, Any]:
    """An estimate, with its interval where a ``coverage`` is asked for."""
    over = item.quantity.over
    written = _family("per", item.per, item.keys) if over is None else _family("over", over, item.keys)
    written |= _value_and_sigma(item)
    if coverage is not None and item.spread is not None:
        written |= interval_document(intervals(item, coverage))
    if item.fixed.any():
        written["fixed"] = item.fixed.tolist()
    if item.at_bound is not None and item.at_bound.any():
        written["at_bound"] = item.at_bound.tolist()
    return written


def _derived(item: DerivedValue, coverage: float | None) -> dict[str, Any]:
    interval = {} if item.spread is None or coverage is None else interval_document(intervals(item, coverage))
    family = _family("over", item.quantity.over or item.over, item.keys)
    return family | _value_and_sigma(item) | interval


def _family(word: str, table: str | None, keys: tuple[Key, ...] | None) -> dict[str, Any]:
    return {} if keys is None else {word: table, "keys": [plain_key(key) for key in keys]}


def _value_and_sigma(item: Estimate | DerivedValue) -> dict[str, Any]:
    """Value, sigma (or bounds) and unit, and the reason where one of the numbers is missing."""
    bounds = shown_bounds(item)
    if bounds is not None:
        written = {"value": _value(item), "bounds": numbers(bounds), "unit": unit_text(item.quantity) or None}
        return written if _known(bounds) else written | {"reason": item.reason or "it is not bounded"}
    sigma = shown_sigma(item)
    written = {
        "value": _value(item),
        "sigma": numbers(sigma),
        "unit": unit_text(item.quantity) or None,
    }
    if not _known(sigma) or not _known(item.value):
        written["reason"] = item.reason or _why_undefined(item, sigma)
    return written


def _value(item: Estimate | DerivedValue) -> Any:
    """The value in its unit: numbers, or what documents hold for rotations, poses, similarities and directions."""
    if item.quantity.kind not in GEOMETRIC:
        return numbers(item.quantity.scale.from_si(np.asarray(item.value)))
    if item.keys is None:
        return written_geometry(item.quantity, item.value)
    return [written_geometry(item.quantity, numbers) for numbers in item.value]


def _why_undefined(item: Estimate | DerivedValue, sigma: Floats) -> str:
    if not _known(item.value):
        return "the value is not finite"
    held = item.at_bound if isinstance(item, Estimate) else None
    if held is not None and bool(np.all(np.isfinite(sigma) | held)):
        return "held at its bound"
    return "no standard deviation was computed" if item.sigma is None else "the data do not determine it"


def _covariance(covariance: CovarianceMatrix | None) -> dict[str, Any] | None:
    if covariance is None:
        return None
    written: dict[str, Any] = {"names": list(covariance.names)}
    if covariance.matrix is None:
        return written | {"matrix": None, "reason": covariance.reason or "it was not computed"}
    factors = np.array(covariance.factors)
    written["matrix"] = numbers(covariance.matrix / np.outer(factors, factors))
    if not _known(covariance.matrix):
        written["reason"] = covariance.reason or "null stands for what the data do not determine"
    return written


def _observability(found: Observability | None, estimates: Sequence[Estimate]) -> dict[str, Any] | None:
    if found is None:
        return None
    condition = number(found.condition)
    written: dict[str, Any] = {"rank": found.rank, "dimension": found.dimension, "condition": condition}
    if condition is None:
        written["reason"] = "there is no estimable part whose condition could be given"
    return written | {
        "unobservable": [
            {
                "sentence": each.sentence,
                "unknowns": list(each.unknowns),
                "coefficients": {name: number(movement) for name, movement in each.coefficients.items()},
            }
            for each in shown_observability(found, estimates).unobservable
        ],
        "gauge": [
            {"sentence": g.sentence, "motion": g.motion, "dimensions": g.dimensions, "unknowns": list(g.unknowns)}
            for g in found.gauge
        ],
        "unused": list(found.unused),
    }


def shown_observability(found: Observability, estimates: Sequence[Estimate]) -> Observability:
    """The same with coefficients in the units of the estimates."""
    factors = {item.quantity.name: item.quantity.scale.factor for item in estimates}
    free = tuple(
        replace(each, coefficients={n: c / factors.get(_quantity_of(n), 1.0) for n, c in each.coefficients.items()})
        for each in found.unobservable
    )
    return replace(found, unobservable=free)


def _quantity_of(name: str) -> str:
    """The unknown whose number is called so."""
    return name.partition("[")[0].partition("@")[0]


def _residuals(solve: SolveReport) -> dict[str, Any]:
    summaries = solve.residual_summaries
    raw = solve.raw_residuals() if summaries else {}
    return {name: _summary(summary, raw.get(name, RawResiduals())) for name, summary in summaries.items()}


def raw_document(raw: RawResiduals) -> dict[str, Any]:
    """What documents say of raw residuals: of numbers one mean, a list where vectors have several."""
    means = [
        {"value": each.value, "unit": each.unit, "per": each.per}
        | ({} if each.equation is None else {"equation": each.equation})
        for each in raw.means
    ]
    return {"rms_unit": means[0] if len(means) == 1 else means} | (
        {"behind_camera": list(raw.behind)} if raw.behind else {}
    )


def _summary(summary: ResidualSummary, raw: RawResiduals) -> dict[str, Any]:
    rms = number(summary.rms)
    written: dict[str, Any] = {"rows": summary.rows, "used": summary.used, "rms": rms, **raw_document(raw)}
    written["outliers"] = list(summary.outliers)
    return written if rms is not None else written | {"reason": "no row was used"}


def constraint_document(constraint: ConstraintReport) -> dict[str, Any]:
    """A constraint as documents hold it."""
    written: dict[str, Any] = {
        "name": constraint.name,
        "type": constraint.kind,
        "value": number(constraint.value),
        "violation": number(constraint.violation),
        "active": constraint.active,
    }
    if not math.isfinite(constraint.value):
        written["reason"] = "it has no finite value"
    if constraint.over is None:
        return written
    return written | {
        "over": constraint.over,
        "rows": constraint.rows,
        "violated_rows": list(constraint.violated_rows),
        "active_rows": list(constraint.active_rows),
    }


def _known(values: Floats) -> bool:
    """Whether all are finite; single numbers, of which there may be very many, are looked at in Python."""
    return math.isfinite(values) if np.ndim(values) == 0 else bool(np.isfinite(values).all())
