"""The solver's text run as Python, where no machine code can be made: slow, complete, the same answers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import CodeType
from typing import Any

import numpy as np

from mbm.machine import python
from mbm.machine.kinds import LANES
from mbm.machine.words import call_fused, call_kernel, call_normal
from mbm.solver.modules import consensus_module, solver_module


class InterpretedCode:
    """What `native.code.SolverCode` is, without machine code."""

    fast = True
    """Nothing faster is to come."""

    def __init__(self, name: str = "solver") -> None:
        """The module of that name."""
        names: dict[str, Any] = {"call_kernel": call_kernel, "call_fused": call_fused, "call_normal": call_normal}
        exec(_code(name), names)  # noqa: S102 - our own text
        self._names = names

    def expect(self, products: float) -> None:
        """There is nothing to choose from."""

    def blank(self, kind: type) -> Any:
        """A record with nothing in it."""
        return self._names[kind.__name__]()

    def routine(self, name: str, *_kinds: type) -> Callable[..., int]:
        """The public function ``name``: arrays, records and integers go in, changed arrays come out."""
        function = self._names[name]

        def call(*arguments: Any) -> int:
            with np.errstate(all="ignore"):
                given = [a.reshape(-1) if isinstance(a, np.ndarray) else a for a in arguments]
                return int(function(*given) or 0)

        return call


@cache
def _code(name: str) -> CodeType:
    """The text of a module, compiled once for a process."""
    module = {"solver": solver_module, "consensus": consensus_module}[name]
    text = python.PRELUDE + "\n\n" + python.text(module(LANES))
    return compile(text, f"<{name}>", "exec")
