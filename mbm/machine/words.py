"""The words of restricted Python (see `from_python`): types of parameters, and calls that run as Python too.

Apart from its reader, as routines that are compiled already need no more than this.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Real = float
Integer = int
Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
ConstantReals = NDArray[np.float64]
ConstantIntegers = NDArray[np.int64]

Some = TypeVar("Some", bound=Callable[..., object])


def distinct_arrays(function: Some) -> Some:
    """A decorator: no array that the function writes overlaps another one that it is given."""
    return function


def call_kernel(address: Integer, inputs: ConstantReals, outputs: Reals, blocks: Integer) -> None:
    """`CALL_KERNEL` for solvers that run as Python: call the machine code at ``address``."""
    signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    signature(int(address))(inputs.ctypes.data, outputs.ctypes.data, blocks)


def call_fused(address: Integer, point: ConstantReals, data: ConstantReals, target: Reals, stride: Integer) -> None:
    """`CALL_FUSED` likewise."""
    signature = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)
    signature(int(address))(point.ctypes.data, data.ctypes.data, target.ctypes.data, stride)


def call_normal(
    address: Integer, inputs: ConstantReals, weights: ConstantReals, losses: ConstantReals, sums: Reals, blocks: Integer
) -> None:
    """`CALL_NORMAL` likewise."""
    signature = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, ctypes.c_int64)
    signature(int(address))(inputs.ctypes.data, weights.ctypes.data, losses.ctypes.data, sums.ctypes.data, blocks)
