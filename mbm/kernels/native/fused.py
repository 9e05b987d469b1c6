"""Rows that are fused in one straight line, as machine code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, kept, vector_library
from mbm.machine.merged import reduced
from mbm.machine.program import Program
from mbm.machine.straight_line import function
from mbm.machine.vector_text import Text

if TYPE_CHECKING:
    from mbm.kernels.store import Store

LEVEL = 2
"""Of optimisation: the first that puts operations side by side into vectors."""


def united_code(program: Program, numbers: int, residuals: int, store: Store | None) -> Library:
    """The functions ``values`` and ``jacobian`` of what `mbm.machine.merged.fused` gives, see `straight_line`.

    Args:
        program: its last column of ``residuals`` outputs are the values.
        numbers: how many of its inputs are those of a point.
        residuals: outputs in a column.
        store: where machine code is kept; None: nowhere.
    """
    text = Text(vector_library())
    function("jacobian", program, numbers, residuals, text)
    function("values", reduced(program, program.outputs[-residuals:]), numbers, residuals, text)
    whole = text.module()
    return kept(whole, lambda: whole, store, LEVEL, loops=False)
