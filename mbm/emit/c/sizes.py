"""How much memory the parts of a solve take."""

from __future__ import annotations

from mbm.emit.routines.noises import FOUND
from mbm.emit.routines.sandwich import SUMS
from mbm.emit.system import StaticSystem
from mbm.emit.types import Blueprint
from mbm.solver import description as at


def row_scratch(blueprint: Blueprint) -> tuple[int, int]:
    """Reals that a row wants: those that do not depend on n, and those for each of n."""
    plain = lines = 0
    for _, case in blueprint.cases:
        outputs = case.kernel.outputs
        own = len(case.variables) + len(case.parameters) + 2 * outputs + len(case.kernel.jacobian_rows)
        plain, lines = max(plain, own), max(lines, 2 * outputs)
    return plain, lines


def lossy(blueprint: Blueprint) -> bool:
    """Whether some clause has a loss."""
    return any(block.loss is not None for block in blueprint.blocks)


def spare_size(blueprint: Blueprint, static: StaticSystem) -> str:
    """Reals of scratch besides the solver's, as C text with ``n``."""
    plain, lines = row_scratch(blueprint)
    matrices = f"4 * n * n + {SUMS} + n + " if lossy(blueprint) else ""
    vectors = 2 if static.told else 0
    return f"{matrices}{FOUND + plain} + {lines + vectors} * n"


def outputs_capacity(blueprint: Blueprint, static: StaticSystem) -> int:
    """Numbers that the kernels put out at a time, at most."""
    chunk = static.prefix[at.Problem.chunk]
    return max(chunk // c.kernel.outputs * (c.kernel.outputs + len(c.kernel.jacobian_rows)) for _, c in blueprint.cases)
