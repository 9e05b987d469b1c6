"""One set of equations solved again and again, with other parameters and other fixed numbers, from where it was solved.

No closed form challenges these solves, and none is judged by its fit: they follow the minimum that they begin beside.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.stream import threads
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native.system import NativeSystem, system_of
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.solver import description as of
from mbm.text.types import MbmError
from mbm.values import dataclass

ROOM = 20_000_000
"""Numbers that the answers of the solves made in one call may take: 160 MB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialSolver:
    """Solves ``equations``; ``system`` is their native form (None: they are solved one by one, which takes long)."""

    equations: Assembled
    settings: Settings
    system: NativeSystem | None
    parameters: Floats
    """Those of all groups, one after the other, each row by row (P,)."""

    def solved(self, points: Floats, parameters: Floats, workers: int | None) -> tuple[Floats, Mask]:
        """Where the solves from points (T, N) with parameters (T, P) end (T, N), and which converged (T,).

        ``workers`` threads share them (None: one a processor); the ends do not depend on their number.
        """
        if not self.equations.dimension:
            return points, np.ones(len(points), dtype=bool)
        if self.system is None:
            return self._one_by_one(points, parameters)
        n = self.equations.dimension
        each = 2 * (n + 1) ** 2 + points.shape[1] + of.RESULTS + of.STATES
        step = max(ROOM // each, 1)
        ends, converged = np.empty_like(points), np.empty(len(points), dtype=bool)
        for first in range(0, len(points), step):
            part = slice(first, min(first + step, len(points)))
            ends[part], converged[part] = _natively(self.system, points[part], parameters[part], workers)
        return ends, converged

    def _one_by_one(self, points: Floats, parameters: Floats) -> tuple[Floats, Mask]:
        """The same by the general path."""
        ends, converged = points.copy(), np.zeros(len(points), dtype=bool)
        for k, (point, own) in enumerate(zip(points, parameters, strict=True)):
            if self.settings.stopped():
                break
            try:
                found = minimise(_with_parameters(self.equations, own), point, self.settings)
            except MbmError:
                continue
            ends[k], converged[k] = found.point, found.reason.converged and found.feasible
        return ends, converged


def trial_solver(equations: Assembled, settings: Settings) -> TrialSolver:
    """The solver of some equations, ready for many trials."""
    rule = settings.method if settings.iterative else Method.AUTO
    own = replace(settings, method=rule, routine=None, starts=None, robust=None, forms=tuple)
    groups = (*equations.groups, *equations.constraints)
    parameters = np.concatenate([np.zeros(0), *(group.parameters.ravel() for group in groups)])
    system = system_of(equations, own, often=True) if equations.dimension else None
    return TrialSolver(equations=equations, settings=own, system=system, parameters=parameters)


def _natively(system: NativeSystem, points: Floats, parameters: Floats, workers: int | None) -> tuple[Floats, Mask]:
    """The solves of one call."""
    count, size = parameters.shape
    data = np.tile(system.rows.data, (count, 1))
    firsts = slice(of.DATA_HEAD + of.DataBlock.parameters, None, of.DATA_BLOCK)
    data[:, firsts] += size * np.arange(count)[:, None]
    mine = replace(system, rows=replace(system.rows, parameters=parameters.reshape(-1), data=data))
    ends = mine.solve(points, np.arange(count), workers=threads(workers, count))
    return ends.numbers, ends.clean


def _with_parameters(equations: Assembled, parameters: Floats) -> Assembled:
    """The equations with other parameters (P,)."""
    place = 0

    def taken(shape: tuple[int, ...]) -> Floats:
        nonlocal place
        place, first = place + int(np.prod(shape)), place
        return parameters[first:place].reshape(shape)

    groups = tuple(replace(group, parameters=taken(group.parameters.shape)) for group in equations.groups)
    constraints = tuple(replace(group, parameters=taken(group.parameters.shape)) for group in equations.constraints)
    return replace(equations, groups=groups, constraints=constraints)
