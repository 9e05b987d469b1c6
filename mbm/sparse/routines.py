"""Compiled routines for blocks of given sizes: made ready once for a pattern, called with arrays."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.kernels.native.sources import source_digest
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.native.engine import Library
    from mbm.kernels.store import Store

LEVEL = 3
FLAGS = ("contract", "reassoc")
"""Sums of products may be fused and taken in another order: they are rounded anyway."""

Argument = int | Floats | Indices


PIECES = 4
"""Parts of a sum that are summed by themselves: their number does not depend on that of the threads, nor do sums."""

HEAVY = 500_000
"""Numbers in the Jacobian from which several threads are worth their while."""


@dataclass(frozen=True, slots=True, eq=False)
class Routines:
    """The functions of a library, by name; the ``threads`` of a ``pool`` share the work, if there is one."""

    library: Library
    threads: int = 1
    pool: ThreadPoolExecutor | None = None

    def call(self, name: str, *arguments: Argument) -> int:
        """Call a routine; what it returns, if it returns something. The last axis of arrays must be contiguous."""
        kinds: list[type[ctypes.c_void_p | ctypes.c_int64]] = []
        values: list[int] = []
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                aligned = argument.flags.c_contiguous or argument.strides[-1] == argument.itemsize
                if not aligned or argument.dtype not in (np.float64, np.int64):
                    raise TypeError(name)
                kinds.append(ctypes.c_void_p)
                values.append(argument.ctypes.data)
            else:
                kinds.append(ctypes.c_int64)
                values.append(int(argument))
        function: Callable[..., int] = ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(self.library.address(name))
        return function(*values)

    def run(self, name: str, count: int, *arguments: Argument, scratch: int = 0) -> bool:
        """Call a routine for all of ``count``, in parts that write to different places; whether all returned 0.

        ``scratch``: numbers, zero, that each part is given for itself as the last argument.
        """

        def part(first: int, last: int) -> int:
            own = (np.zeros(scratch),) if scratch else ()
            return self.call(name, first, last, *arguments, *own)

        if self.pool is None:
            return part(0, count) == 0
        ends = _ends(count, 8 * self.threads)
        return sum(abs(f.result()) for f in [self.pool.submit(part, *end) for end in ends]) == 0

    def share(self, work: Callable[[int, int], None], count: int, size: int) -> None:
        """Do ``work(first, last)`` for all of ``count``, so many at a time, each in one thread."""
        firsts = range(0, count, size)
        if self.pool is None:
            for first in firsts:
                work(first, min(first + size, count))
            return
        for future in [self.pool.submit(work, first, min(first + size, count)) for first in firsts]:
            future.result()

    def total(self, name: str, count: int, shape: tuple[int, ...], *arguments: Argument) -> Floats:
        """What a routine adds up over all of ``count`` in its last argument, an array of that shape."""
        sums = np.zeros((PIECES, *shape))
        parts = [(first, last, *arguments, sums[k]) for k, (first, last) in enumerate(_ends(count, PIECES))]
        if self.pool is None:
            for given in parts:
                self.call(name, *given)
        else:
            for future in [self.pool.submit(self.call, name, *given) for given in parts]:
                future.result()
        return np.asarray(sums.sum(axis=0))


def _ends(count: int, pieces: int) -> list[tuple[int, int]]:
    """``0 … count`` in so many parts."""
    return list(pairwise(count * k // pieces for k in range(pieces + 1)))


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def routines(products: Iterable[tuple[int, int]], size: int | None, store: Store | None, threads: int) -> Routines:
    """The routines for products with right blocks (outputs, columns), and for members of ``size`` columns that go.

    From the store, or compiled and put there. ``size`` None: none goes. So many ``threads`` share the work.
    """
    from mbm.kernels.native.engine import kept

    sizes = tuple(sorted(set(products)))
    name = f"blocks {source_digest('sparse/blocks', __file__)} {sizes} {size}"
    # The inner loops are unrolled and side by side; vectors across the outer ones would gather and scatter.
    library = kept(name, lambda: _lowered(sizes, size), store, LEVEL, loops=False)
    return Routines(library, threads, ThreadPoolExecutor(threads) if threads > 1 else None)


def front_routines(store: Store | None) -> Routines:
    """The routines for fronts and their order, which are the same for all problems, likewise; for one thread."""
    from mbm.kernels.native.engine import kept

    return Routines(kept(f"fronts {source_digest('sparse/blocks', __file__)}", _lowered_fronts, store, LEVEL))


def _lowered_fronts() -> str:
    from llvmlite import ir

    from mbm.machine.llvm import lower_into
    from mbm.sparse.blocks.modules import fronts_module

    target = ir.Module("fronts")
    lower_into(target, fronts_module(), FLAGS)
    return str(target)


def _lowered(sizes: tuple[tuple[int, int], ...], size: int | None) -> str:
    from llvmlite import ir

    from mbm.machine.llvm import lower_into
    from mbm.sparse.blocks.modules import blocks_module

    target = ir.Module("blocks")
    lower_into(target, blocks_module(sizes, size), FLAGS)
    return str(target)
