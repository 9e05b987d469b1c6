"""The solver and the kernels of a problem as machine code, made once and kept with what else is kept of the problem."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import field
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.equations.binding import EvaluationCache
from mbm.kernels.native.sources import source_digest
from mbm.kernels.types import Backend, Kernel, MachineCode, Stream
from mbm.machine.kinds import LANES
from mbm.machine.records import address, blank
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.native.callbacks import CallbackKernels, InterpretedCode
    from mbm.kernels.native.engine import Library
    from mbm.kernels.native.kernels import KernelCode, NativeKernels
    from mbm.kernels.native.normal import NormalKernels
    from mbm.kernels.store import Store

UNOPTIMISED, OPTIMISED = 0, 2
"""Levels of optimisation."""

WORTH = 1e10
"""Products, as `expect` is told of them, from which making the fast code pays: it takes 3.3 s of a processor (that of
consensus 2.5 s), and saves 0.1 (hundreds of unknowns) to 0.5 ns (few) of each (measured)."""

KEPT_WORTH = 3e9
"""The same where a store keeps it, for the processes to come: a second or so that each of them would lose."""


def share(work: Callable[[int, int], None], count: int, workers: int) -> None:
    """``work(first, last)`` for all of ``count``, shared by so many threads."""
    if workers <= 1 or count < 2:
        work(0, count)
        return
    from concurrent.futures import ThreadPoolExecutor  # loads what logs; one data set needs no threads

    cuts = np.linspace(0, count, min(workers, count) + 1).astype(int).tolist()
    with ThreadPoolExecutor(len(cuts) - 1) as pool:
        list(pool.map(work, cuts[:-1], cuts[1:]))


@dataclass(frozen=True, slots=True, eq=False)
class Routine:
    """A function of the solver: arrays and integers go in, changed arrays come out.

    The call lets other threads run.
    """

    function: Any

    def __call__(self, *arguments: NDArray[Any] | int) -> int:
        """Call it; arrays are of 64-bit numbers, contiguous, and stay with the caller."""
        plain = [a if isinstance(a, int) else address(a) for a in arguments]
        found: int = self.function(*plain)
        return found


class SolverCode:
    """The compiled solver. Local to one process; several threads may call its routines.

    Code that runs fast takes seconds to make, plain code, which gives the same numbers to the last bit, a tenth of
    one. So plain code serves until what it has been asked for takes as long as the fast one would take to make; what
    the store has of the fast one is taken at once.
    """

    def __init__(self, store: Store | None, name: str, text: Callable[[], str], worth: float | None = None) -> None:
        """``worth``: products from which the fast code pays (None: as is measured of the solver)."""
        self._store = store
        self._worth = worth if worth is not None else WORTH if store is None else KEPT_WORTH
        self._name = f"{name} {source_digest('solver')}"
        self._text = text
        self._expected = 0.0
        self._lock = Lock()
        self._libraries: list[Library] = []  # none goes while a thread may be in it
        self._known: dict[str, Routine] = {}
        self.fast = False
        """Whether all that is to come is done by the fast code."""

    def expect(self, products: float) -> None:
        """Choose the code for so many products more; inf: for work without end."""
        if self.fast:
            return
        from mbm.kernels.native.engine import fetched, kept

        with self._lock:
            self._expected += products
            found = None
            if not self._libraries:
                found = fetched(self._name, self._store, OPTIMISED, compact=True)
            if found is None and self._expected >= self._worth:
                found = kept(self._name, self._text, self._store, OPTIMISED, compact=True)
            if found is not None:
                self._libraries.append(found)
                self._known = {}
                self.fast = True
            elif not self._libraries:
                self._libraries.append(kept(self._name, self._text, self._store, UNOPTIMISED))

    def blank(self, kind: type) -> NDArray[np.int64]:
        """Memory for a record, with nothing in it."""
        return blank(kind)

    def routine(self, name: str, *kinds: type) -> Routine:
        """The public function ``name``; ``kinds`` says of each argument whether it is an array or an ``int``."""
        known = self._known
        found = known.get(name)
        if found is None:
            types = [ctypes.c_int64 if kind is int else ctypes.c_void_p for kind in kinds]
            signature = ctypes.CFUNCTYPE(ctypes.c_int64, *types)
            found = known[name] = Routine(signature(self._libraries[-1].address(name)))
        return found


AnyCode: TypeAlias = "SolverCode | InterpretedCode"


def _text() -> str:
    """The IR of the solver."""
    from mbm.machine import llvm
    from mbm.solver.modules import solver_module

    return llvm.text(solver_module(LANES))


def _consensus_text() -> str:
    """The IR of consensus."""
    from mbm.machine import llvm
    from mbm.solver.modules import consensus_module

    return llvm.text(consensus_module(LANES))


def _lags_text() -> str:
    """The IR of what tells correlated residuals."""
    from mbm.machine import llvm
    from mbm.solver.modules import lags_module

    return llvm.text(lags_module(LANES))


def _filters_text() -> str:
    """The IR of filters and smoothers."""
    from mbm.machine import llvm
    from mbm.solver.modules import filters_module

    return llvm.text(filters_module(LANES))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Described:
    """``system`` and ``constants`` of equations with up to ``rows`` rows in each group; ``fused`` is their code."""

    rows: tuple[int, ...]
    system: NDArray[np.int64]
    constants: NDArray[np.float64]
    fused: object = field(repr=False)


class NativeCode:
    """What native solves of one compiled problem share; local to it, as `EvaluationCache` is.

    ``systems`` keeps descriptions by structure and settings. With a ``backend`` whose kernels are machine code the
    solver is machine code too; else that is looked into first, and where none can be made its text runs as Python.
    """

    def __init__(self, backend: Backend | None) -> None:
        self.store: Store | None = getattr(backend, "store", None)
        self._code: KernelCode | None = getattr(backend, "code", None)
        self._sure = isinstance(backend, MachineCode)
        self._solver: AnyCode | None = None
        self._consensus: AnyCode | None = None
        self._lags: AnyCode | None = None
        self._filters: AnyCode | None = None
        self._callbacks: dict[tuple[int, ...], CallbackKernels] = {}
        self.sums: dict[object, NormalKernels] = {}
        self.systems: dict[object, Described] = {}
        self.latest: object = None  # what `system_of` keeps of the last system

    @property
    def solver(self) -> AnyCode:
        """The solver, compiled or fetched when first asked for."""
        if self._solver is None:
            self._solver = self._made("solver", _text)
        return self._solver

    @property
    def consensus(self) -> AnyCode:
        """Consensus, likewise."""
        if self._consensus is None:
            self._consensus = self._made("consensus", _consensus_text)
        return self._consensus

    @property
    def lags(self) -> AnyCode:
        """What tells correlated residuals, for many rows and unknowns: it runs fast from the first."""
        if self._lags is None:
            self._lags = self._made("lags", _lags_text, 0.0)
        return self._lags

    @property
    def filters(self) -> AnyCode:
        """Filters and smoothers, likewise."""
        if self._filters is None:
            self._filters = self._made("filters", _filters_text)
        return self._filters

    def _made(self, name: str, text: Callable[[], str], worth: float | None = None) -> AnyCode:
        if not self._sure:
            from mbm.kernels.native.engine import hindrance

            if hindrance(self.store) is not None:
                # Loaded where there is nothing else.
                from mbm.estimation.native.callbacks import InterpretedCode

                return InterpretedCode(name)
        return SolverCode(self.store, name, text, worth)

    def callbacks(
        self, numbers: Sequence[int], kernels: Sequence[Kernel], streams: Sequence[Stream]
    ) -> CallbackKernels:
        """Some kernels, the k-th under the number k, that the ``streams`` of a backend evaluate."""
        key = tuple(numbers)
        if key not in self._callbacks:
            from mbm.estimation.native.callbacks import CallbackKernels

            widths = [(len(k.variables) + len(k.parameters), k.outputs, len(k.jacobian_rows)) for k in kernels]
            self._callbacks[key] = CallbackKernels(streams, widths)
        return self._callbacks[key]

    def kernels(self, kernels: Sequence[Kernel], rows: int, *, often: bool) -> NativeKernels:
        """The code of some kernels, the k-th under the number k; that of the backend, where it is machine code.

        ``rows`` and ``often`` as `KernelCode.of` takes them.
        """
        if self._code is None:
            from mbm.kernels.native.kernels import KernelCode

            self._code = KernelCode(self.store)
        return self._code.of(kernels, rows, often=often)


def native_code(cache: EvaluationCache) -> NativeCode:
    """What native solves of a problem share."""
    found = cache.native.get("code")
    if not isinstance(found, NativeCode):
        found = cache.native["code"] = NativeCode(cache.backend)
    return found
