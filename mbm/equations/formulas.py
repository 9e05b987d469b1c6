"""Formulas of the solver for arrays, element by element."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from mbm.equations.types import Floats


@cache
def of_arrays(formula: Callable[..., float]) -> Callable[..., Floats]:
    """A formula of the solver for arrays."""
    # Loaded where one is evaluated here: few solves need what the compiled solver does not do itself.
    from mbm.machine.elementwise import elementwise

    return elementwise(formula)
