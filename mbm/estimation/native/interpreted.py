"""The solver's text run as Python, where no machine code can be made."""

from __future__ import annotations

from functools import cache
from types import CodeType

from mbm.machine.interpreted import Interpreted, code_of
from mbm.machine.kinds import LANES
from mbm.solver.modules import consensus_module, filters_module, solver_module


class InterpretedCode(Interpreted):
    """What `native.code.SolverCode` is, without machine code."""

    fast = True
    """Nothing faster is to come."""

    def __init__(self, name: str = "solver") -> None:
        """The module of that name."""
        super().__init__(_code(name))

    def expect(self, products: float) -> None:
        """There is nothing to choose from."""


@cache
def _code(name: str) -> CodeType:
    """The text of a module, compiled once for a process."""
    return code_of({"solver": solver_module, "consensus": consensus_module, "filters": filters_module}[name](LANES))
