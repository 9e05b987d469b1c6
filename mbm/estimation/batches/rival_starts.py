"""Streams against closed forms: data sets of which one may cost less than what the start has led to."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.forms import of_all, precisions
from mbm.estimation.batches.stream_ends import StreamEnds
from mbm.estimation.batches.types import Which
from mbm.estimation.consensus.recognised import Recognised, recognised
from mbm.estimation.minimise.native.system import NativeSystem, system_of
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.solver import description as of
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _DataSets:
    """Some data sets of a room, as a closed form looks at them."""

    equations: Assembled
    system: NativeSystem
    numbers: Indices

    def units_of(self, which: Which) -> tuple[Indices, Indices]:
        """Solve and number of the units of some of them."""
        units = sum(group.rows * len(group.whiteners) for group in self.equations.groups)
        own = np.arange(units)
        return np.repeat(np.arange(len(which)), units), (np.asarray(which)[:, None] * units + own).ravel()

    def costs(self, which: Which, points: Floats) -> Floats:
        """Σ r² at points."""
        ends = self.system.solve(points, self.numbers[which])
        finite = ends.states[:, of.REASON] != of.NOT_FINITE_AT_START
        return np.where(finite, ends.results[:, of.COST], np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rivals:
    """The closed form for the data sets of a stream; ``costs`` is their system without a step."""

    form: Recognised
    costs: NativeSystem = field(repr=False)

    def lower(self, found: StreamEnds, parameters: Floats, system: NativeSystem) -> tuple[Indices, Floats]:
        """Data sets (K,) whose closed form costs less than what was found, and its points (K, N).

        Where what was found does not fit as stated noise lets expect, the closed form may cost anything.
        """
        which = np.flatnonzero(found.clean | found.strained)
        equations = self.form.first
        if not len(which):
            return which, np.empty((0, found.numbers.shape[1]))
        told = self.form.form.of_parameters(equations, parameters[which])
        sets = _DataSets(equations=equations, system=replace(self.costs, rows=system.rows), numbers=which)
        formed = of_all(self.form, sets, told, np.tile(precisions(equations), len(which)))
        points, least = formed.best(np.arange(len(which)))
        below = (least < found.cost[which]) | (found.strained[which] & np.isfinite(least))
        return which[below], points[below]


def form_of_stream(equations: Assembled, settings: Settings) -> Recognised | None:
    """The closed form that gives all numbers of a data set, where it follows from the data by a simple rule."""
    if equations.linear or equations.constraints or equations.implicit is not None or equations.count > ENOUGH:
        return None
    if any(entry.keys is not None for entry in equations.layout.entries):
        return None
    form = recognised(equations, settings)
    return None if form is None or form.form.form.curved else form


def without_a_step(form: Recognised, settings: Settings) -> NativeSystem | None:
    """The system of a data set, which tells what points cost."""
    return system_of(form.first, replace(settings, max_iterations=0), direct=False, often=True)
