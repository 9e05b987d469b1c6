"""The equations of one step, or of one transition, with the rows of all of them as data sets of native code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache, Group, affine
from mbm.equations.types import Indices
from mbm.estimation.batches.descent import data_sets
from mbm.estimation.minimise.native.iteration import Iteration
from mbm.estimation.minimise.native.packing import rows_of, system_arrays
from mbm.estimation.minimise.native.system import NativeSystem, kernels_of, nothing
from mbm.estimation.native.code import NativeCode, native_code
from mbm.values import dataclass

WORTH_MACHINE_CODE = 2000
"""Calls of kernels from which machine code is made for them, whatever evaluates them elsewhere: one call of NumPy's
takes as long as a thousand of these, and making a kernel as long as some hundred of NumPy's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """Equations over the numbers of one step or transition, with rows of all.

    ``first`` and ``counts`` (groups, T): in each group, where the rows of a data set begin, and how many there are.
    """

    equations: Assembled
    native: NativeSystem
    first: Indices
    counts: Indices

    @property
    def steps(self) -> int:
        """T."""
        return int(self.counts.shape[1])

    @property
    def residuals(self) -> Indices:
        """Scalar residuals of each data set (T,)."""
        return np.asarray(_outputs(self.equations.groups) @ self.counts[: len(self.equations.groups)])

    @property
    def equalities(self) -> int:
        """Scalar equality constraints of all data sets."""
        found, done = 0, 0
        for group, rows in zip(self.equations.constraints, self.counts[len(self.equations.groups) :], strict=True):
            equal = self.equations.equality[done : done + group.kernel.outputs]
            found += int(equal.sum()) * int(rows.sum())
            done += group.count
        return found

    @property
    def limits(self) -> int:
        """Most scalar constraints in a group of a data set, at least 1."""
        rows = self.counts[len(self.equations.groups) :].max(axis=1, initial=0)
        return max(1, int((_outputs(self.equations.constraints) * rows).max(initial=1)))

    @property
    def most_constraints(self) -> int:
        """Most scalar constraints of a data set."""
        own = self.counts[len(self.equations.groups) :]
        return int((_outputs(self.equations.constraints) @ own).max(initial=0))

    @property
    def linear(self) -> bool:
        """Whether residuals and constraints are affine in all that is free."""
        equations = self.equations
        free = equations.is_free
        groups = (*equations.groups, *equations.constraints)
        return not equations.lossy and all(affine(group, free) for group in groups)


def local(equations: Assembled, first: Indices, counts: Indices, cache: EvaluationCache, *, calls: int) -> Local:
    """The equations, of which there may be none, with their data sets; rows of a group stand data set by data set.

    ``calls`` of kernels are to come.
    """
    groups = (*equations.groups, *equations.constraints)
    code = native_code(cache)
    kernels = kernels_of(
        code, groups, compiled=equations.machine_code is not None or _worth_compiling(groups, calls, code)
    )
    guard = getattr(kernels, "guard", None)
    addresses = [(kernels.values_address(k), kernels.jacobian_address(k), 0) for k in range(len(groups))]
    most = [int(each.max(initial=0)) for each in counts]
    system, constants = system_arrays(equations, addresses, Iteration(most=0, tolerance=0.0), most_rows=most)
    rows = rows_of(equations)
    return Local(
        equations=equations,
        native=NativeSystem(
            system=system,
            constants=constants,
            rows=replace(rows, data=data_sets(first, counts, system, rows)),
            code=code.filters,
            held=(kernels, code),
            failed=nothing if guard is None else guard.raise_failure,
        ),
        first=first,
        counts=counts,
    )


def _worth_compiling(groups: tuple[Group, ...], calls: int, code: NativeCode) -> bool:
    """Whether so many calls of kernels pay for machine code, where it can be made."""
    from mbm.kernels.native.engine import hindrance

    plain = not any(group.kernel.calls for group in groups)
    return plain and calls >= WORTH_MACHINE_CODE and hindrance(code.store) is None


def _outputs(groups: tuple[Group, ...]) -> Indices:
    return np.array([group.kernel.outputs for group in groups], dtype=np.int64)
