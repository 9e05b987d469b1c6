"""The default: CasADi's virtual machine for few rows, NumPy over the instruction stream for many."""

from __future__ import annotations

from dataclasses import dataclass

from mbm.kernels.backends import casadi_map, numpy_stream
from mbm.kernels.types import Evaluation, Kernel

MANY = 192
"""Rows from which NumPy is faster, for short and long kernels alike (`benchmarks/kernels.py`): it pays for each
instruction once per block of rows, CasADi once per row."""


@dataclass(frozen=True, slots=True)
class AutomaticBackend:
    """Whichever of the two is faster for the number of rows."""

    name: str = "auto"

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Buffers for ``rows`` rows of the backend that suits them."""
        backend = numpy_stream.BACKEND if rows >= MANY else casadi_map.BACKEND
        return backend.prepare(kernel, rows)


BACKEND = AutomaticBackend()
