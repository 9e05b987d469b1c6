"""What a simulation must not break: drawn columns still state their noise, true values meet what is demanded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mbm.equations.corrections.measured import refuse_bad_sigma
from mbm.equations.layout import Layout
from mbm.equations.types import Mask
from mbm.equations.whitening import whitener
from mbm.expression.evaluate import Calls, evaluate
from mbm.expression.nodes import Column, Expression, leaves
from mbm.problem.checks import used_rows
from mbm.problem.kinds import Relation
from mbm.problem.rows import row_values, rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Problem
from mbm.simulation import faults
from mbm.simulation.rows import Rows
from mbm.text.types import MbmError

TOLERANCE = 1e-6
"""Violation, relative to the largest number in play, that rounding of typed values explains."""


def refuse_lost_noise(
    problem: Problem, tables: Mapping[str, Table], masks: Mapping[int, Mask | None], drawn: Iterable[tuple[str, str]]
) -> None:
    """Refuse ``tables`` with simulated columns where a standard deviation or covariance read from them is none.

    ``drawn`` are those columns, by table; ``masks`` (rows,) the rows in use of each block, None: all.

    Raises:
        MbmError: `not-simulated`.

    """
    columns = frozenset(drawn)
    for number, block in enumerate(problem.blocks):
        if block.role is BlockRole.OBSERVATION and block.table is not None:
            try:
                _read_again(block, tables, masks[number], columns)
            except MbmError as error:
                raise MbmError(*(faults.noise_lost(block.name, each) for each in error.diagnostics)) from None


def _read_again(
    block: Block, tables: Mapping[str, Table], mask: Mask | None, drawn: frozenset[tuple[str, str]]
) -> None:
    """What reading the data finds wrong with the noise of a block, where it is stated by columns that were ``drawn``.

    Raises:
        MbmError: `bad-noise`.

    """
    table = tables[block.table or ""]
    used = np.arange(len(table)) if mask is None else np.flatnonzero(mask)
    for error in block.errors:
        stated = error.sigma
        if stated is not None and _reads(tuple(v for case in stated.cases for v in case.values), drawn):
            sigma = row_values(stated, tables)[:, 0]
            refuse_bad_sigma(error, stated, sigma[used], table, used)
    for case in block.cases:
        positions = rows_of(case.static, table)
        positions = positions if mask is None else positions[mask[positions]]
        for equation in case.equations:
            if len(positions) and _reads(equation.noise, drawn):
                whitener(equation, 0, table, positions, tables, may_be_exact=bool(block.errors))


def _reads(nodes: tuple[Expression, ...], drawn: frozenset[tuple[str, str]]) -> bool:
    return any(isinstance(leaf, Column) and (leaf.table, leaf.name) in drawn for leaf in leaves(nodes))


@np.errstate(all="ignore")
def violated(problem: Problem, tables: Mapping[str, Table], places: Layout, calls: Calls | None) -> tuple[Block, ...]:
    """The constraints that the values in ``places.start`` do not meet; ``calls`` calls functions in Python."""
    limit = TOLERANCE * max(1.0, float(np.abs(places.start).max(initial=0.0)))
    demands = (block for block in problem.blocks if block.role is BlockRole.CONSTRAINT)
    return tuple(block for block in demands if _worst(block, tables, places, calls) > limit)


def _worst(block: Block, tables: Mapping[str, Table], places: Layout, calls: Calls | None) -> float:
    """The largest violation of a constraint in any of its rows; infinite where it has no value."""
    table = tables[block.table] if block.table is not None else None
    mask = used_rows(block, tables)
    worst = 0.0
    for case in block.cases:
        positions = None
        if table is not None:
            positions = rows_of(case.static, table)
            positions = positions if mask is None else positions[mask[positions]]
            if not len(positions):
                continue
        rows = Rows(table=table, positions=positions, tables=tables, layout=places, numbers=places.start)
        for equation in case.equations:
            for value in evaluate(equation.components, rows.lookup({}), calls):
                above = np.abs(value) if equation.relation is Relation.ZERO else np.asarray(value)
                worst = max(worst, float(np.where(np.isnan(above), np.inf, above).max()))
    return worst
