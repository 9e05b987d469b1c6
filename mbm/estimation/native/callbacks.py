"""The compiled solver and Python: kernels that it evaluates, and the solver's text run by it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cache
from types import CodeType
from typing import Any

import numpy as np

from mbm.equations.types import Floats
from mbm.kernels.types import Stream
from mbm.machine.interpreted import Interpreted, code_of
from mbm.machine.kinds import LANES
from mbm.solver.modules import consensus_module, filters_module, lags_module, solver_module

KERNEL = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
"""The signature of ``call_kernel``."""


class Guard:
    """What ended an evaluation, if anything did. Several threads may evaluate: the first failure ends them all."""

    def __init__(self) -> None:
        self._failure: BaseException | None = None

    def fill(self, target: Floats, evaluate: Callable[[], None]) -> None:
        """Let ``evaluate`` fill the ``target``; NaN where it fails, and where something failed before."""
        if self._failure is None:
            try:
                with np.errstate(all="ignore"):
                    evaluate()
            except BaseException as failure:  # noqa: BLE001 - raised again by who asked for the solve
                self._failure = failure
        if self._failure is not None:
            target[...] = np.nan

    def raise_failure(self) -> None:
        """Raise what ended an evaluation; a solve after that begins anew."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure


class CallbackKernels:
    """Addresses of functions as `kernels.native.kernels.NativeKernels` has them, for streams of any backend.

    They live as long as this does.
    """

    def __init__(self, streams: Sequence[Stream], widths: Sequence[tuple[int, int, int]]) -> None:
        """The k-th of the ``streams`` is kernel k; ``widths`` has its inputs, outputs and nonzeros."""
        self.guard = Guard()
        self._held = tuple(self._pair(s, *w) for s, w in zip(streams, widths, strict=True))

    def values_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k``."""
        return address_of(self._held[k][0])

    def jacobian_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k`` and behind them the nonzeros of the Jacobian."""
        return address_of(self._held[k][1])

    def _pair(self, stream: Stream, inputs: int, outputs: int, nonzeros: int) -> tuple[Any, Any]:
        """The functions of one kernel."""

        def values(given: int | None, target: int, blocks: int) -> None:
            found = _lanes(target, outputs, blocks)

            def evaluate() -> None:
                found[...] = _by_lanes(stream.values(_rows(given, inputs, blocks)))

            self.guard.fill(found, evaluate)

        def jacobian(given: int | None, target: int, blocks: int) -> None:
            found = _lanes(target, outputs + nonzeros, blocks)

            def evaluate() -> None:
                found[...] = _by_lanes(np.hstack(stream.values_and_jacobian(_rows(given, inputs, blocks))))

            self.guard.fill(found, evaluate)

        return KERNEL(values), KERNEL(jacobian)


def address_of(callback: Any) -> int:
    """Where a callback is called."""
    return ctypes.cast(callback, ctypes.c_void_p).value or 0


def memory(begin: int | None, count: int) -> Floats:
    """The numbers that stand in memory from an address on."""
    if begin is None or count == 0:
        return np.zeros(0)
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(begin))


def _lanes(begin: int | None, width: int, blocks: int) -> Floats:
    """What a kernel takes or gives: (blocks, width, LANES)."""
    return memory(begin, blocks * width * LANES).reshape(blocks, width, LANES)


def _rows(begin: int | None, width: int, blocks: int) -> Floats:
    """The same row by row (rows, width), as streams take it."""
    return _lanes(begin, width, blocks).transpose(0, 2, 1).reshape(blocks * LANES, width)


def _by_lanes(values: Floats) -> Floats:
    """Rows (rows, width) as kernels give them."""
    return values.reshape(-1, LANES, values.shape[1]).transpose(0, 2, 1)


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
    known = {"solver": solver_module, "consensus": consensus_module, "filters": filters_module, "lags": lags_module}
    return code_of(known[name](LANES))
