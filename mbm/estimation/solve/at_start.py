"""Where an equation has no finite value at the start, and why."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Indices, Minimum
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

OUT_OF_RANGE = (
    "the model must be above 0, of n trials below n: it is the expectation of a count, or decides the weights"
)


def start_faults(
    problem: Problem, tables: Mapping[str, Table], minimum: Minimum, equations: Assembled
) -> tuple[Diagnostic, ...]:
    """The equation that has no value, its place in the text, and its rows in the data."""
    if minimum.bad_row is None:
        return ()
    groups, bad = equations.groups, minimum.bad_row
    kept: Indices | None = equations.rows
    if bad >= equations.count:
        groups, bad, kept = equations.constraints, bad - equations.count, None
    elif kept is not None:
        bad = int(kept[bad])
    for group in groups:
        if group.first <= bad < group.first + group.count:
            line = (bad - group.first) // group.kernel.outputs
            name = problem.blocks[group.kernel.owner].table
            table = tables[name] if name is not None and group.positions is not None else None
            place = None if table is None or group.positions is None else table.place(int(group.positions[line]))
            if group.kernel.corrections is not None:
                return (faults.no_corrections_at_start(group.kernel.span, group.kernel.name, place),)
            lines = np.union1d(_lines(group, minimum, kept), [line])
            rows = [] if table is None or group.positions is None else table.rows[group.positions[lines]].tolist()
            reason = _reason(group, minimum, int(lines[0]))
            return (faults.not_finite_at_start(group.kernel.span, group.kernel.name, place, rows, reason),)
    return ()


def _lines(group: Group, minimum: Minimum, kept: Indices | None) -> Indices:
    """The lines of a group that have no finite value, of those with residuals at ``kept`` (None: all)."""
    values = group.values_at(minimum.point[None]).reshape(group.count)
    bad = np.flatnonzero(~np.isfinite(values))
    if kept is not None:
        bad = bad[np.isin(bad + group.first, kept)]
    return bad // group.kernel.outputs


def _reason(group: Group, minimum: Minimum, line: int) -> str | None:
    """What a call of the line's equation says about there being no value, or what its errors ask of the model."""
    if group.readings is not None and np.isfinite(group.written.values_at(minimum.point[None])[0, line]).all():
        return OUT_OF_RANGE
    if not group.kernel.calls:
        return None
    from mbm.kernels.backends.calling import reason_of

    stream = group.cache.stream(group.number, group.kernel)
    return reason_of(stream, group.inputs_at(minimum.point[None], slice(line, line + 1)))
