"""Whether the Jacobians that a problem gives for its functions in Python are those of the values, at the start."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.selection import selections
from mbm.equations.types import Floats
from mbm.estimation.search.starting import beginnings
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.kernels.backends.calling import CallingStream
from mbm.kernels.faults import is_failed_call
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.text.types import Diagnostic, MbmError

MOST_ROWS = 8
"""Rows of a group that are looked at: a wrong formula is wrong in most of them."""


def jacobian_doubts(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> tuple[Diagnostic, ...]:
    """A warning for each Jacobian that differences of the values contradict, in the first of all solves.

    Nothing where the equations cannot be set up, or have no start yet: the solve says why.

    Raises:
        MbmError: a function fails.
    """
    problem = found.problem
    starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    try:
        _, picked = selections(problem, found.tables)
        equations, _ = assemble(problem, kernels, next(iter(picked)).tables, starts, cache)
        start = beginnings(equations, settings_of(problem.request))[0].point
    except (StopIteration, IndexError):
        return ()
    except MbmError as error:
        if is_failed_call(error):
            raise
        return ()
    doubts: dict[str, Diagnostic] = {}
    for group in (*equations.groups, *equations.constraints):
        for doubt in _doubts(group, start):
            doubts.setdefault(doubt.message.partition(" ")[0], doubt)
    return tuple(doubts.values())


def _doubts(group: Group, start: Floats) -> list[Diagnostic]:
    stream = group.cache.stream(group.number, group.kernel)
    if not isinstance(stream, CallingStream) or not group.rows:
        return []
    inputs = group.inputs_at(start[None], slice(0, group.rows, max(1, group.rows // MOST_ROWS)))
    return stream.doubts(inputs[:MOST_ROWS])
