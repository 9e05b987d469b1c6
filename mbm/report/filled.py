"""The report of one of many solves, filled from columns: that of another solve with its own numbers in their places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.from_solution import wrapped
from mbm.report.pictures import plot_data
from mbm.report.quantities import derived_quantity, quantity_of
from mbm.report.residuals import file_rows, residual_rows
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    PlotData,
    ResidualRow,
    ResidualSummary,
    SolveReport,
)
from mbm.solution.many.types import REASONS, Block
from mbm.solution.solution import Solution


def families(problem: Problem, block: Block) -> Iterator[Estimate | DerivedValue]:
    """The unknowns, then the derived quantities, of the solves of a block, each as a family over the solves."""
    count = len(block.which)
    members = tuple(float(number) for number in block.which)
    every = np.full((count, len(block.layout.number)), np.nan)
    every[:, block.free] = block.columns.sigma
    for entry in block.layout.entries:
        unknown, place = entry.unknown, entry.coordinates
        shape = unknown.shape if not unknown.dimension else (unknown.freedom,)
        numbers = block.columns.points[:, entry.range]
        values = wrapped(numbers) if unknown.kind is UnknownKind.ANGLE else numbers
        yield Estimate(
            quantity=quantity_of(problem, unknown),
            value=values.reshape(count, *unknown.shape),
            sigma=every[:, place].reshape(count, *shape),
            fixed=np.broadcast_to(block.layout.fixed[place].reshape(shape), (count, *shape)),
            keys=members,
        )
    for derived, (values, sigma, _) in zip(problem.derived, block.columns.derived, strict=True):
        turned = wrapped(values) if derived.angle and not derived.shape else values
        yield DerivedValue(
            quantity=derived_quantity(problem, derived),
            value=turned.reshape(count, *derived.shape),
            sigma=sigma.reshape(count, *(derived.shape if derived.kind is None else (sigma.shape[1],))),
            keys=members,
        )


def filled(
    model: SolveReport, items: tuple[Estimate | DerivedValue, ...], problem: Problem, block: Block, place: int
) -> SolveReport:
    """The report of the clean solve at a ``place``: that of another one, the ``model``, with its own numbers.

    ``items`` are the estimates and derived quantities as families over the solves of the block.
    """
    columns, number = block.columns, block.which.start + place
    factor = columns.factor[place]
    noise = {each.name: float(columns.noise[place, i]) for i, each in enumerate(problem.blocks)}
    estimates = [item for item in items if isinstance(item, Estimate)]
    derived = [item for item in items if isinstance(item, DerivedValue)]
    singular = np.linalg.svd(columns.root[place] * columns.scale[place][:, None], compute_uv=False)
    images = [image[place] for _, _, image in columns.derived]
    chi2_p = float(columns.chi2_p[place])
    return replace(
        model,
        message=REASONS[columns.reason[place]].sentence,
        key=dict(zip(block.names, block.keys[number], strict=True)),
        iterations=int(columns.iterations[place]),
        evaluations=int(columns.evaluations[place]),
        seconds=float(columns.seconds[place]),
        cost=float(columns.cost[place]),
        robust_cost=None if model.robust_cost is None else float(columns.robust_cost[place]),
        dof=int(columns.dof[place]),
        sigma0=float(columns.sigma0[place]),
        chi2_p=None if np.isnan(chi2_p) else chi2_p,
        estimates=tuple(
            replace(each, value=each.value[place], sigma=_at(each.sigma, place), fixed=each.fixed[place], keys=None)
            for each in estimates
        ),
        derived=tuple(
            replace(each, value=each.value[place], sigma=_at(each.sigma, place), keys=None) for each in derived
        ),
        covariance=_with_matrix(model.covariance, factor),
        derived_covariance=_with_matrix(model.derived_covariance, np.vstack(images)) if images else None,
        observability=None
        if model.observability is None
        else replace(model.observability, condition=float(singular[0] / singular[-1])),
        noise={name: None if estimated is None else noise[name] for name, estimated in model.noise.items()},
        residual_summaries=dict(_summaries(model, problem, block, place)),
        priors=tuple(
            replace(prior, value=prior.mean + away, residual=away / prior.sigma)
            for prior, away in zip(model.priors, columns.priors[place].tolist(), strict=True)
        ),
        residual_rows=lambda: _rows(problem, block, number),
        plot_data=lambda: _pictures(problem, block, number),
    )


def _at(values: Floats | None, place: int) -> Floats | None:
    return None if values is None else np.asarray(values[place])


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
                outlier_places=() if found is None else file_rows(found.table, bad),
            ),
        )


def _rows(problem: Problem, block: Block, number: int) -> tuple[ResidualRow, ...]:
    solution = block.solution(number)
    return residual_rows(problem, solution) if isinstance(solution, Solution) else ()


def _pictures(problem: Problem, block: Block, number: int) -> tuple[PlotData, ...]:
    solution = block.solution(number)
    return plot_data(problem, solution) if isinstance(solution, Solution) else ()
