"""Equations that hold nothing measured, and that a clause states again for every further row of the same keys."""

from __future__ import annotations

from functools import partial

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.solves import Lines
from mbm.equations.types import Indices
from mbm.estimation.trust.faults import REPEATED_EQUATIONS
from mbm.estimation.trust.fits import Fits, Said
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic, Severity, Span


def repeated_equations(fits: Fits) -> Said:
    """Clauses over a table whose rows are fewer different equations, by no more than which unknowns they take.

    Not those whose rows weigh differently, and not those with one unknown alone: such rows are readings, of nothing.
    """
    blank = [each for each in fits.solves.lines if _nothing_measured(fits.problem, each.group)]
    for owner in sorted({each.group.kernel.owner for each in blank}):
        mine = [each for each in blank if each.group.kernel.owner == owner]
        rows = np.bincount(np.concatenate([each.solve for each in mine]), minlength=fits.solves.count)
        different = np.bincount(np.concatenate([_different(each) for each in mine]), minlength=fits.solves.count)
        block = fits.problem.blocks[owner]
        for place in np.flatnonzero((different < rows) & (different > 1)).tolist():
            yield place, partial(_said, block.span, block.name, int(rows[place]), int(different[place]))


def _nothing_measured(problem: Problem, group: Group) -> bool:
    block = problem.blocks[group.kernel.owner]
    plain = block.table is not None and not block.errors and group.gathered is None and not group.sampled
    alike = not group.losses and all(bool((each.weights == each.weights[:1]).all()) for each in group.whiteners)
    return plain and alike and problem.sequence is None and not group.parameters.shape[1] and group.rows > 1


def _different(lines: Lines) -> Indices:
    """The solve of each different equation among the rows."""
    return np.asarray(np.unique(np.column_stack([lines.solve, lines.group.index[lines.place]]), axis=0)[:, 0])


def _said(span: Span, name: str, rows: int, different: int) -> Diagnostic:
    return Diagnostic(
        code=REPEATED_EQUATIONS,
        message=f"the {rows} rows of `{name}` are {different} different equations, which hold nothing measured: each "
        "is counted once for every row, as if it had been found anew",
        place=span,
        hint=REPEATED_EQUATIONS.mend,
        severity=Severity.WARNING,
    )
