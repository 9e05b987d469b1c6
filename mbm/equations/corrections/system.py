"""A set of components of one size: rows of equations that share no measured value with others, all solved together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.corrections.types import Local
from mbm.equations.types import Floats, Indices, Mask
from mbm.kernels.types import Evaluation, Stream
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class OwnInputs:
    """A kernel (protocol `Evaluation`) at the rows of ``inputs`` (rows, variables + parameters)."""

    stream: Stream
    inputs: Floats

    def values(self) -> Floats:
        """The outputs (rows, outputs)."""
        return self.stream.values(self.inputs)

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        return self.stream.values_and_jacobian(self.inputs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """Some rows of one group in a system.

    ``group`` holds those rows alone, ``evaluation`` the derivatives by their measured values; ``sigma`` (rows, c) is
    that of each value (0: exact) and ``ids`` (rows, c) its number. ``residuals`` (rows, outputs) places each output in
    the vector of all residuals, ``equations`` among the R·k equations of the system, ``places`` (rows, c) each value
    among its R·q corrections, -1 where it is exact. ``alone``: the rows are the components, in order, and every value
    has a place. ``columns`` (c,) are the corrected inputs among the kernel's parameters, ``measured`` (rows, c) their
    cells. ``slope_scale`` and ``curvature_scale`` (rows, nonzeros) bring derivatives to standard deviations.
    """

    group: Group
    evaluation: Evaluation
    columns: Indices
    measured: Floats
    slope_scale: Floats
    curvature_scale: Floats
    sigma: Floats
    ids: Indices
    residuals: Indices
    equations: Indices
    places: Indices
    alone: bool

    def corrected(self, corrections: Floats) -> Floats:
        """The measured values (rows, c) with corrections (R, q), which are in standard deviations."""
        if self.alone:
            return np.asarray(self.measured + self.sigma * corrections)
        change = np.where(self.places >= 0, corrections.ravel()[self.places], 0.0)
        return np.asarray(self.measured + self.sigma * change)

    def some(self, rows: Indices, components: Indices, k: int, q: int) -> Part:
        """Some rows, or rows repeated, in these ``components`` of k equations and q corrections, with inputs as now.

        Its group can only be whitened.
        """
        group, own, places = self.group, components[:, None], self.places[rows]
        if group.kernel.corrections is None:
            raise TypeError(group.kernel.name)
        stream = group.cache.stream(-1 - group.number, group.kernel.corrections.kernel)
        return replace(
            self,
            group=replace(
                group,
                index=group.index[rows],
                parameters=group.parameters[rows],
                whiteners=tuple(each.some(rows) for each in group.whiteners),
            ),
            evaluation=OwnInputs(stream, self.evaluation.inputs[rows]),
            measured=self.measured[rows],
            slope_scale=self.slope_scale[rows],
            curvature_scale=self.curvature_scale[rows],
            sigma=self.sigma[rows],
            ids=self.ids[rows],
            residuals=self.residuals[rows],
            equations=own * k + self.equations[rows] % k,
            places=np.where(places >= 0, own * q + places % q, -1),
        )

    def at(self, corrections: Floats) -> Group:
        """The group with its measured values corrected."""
        parameters = self.group.parameters.copy()
        parameters[:, self.columns] = self.corrected(corrections)
        return replace(self.group, parameters=parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """R components of k equations in q corrections each (protocol ``Conditions`` once the unknowns are put in).

    All have rows of the same groups. ``residuals`` (R, k) places the equations in the vector of all residuals;
    ``touched`` are the most coordinates that one component touches.
    """

    parts: tuple[Part, ...]
    noisy: Mask
    corrections: int
    residuals: Indices
    touched: int

    def at_numbers(self, numbers: Floats) -> Conditions:
        """The conditions on the corrections where all unknowns are ``numbers`` (N,)."""
        for part in self.parts:
            group, inputs = part.group, part.evaluation.inputs
            variables = group.index.shape[1]
            inputs[:, :variables] = numbers[group.places]
            inputs[:, variables : variables + group.parameters.shape[1]] = group.parameters
        return Conditions(self)

    def at_points(self, points: Floats) -> Conditions:
        """The conditions at points (P, N), those of a point together: P·R components."""
        count = len(self.noisy)
        several = self.some(np.tile(np.arange(count), len(points)))
        for part in several.parts:
            group, inputs = part.group, part.evaluation.inputs
            variables = group.index.shape[1]
            owner = part.equations[:, :1] // (self.noisy.shape[1] * count)
            inputs[:, :variables] = points[owner, group.index]
            inputs[:, variables : variables + group.parameters.shape[1]] = group.parameters
        return Conditions(several)

    def some(self, components: Indices) -> System:
        """Some of the components, or components repeated, with inputs as they are now."""
        (count, k), q = self.noisy.shape, self.corrections
        parts = []
        for part in self.parts:
            owner = part.equations[:, 0] // k
            order, sizes = np.argsort(owner, kind="stable"), np.bincount(owner, minlength=count)
            taken = sizes[components]
            first = np.repeat((np.cumsum(sizes) - sizes)[components] - (np.cumsum(taken) - taken), taken)
            rows = order[first + np.arange(len(first))]
            parts.append(part.some(rows, np.repeat(np.arange(len(components)), taken), k, q))
        return replace(self, parts=tuple(parts), noisy=self.noisy[components], residuals=self.residuals[components])

    def scaled(self, corrections: Floats, target: Floats) -> None:
        """Enter the corrections (R, q) into those of all measured values (P,), in their own units."""
        for part in self.parts:
            there = part.places >= 0
            target[part.ids[there]] = part.sigma[there] * corrections.ravel()[part.places[there]]


@dataclass(frozen=True, slots=True, eq=False)
class Conditions:
    """The conditions of a system whose evaluations hold the unknowns."""

    system: System

    @property
    def noisy(self) -> Mask:
        """Which equations have noise of their own (R, k)."""
        return self.system.noisy

    @property
    def corrections(self) -> int:
        """Corrections of one component, q."""
        return self.system.corrections

    def some(self, components: Indices) -> Conditions:
        """Those of some components."""
        return Conditions(self.system.some(components))

    def at(self, corrections: Floats, multipliers: Floats) -> Local:
        """The conditions at ``corrections`` (R, q), whitened with the equations' own noise."""
        system = self.system
        if len(system.parts) == 1 and system.parts[0].alone:
            return _rows_at(system.parts[0], corrections, multipliers)
        (count, k), q = system.noisy.shape, system.corrections
        values = np.zeros(count * k)
        slopes = np.zeros(count * k * q)
        curvature = np.zeros(count * q * q)
        for part in system.parts:
            local = _rows_at(part, corrections, multipliers.ravel()[part.equations])
            values[part.equations] = local.values
            column = part.places % q
            held = part.places >= 0
            lines = part.equations[:, :, None] * q + column[:, None, :]
            kept = np.broadcast_to(held[:, None, :], lines.shape)
            np.add.at(slopes, lines[kept], local.slopes[kept])
            pairs = part.places[:, :, None] * q + column[:, None, :]
            kept = held[:, :, None] & held[:, None, :]
            np.add.at(curvature, pairs[kept], local.curvature[kept])
        return Local(
            values=values.reshape(count, k),
            slopes=slopes.reshape(count, k, q),
            curvature=curvature.reshape(count, q, q),
        )


def _rows_at(part: Part, corrections: Floats, multipliers: Floats) -> Local:
    """The rows of a part: values (rows, outputs), slopes (rows, outputs, c), curvature (rows, c, c), by deviations."""
    group, inputs = part.group, part.evaluation.inputs
    found = group.kernel.corrections
    if found is None:
        raise TypeError(group.kernel.name)
    variables = group.index.shape[1]
    inputs[:, variables + part.columns] = part.corrected(corrections)
    inputs[:, variables + group.parameters.shape[1] :] = _unwhitened(group, multipliers)
    values, nonzeros = part.evaluation.values_and_jacobian()
    rows, outputs = values.shape
    slopes = np.zeros((rows, outputs, len(found.columns)))
    count = len(found.slope_rows)
    slopes[:, found.slope_rows, found.slope_columns] = nonzeros[:, :count] * part.slope_scale
    group.whiten_rows(slopes)
    curvature = np.zeros((rows, len(found.columns), len(found.columns)))
    if len(found.curvature_rows):
        bent = nonzeros[:, count:] * part.curvature_scale
        finite = np.isfinite(bent)
        if not finite.all():
            bent[~finite.all(axis=1)] = 0.0
        curvature[:, found.curvature_rows, found.curvature_columns] = bent
    return Local(values=group.whitened(values), slopes=slopes, curvature=curvature)


def _unwhitened(group: Group, multipliers: Floats) -> Floats:
    """Multipliers of the outputs as they are, from those of the whitened outputs (rows, outputs)."""
    result = np.empty_like(multipliers)
    for whitener in group.whiteners:
        part = multipliers[:, whitener.first : whitener.last]
        if whitener.weights.ndim == 2:
            result[:, whitener.first : whitener.last] = part * whitener.weights
        else:
            result[:, whitener.first : whitener.last] = np.einsum("rij,ri->rj", whitener.weights, part)
    return result
