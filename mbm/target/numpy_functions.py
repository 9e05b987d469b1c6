"""The operations of straight-line programs as functions of NumPy, of numbers and arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.target.program import Operator


def _erf(x: Any) -> NDArray[np.float64]:
    from scipy.special import erf

    return np.asarray(erf(x), dtype=np.float64)


def function_of(operator: Operator) -> Callable[..., Any]:
    """What NumPy calls an operation; SciPy's error function, which NumPy lacks.

    Raises:
        AttributeError: NumPy has no function for it (`SELECT`, `TWICE`).
    """
    function: Callable[..., Any] = _erf if operator is Operator.ERF else getattr(np, operator.numpy)
    return function
