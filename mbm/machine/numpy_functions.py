"""The operations of straight-line programs as functions of NumPy, of numbers and arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.machine.program import Operator


def _erf(x: Any) -> NDArray[np.float64]:
    from scipy.special import erf

    return np.asarray(erf(x), dtype=np.float64)


def _remainder(a: Any, b: Any) -> Any:
    return a - b * np.rint(a / b)


_OWN: Mapping[Operator, Callable[..., Any]] = {Operator.ERF: _erf, Operator.REMAINDER: _remainder}


def function_of(operator: Operator) -> Callable[..., Any]:
    """What NumPy calls an operation; of what it lacks, a function made of others.

    Raises:
        AttributeError: there is none (`SELECT`, `TWICE`).
    """
    function: Callable[..., Any] = _OWN[operator] if operator in _OWN else getattr(np, operator.numpy)
    return function
