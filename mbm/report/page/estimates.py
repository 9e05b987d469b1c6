"""Budgets and correlations of one solve."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.text import HEADER, cells, chosen, heading, summary
from mbm.report.correlations import Correlation, correlation_of
from mbm.report.page.types import Block, Grid, Paragraph
from mbm.report.types import SolveReport
from mbm.text.types import MbmError

MOST_BUDGETS = 8
MOST_INPUTS = 20
LARGEST_MATRIX = 10
"""Numbers whose correlations are shown as a matrix; of more, the strongest pairs."""
STRONGEST = 20
LARGEST_SEARCHED = 400
"""Numbers among which the strongest correlations are looked for."""


def budget_blocks(solve: SolveReport, explained: str) -> Iterator[Block]:
    """The budgets of the derived quantities first, as they are what was asked for; or why there are none."""
    try:
        budgets = budgets_of(solve)
    except MbmError as error:
        yield Paragraph("There is no budget: " + "; ".join(each.message for each in error.diagnostics))
        return
    derived = {item.quantity.name for item in solve.derived}
    ordered = sorted(budgets, key=lambda each: each.quantity.partition("[")[0] not in derived)
    if ordered:
        yield Paragraph(explained)
    for budget in ordered[:MOST_BUDGETS]:
        yield Paragraph(f"{heading(budget)}. {summary(budget)}.")
        rows = chosen(budget.rows, MOST_INPUTS)
        left = len(budget.rows) - len(rows)
        yield Grid(
            titles=HEADER,
            rows=tuple(map(cells, rows)),
            texts=frozenset({0, 1, 5}),
            caption=f"{left:,} more inputs contribute less." if left else "",
        )
    if len(ordered) > MOST_BUDGETS:
        yield Paragraph(f"`mbm budget` has {len(ordered) - MOST_BUDGETS:,} more.")


def correlation_blocks(solve: SolveReport) -> Iterator[Block]:
    """The matrix, or the pairs that are correlated most."""
    found = correlation_of(solve)
    if found is None or len(found.names) < 2:
        return
    if found.matrix is None or len(found.names) > LARGEST_SEARCHED:
        yield Paragraph(f"The correlations of {len(found.names):,} numbers are left out for their size.")
    elif len(found.names) <= LARGEST_MATRIX:
        rows = tuple((name, *map(_number, line)) for name, line in zip(found.names, found.matrix.tolist(), strict=True))
        yield Grid(titles=("", *found.names), rows=rows)
    else:
        yield _pairs(found, found.matrix)


def _pairs(found: Correlation, matrix: np.ndarray) -> Grid:
    first, second = np.triu_indices(len(found.names), 1)
    sizes = np.nan_to_num(np.abs(matrix[first, second]), nan=-1.0)
    order = np.argsort(-sizes, kind="stable")[:STRONGEST]
    rows = tuple(
        (found.names[first[i]], found.names[second[i]], _number(float(matrix[first[i], second[i]])))
        for i in order.tolist()
        if sizes[i] >= 0.0
    )
    caption = f"The strongest of {len(sizes):,} correlations."
    return Grid(titles=("of", "with", "correlation"), rows=rows, texts=frozenset({0, 1}), caption=caption)


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"
