"""The report of one of many solves, filled from columns: that of another solve with its own numbers in their places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbm.equations.corrected import CorrectedColumn
from mbm.equations.layout import Entry
from mbm.equations.types import Indices
from mbm.estimation.batches.types import REASONS, Block, Columns
from mbm.estimation.search.solution import Solution
from mbm.problem.naming import PRIOR
from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.constraints import limit_reports
from mbm.report.elements import element_names
from mbm.report.later import guarded
from mbm.report.numbers import numbers_at
from mbm.report.pictures import maps_of, plot_data
from mbm.report.quantities import derived_quantity, quantity_of
from mbm.report.residuals import places_of, residual_rows, row_data
from mbm.report.row_data import ResidualSummary
from mbm.report.spreads import Spread
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    Observability,
    SolveReport,
)
from mbm.values import once


def families(problem: Problem, block: Block) -> Iterator[Estimate | DerivedValue]:
    """The unknowns, then the derived quantities, of the solves of a block, each as a family over the solves.

    Those of families have their members along the second axis.
    """
    count = len(block.which)
    members = tuple(float(number) for number in block.which)
    every = np.full((count, len(block.layout.number)), np.nan)
    every[:, block.free] = block.columns.sigma
    reported = block.layout.reported(block.columns.points)
    for entry in block.layout.entries:
        unknown, place = entry.unknown, entry.coordinates
        shape = unknown.shape if not unknown.dimension else (unknown.freedom,)
        shape, leading = (shape, ()) if entry.keys is None else ((entry.members, *shape), (entry.members,))
        numbers = block.columns.points[:, entry.range]
        values = reported[:, entry.range]
        yield Estimate(
            quantity=quantity_of(problem, unknown),
            value=values.reshape(count, *leading, *unknown.shape),
            sigma=every[:, place].reshape(count, *shape),
            fixed=np.broadcast_to(block.layout.fixed[place].reshape(shape), (count, *shape)),
            keys=members,
            spread=_spread(block, entry, numbers, values).shaped((count, *shape)),
        )
    degrees = block.columns.degrees.derived
    for derived, (values, sigma, _), freedom in zip(problem.derived, block.columns.derived, degrees, strict=True):
        stated = derived.shape if derived.kind is None else (sigma.shape[1],)
        yield DerivedValue(
            quantity=derived_quantity(problem, derived),
            value=values.reshape(count, *derived.shape),
            sigma=sigma.reshape(count, *stated),
            keys=members,
            spread=Spread(dof=freedom.dof, inflation=freedom.inflation).shaped((count, *stated)),
        )


def _spread(block: Block, entry: Entry, numbers: Floats, values: Floats) -> Spread:
    """Degrees of freedom and limits (K, coordinates) of an unknown, whose ``numbers`` are reported as ``values``."""
    degrees, shape = block.columns.degrees, (len(block.which), len(block.layout.number))

    def every(own: Floats, other: float) -> Floats:
        whole = np.full(shape, other)
        whole[:, block.free] = own
        return whole[:, entry.coordinates]

    found = Spread(dof=every(degrees.estimates.dof, np.inf), inflation=every(degrees.estimates.inflation, 1.0))
    if degrees.limited is None:
        return found
    turned = (values - numbers) if entry.unknown.kind is UnknownKind.ANGLE else np.zeros((shape[0], 1))
    return replace(
        found,
        lower=every(degrees.limited.lower, -np.inf) + turned,
        upper=every(degrees.limited.upper, np.inf) + turned,
    )


def filled(
    model: SolveReport,
    items: tuple[Estimate | DerivedValue, ...],
    corrections: tuple[CorrectedColumn, ...],
    problem: Problem,
    block: Block,
    place: int,
) -> SolveReport:
    """The report of the clean solve at a ``place``: that of another one, the ``model``, with its own numbers.

    ``items`` are the estimates and derived quantities as families over the solves of the block, ``corrections`` those
    of measured values in this solve.
    """
    columns, number = block.columns, block.which.start + place
    factor = columns.factor[place]
    estimates = [item for item in items if isinstance(item, Estimate)]
    derived = [item for item in items if isinstance(item, DerivedValue)]
    images = [image[place] for _, _, image in columns.derived]
    return replace(
        model,
        message=REASONS[columns.reason[place]].sentence,
        key=dict(zip(block.names, block.keys[number], strict=True)),
        iterations=int(columns.iterations[place]),
        evaluations=int(columns.evaluations[place]),
        seconds=float(columns.seconds[place]),
        **numbers_at(columns, place, model),
        estimates=tuple(
            replace(
                like,
                value=each.value[place],
                sigma=_at(each.sigma, place),
                fixed=each.fixed[place],
                keys=block.member_keys(entry, place),
                spread=None if each.spread is None else each.spread.at(place),
            )
            for like, each, entry in zip(model.estimates, estimates, block.layout.entries, strict=True)
        ),
        derived=tuple(
            replace(
                each,
                value=each.value[place],
                sigma=_at(each.sigma, place),
                keys=None,
                spread=None if each.spread is None else each.spread.at(place),
            )
            for each in derived
        ),
        covariance=_with_matrix(_renamed(model.covariance, problem, block, place), factor),
        derived_covariance=_with_matrix(model.derived_covariance, np.vstack(images)) if images else None,
        observability=_observed(model.observability, columns, place),
        constraints=model.constraints if columns.limits is None else limit_reports(problem, columns.limits, place),
        noise=noise_at(model.noise, problem, columns, place),
        summaries=once(lambda: dict(_summaries(model, problem, block, place))),
        corrections=corrections,
        priors=tuple(
            replace(prior, name=name, value=prior.mean + away, residual=away / prior.sigma)
            for prior, name, away in zip(
                model.priors, prior_names(model, block, place), columns.priors[place].tolist(), strict=True
            )
        ),
        made_from=lambda: (problem, _solution(block, number)),
        rows=guarded(block.lock, lambda: residual_rows(problem, _solution(block, number))),
        row_data=guarded(block.lock, lambda: row_data(problem, _solution(block, number))),
        pictures=guarded(block.lock, lambda: plot_data(problem, _solution(block, number))),
        maps=guarded(block.lock, lambda: maps_of(problem, _solution(block, number))),
    )


def noise_at(model: Mapping[str, Any], problem: Problem, columns: Columns, place: int) -> dict[str, float | None]:
    """The noise of a solve, by the names of factors; ``model`` says for another one which of them are estimated."""
    names = (each.factor_name for each in problem.blocks)
    found = dict(zip(names, columns.noise[place].tolist(), strict=True))
    return {name: None if estimated is None else found[name] for name, estimated in model.items()}


def _observed(model: Observability | None, columns: Columns, place: int) -> Observability | None:
    if model is None:
        return None
    condition = float(conditions(columns, np.arange(place, place + 1))[0])
    if columns.limits is None:
        return replace(model, condition=condition)
    dimension = int(columns.limits.dimension[place])
    return replace(model, condition=condition, rank=dimension, dimension=dimension)


@np.errstate(all="ignore")
def conditions(columns: Columns, which: Indices) -> Floats:
    """The conditions (K,) of the scaled Jacobians of some solves."""
    scaled = columns.root[which] * columns.scale[which][:, :, None]
    singular = np.linalg.svd(np.where(np.isfinite(scaled), scaled, 1.0), compute_uv=False)
    last = np.full(len(which), -1) if columns.limits is None else columns.limits.moving[which] - 1
    return np.asarray(singular[:, 0] / singular[np.arange(len(which)), last])


def _at(values: Floats | None, place: int) -> Floats | None:
    return None if values is None else np.asarray(values[place])


def _renamed(model: CovarianceMatrix | None, problem: Problem, block: Block, place: int) -> CovarianceMatrix | None:
    """The covariance of estimates with the names that they have in a solve."""
    names = own_names(problem, block, place) if block.members else None
    return model if model is None or names is None else replace(model, names=names)


def prior_names(model: SolveReport, block: Block, place: int) -> list[str]:
    """What the priors of a solve are called, of which another one, the ``model``, has the same under its own names."""
    names = [prior.name for prior in model.priors]
    if not block.members:
        return names
    own: dict[str, str] = {}
    for entry, estimate in zip(block.layout.entries, model.estimates, strict=True):
        there = element_names(estimate.quantity, estimate.keys)
        own.update(zip(there, element_names(estimate.quantity, block.member_keys(entry, place)), strict=True))
    plain = [name.removeprefix(PRIOR) for name in names]
    return [PRIOR + own.get(bare, bare) if bare != name else name for bare, name in zip(plain, names, strict=True)]


def own_names(problem: Problem, block: Block, place: int) -> tuple[str, ...]:
    """The names of the free coordinates of a solve."""
    names = [
        name
        for entry in block.layout.entries
        for name in element_names(quantity_of(problem, entry.unknown), block.member_keys(entry, place))
    ]
    return tuple(names[coordinate] for coordinate in block.free.tolist())


def _with_matrix(model: CovarianceMatrix | None, factor: Floats) -> CovarianceMatrix | None:
    """The covariance ``factor @ factorᵀ`` under the names of the model; None, or without a matrix, where that is."""
    return model if model is None or model.matrix is None else replace(model, matrix=factor @ factor.T)


def _summaries(model: SolveReport, problem: Problem, block: Block, place: int) -> Iterator[tuple[str, ResidualSummary]]:
    for i, each in enumerate(problem.blocks):
        if each.role is not BlockRole.OBSERVATION:
            continue
        found = block.columns.outliers[i]
        bad = [] if found is None else found.of(place)
        rms = float(block.columns.rms[place, i])
        yield (
            each.name,
            replace(
                model.residual_summaries[each.name],
                rows=int(block.rows[place, i]),
                used=int(block.columns.used[place, i]),
                rms=rms if np.isfinite(rms) else None,
                outliers=() if found is None else tuple(sorted(int(found.table.rows[position]) for position in bad)),
                outlier_places=() if found is None else places_of(found.table, bad),
            ),
        )


def _solution(block: Block, number: int) -> Solution:
    """What a clean solve ended with.

    Raises:
        RuntimeError: made again, it ends otherwise.

    """
    solution = block.solution(number)
    if not isinstance(solution, Solution):
        raise RuntimeError(f"solve {number} ended otherwise than before")
    return solution
