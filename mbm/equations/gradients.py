"""The gradient of the cost at many points, with one call of each kernel for all of them."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binding import INPUTS_AT_A_TIME, Group
from mbm.equations.types import Floats, Indices


def gradients_at(equations: Assembled, points: Floats) -> Floats:
    """Half the gradient of the cost (P, n), residualsᵀ Jacobian, at points (P, N)."""
    if equations.implicit is not None or equations.structure is not None:
        return np.stack([equations.residuals(point) @ equations.jacobian(point) for point in points])
    columns = np.full(len(equations.layout.number), -1, dtype=np.int64)
    columns[equations.free] = np.arange(equations.dimension)
    weights = _weights(equations, points)
    result = np.zeros((len(points), equations.dimension))
    for group in equations.groups:
        kernel = group.kernel
        width = len(kernel.variables) + len(kernel.parameters) + len(kernel.jacobian_rows)
        step = max(INPUTS_AT_A_TIME // max(group.rows * width, 1), 1)
        own = weights[:, group.first : group.first + group.count].reshape(len(points), group.rows, kernel.outputs)
        for first in range(0, len(points), step):
            some = slice(first, first + step)
            result[some] += _pulled_back(group, points[some], own[some], columns, equations.dimension)
    return result


def _weights(equations: Assembled, points: Floats) -> Floats:
    """What the plain residuals' derivatives are weighted with (P, all residuals): ρ'(s) r, 0 for rows not picked.

    ``r`` are residuals with their noise factors, which the derivatives lack, so that they divide once more.
    """
    plain = equations.plain_residuals_at(points)
    weighted = plain.copy()
    if equations.lossy:
        for loss, lines in loss_lines(equations):
            part = plain[:, lines]
            weighted[:, lines] = part * loss.weight(np.square(part).sum(axis=2))[:, :, None]
    if equations.rows is not None:
        whole = np.zeros((len(points), equations.whole))
        whole[:, equations.rows] = weighted
        weighted = whole
    return weighted if equations.factors is None else weighted / equations.factors


def _pulled_back(group: Group, points: Floats, weights: Floats, columns: Indices, width: int) -> Floats:
    """The sum over a group's rows of weights (P, rows, outputs) times the whitened Jacobian: (P, ``width``)."""
    kernel, count = group.kernel, len(points)
    outer = np.concatenate([whitener.transposed(weights) for whitener in group.whiteners], axis=-1)
    inputs = group.inputs_at(points, slice(group.rows))
    _, nonzeros = group.cache.stream(group.number, kernel).values_and_jacobian(inputs)
    parts = nonzeros.reshape(count, group.rows, len(kernel.jacobian_rows)) * outer[:, :, kernel.jacobian_rows]
    places = columns[group.columns[:, kernel.jacobian_columns]]
    lines = np.arange(count)[:, None, None] * width + places
    moved = np.broadcast_to(places >= 0, parts.shape)
    sums = np.bincount(lines[moved], weights=parts[moved], minlength=count * width)
    return np.asarray(sums, dtype=np.float64).reshape(count, width)
