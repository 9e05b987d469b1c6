"""The problem of one step, or of one transition, with the rows of all of them as data sets of native code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache, affine
from mbm.equations.types import Indices
from mbm.estimation.batches.arranged import arranged
from mbm.estimation.batches.descent import data_sets
from mbm.estimation.batches.sets import sets_of
from mbm.estimation.batches.stack import Stack, stack
from mbm.estimation.minimise.native.packing import Iteration, rows_of, system_arrays, triangle_kind
from mbm.estimation.minimise.native.system import NativeSystem, kernels_of, nothing
from mbm.estimation.native.code import native_code
from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """A local problem: its equations over the rows of all steps, and these as data sets in the order of ``keys``."""

    problem: Problem
    stack: Stack
    native: NativeSystem
    keys: tuple[CellKey, ...]

    @property
    def equations(self) -> Assembled:
        """The equations of all steps."""
        return self.stack.equations

    @property
    def linear(self) -> bool:
        """Whether residuals and constraints are affine in all that is free."""
        equations = self.equations
        free = np.zeros(len(equations.layout.number), dtype=bool)
        free[equations.free] = True
        limits = all(affine(group, free) for group in equations.constraints)
        return limits and not equations.lossy and all(affine(group, free) for group in equations.groups)


def local(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    cache: EvaluationCache,
    *,
    free: Indices | None = None,
    always: frozenset[int] = frozenset(),
) -> Local:
    """The local problem, whose request divides the rows by one column, its steps in ascending order.

    ``free`` are its free coordinates (None: those that its equations say). Rows of tables without the column, and
    of no table, belong to the first step, but for the blocks ``always``.

    Raises:
        MbmError: something that is stated is at fault in some step.

    """
    sets = sets_of(problem, tables)
    if sets is None:
        raise TypeError(problem.name)
    keys = [cells[0] for cells in sets.keys]
    sets = sets.some(np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.int64))
    own = arranged(problem, sets)
    bound = stack(problem, kernels, sets.count, own, cache.layouts.of(problem, own.tables, {}), cache)
    groups = (*bound.equations.groups, *bound.equations.constraints)
    for number, group in enumerate(groups):
        table = problem.blocks[group.kernel.owner].table
        if table not in own.spans and group.kernel.owner not in always:
            bound.rows[number, 1:] = 0
    if free is not None:
        bound = replace(bound, equations=bound.equations.freed(free, bound.equations.numbers))
    return Local(problem=problem, stack=bound, native=_system(bound), keys=tuple(cells[0] for cells in sets.keys))


def suits(equations: Assembled) -> bool:
    """Whether a filter takes the rows: whole units, whitened by triangles, nothing sampled or eliminated."""
    groups = (*equations.groups, *equations.constraints)
    if equations.implicit is not None or equations.rows is not None or any(group.sampled for group in groups):
        return False
    return all(triangle_kind(w) is not None for group in groups for w in group.whiteners)


def _system(bound: Stack) -> NativeSystem:
    """The rows of all steps, a data set for each."""
    equations = bound.equations
    groups = (*equations.groups, *equations.constraints)
    code = native_code(groups[0].cache)
    kernels = kernels_of(code, groups, compiled=equations.machine_code is not None)
    guard = getattr(kernels, "guard", None)
    addresses = [(kernels.values_address(k), kernels.jacobian_address(k), 0) for k in range(len(groups))]
    most = [int(rows.max(initial=0)) for rows in bound.rows]
    system, constants = system_arrays(equations, addresses, Iteration(most=0, tolerance=0.0), most_rows=most)
    rows = rows_of(equations)
    return NativeSystem(
        system=system,
        constants=constants,
        rows=replace(rows, data=data_sets(bound, system, rows)),
        code=code.filters,
        held=(kernels, code),
        failed=nothing if guard is None else guard.raise_failure,
    )
