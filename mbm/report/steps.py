"""The steps of a sequence in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.problem.checks import used_rows
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem


def steps_text(problem: Problem, sequence: Sequence, tables: Mapping[str, Table]) -> str:
    """How many steps there are, from where to where, of which tables; and how many have no row that is observed."""
    steps = tables[sequence.steps].numbers(sequence.column)
    named = ", ".join(dict.fromkeys(table for table, _ in sequence.sources))
    ends = f" from {steps[0]:g} to {steps[-1]:g}" if len(steps) else ""
    told = f"{len(steps)} step{'' if len(steps) == 1 else 's'}{ends}: the values of {sequence.column} in {named}"
    predicted = len(steps) - len(_seen(problem, sequence, tables))
    return told + (f"; {predicted} without a row that is observed" if predicted else "")


def _seen(problem: Problem, sequence: Sequence, tables: Mapping[str, Table]) -> set[float]:
    """The steps that have rows of observations."""
    found: set[float] = set()
    for block in problem.blocks:
        if block.role is not BlockRole.OBSERVATION or block.table is None:
            continue
        table = tables[block.table]
        if sequence.column in table.columns:
            used = used_rows(block, tables)
            numbers = table.numbers(sequence.column)
            found.update(np.unique(numbers if used is None else numbers[used]).tolist())
    return found
