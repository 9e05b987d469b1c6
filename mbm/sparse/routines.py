"""The routines for blocks of given sizes: made ready once for a pattern, called with arrays and records.

They are machine code, that of small problems made fast rather than running fast; where none can be made, they run as
Python.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.types import Floats
from mbm.kernels.native.sources import source_digest
from mbm.kernels.types import MachineCode
from mbm.machine.from_python import module_of
from mbm.machine.records import EIGHT, address, blank, put
from mbm.machine.tree import Module
from mbm.sparse.blocks import elimination, frontal, ordering, products, substitution
from mbm.sparse.blocks.parts import product_name
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.native.engine import Library
    from mbm.kernels.store import Store
    from mbm.kernels.types import Backend
    from mbm.machine.interpreted import Interpreted


PLAIN: tuple[Callable[..., object], ...] = (
    products.put_inputs,
    products.put_nonzeros,
    products.add_gradient,
    products.add_squares,
    products.put_image,
    substitution.solve_triangular,
)
"""Routines for blocks of any size."""

ELIMINATION: tuple[Callable[..., object], ...] = (
    elimination.inverse_roots,
    elimination.put_couplings,
    elimination.reduce_members,
    elimination.reduce_blocks,
    elimination.reduce_sparse,
    substitution.put_rooted,
    substitution.add_coupled,
    substitution.add_coupled_once,
    substitution.images_dense,
    substitution.images_sparse,
    substitution.put_inverse_blocks,
    substitution.put_diagonals,
)
"""Routines for the elimination of a family with members of one size."""

FRONTS: tuple[Callable[..., object], ...] = (
    ordering.order_nodes,
    frontal.factorise_fronts,
    frontal.solve_fronts,
    frontal.inverse_fronts,
)
"""The elimination order, and routines for fronts of any size."""


def fronts_module() -> Module:
    """The routines for fronts."""
    return module_of("fronts", FRONTS)


def blocks_module(sizes: Iterable[tuple[int, int]], size: int | None) -> Module:
    """All routines: products for the ``sizes`` (outputs, right), elimination of members of ``size`` columns."""
    parts = [module_of("blocks", PLAIN)]
    for outputs, right in sizes:
        part = module_of("product", [products.add_products], constants={"OUTPUTS": outputs, "RIGHT": right})
        named = tuple(replace(each, name=product_name(outputs, right)) for each in part.functions)
        parts.append(replace(part, functions=named))
    if size is not None:
        parts.append(module_of("elimination", ELIMINATION, constants={"SIZE": size}))
    functions = tuple(each for part in parts for each in part.functions)
    records = {each.name: each for part in parts for each in part.records}
    return Module(name="blocks", functions=functions, records=tuple(records.values()))


LIGHT, FAST = 0, 3
"""Levels of optimisation: code that is made at once, and code that runs fast."""

WORTH = 20_000
"""Numbers in the Jacobian from which code that runs fast is worth the second that it takes to make."""

FLAGS = ("contract", "reassoc")
"""Sums of products may be fused and taken in another order: they are rounded anyway."""


PIECES = 4
"""Parts of a sum that are summed by themselves: their number does not depend on that of the threads, nor do sums."""

HEAVY = 500_000
"""Numbers in the Jacobian from which several threads are worth their while."""


class _MachineCode:
    """What `Interpreted` is to Python, of a library of machine code."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._known: dict[str, Callable[..., int]] = {}

    def blank(self, kind: type) -> NDArray[np.int64]:
        """Memory for a record."""
        return blank(kind)

    def call(self, name: str, *arguments: Any) -> int:
        """Call a routine. The last axis of arrays must be contiguous."""
        function = self._known.get(name)
        if function is None:
            kinds = [ctypes.c_void_p if isinstance(each, np.ndarray) else ctypes.c_int64 for each in arguments]
            function = self._known[name] = ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(self._library.address(name))
        return function(*[_place(each) if isinstance(each, np.ndarray) else int(each) for each in arguments])


def _place(array: NDArray[Any]) -> int:
    """Where the numbers of an array are whose last axis is contiguous.

    Raises:
        TypeError: it is not, or of other numbers than machine code takes.

    """
    if array.flags.c_contiguous:
        return address(array)
    if array.strides[-1] != array.itemsize or array.itemsize != EIGHT:
        raise TypeError(array.strides)
    return int(array.ctypes.data)


@dataclass(frozen=True, slots=True, eq=False)
class Routines:
    """The functions of a library, by name; the ``threads`` of a ``pool`` share the work, if there is one.

    Arguments are integers, arrays of 64-bit numbers, and records.
    """

    library: _MachineCode | Interpreted
    threads: int = 1
    pool: ThreadPoolExecutor | None = None

    def filled(self, kind: type, /, **values: Any) -> Any:
        """A record with such fields; the arrays stay with the caller, who keeps them alive."""
        found = self.library.blank(kind)
        put(found, kind, **values)
        return found

    def call(self, name: str, *arguments: Any) -> int:
        """Call a routine; what it returns, if it returns something."""
        return self.library.call(name, *arguments)

    def run(self, name: str, count: int, *arguments: Any, scratch: int = 0) -> bool:
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

    def total(self, name: str, count: int, shape: tuple[int, ...], *arguments: Any) -> Floats:
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


@dataclass(frozen=True, slots=True, eq=False)
class Making:
    """How routines are made for problems with so many ``numbers`` in the Jacobian, and for kernels of a ``backend``.

    Where its kernels are no machine code, the routines may be all the same: that is looked into.
    """

    backend: Backend | None
    numbers: int

    def routines(self, products: Iterable[tuple[int, int]], size: int | None, threads: int) -> Routines:
        """Those for products with right blocks (outputs, columns), and for members of ``size`` columns that go.

        ``size`` None: none goes. So many ``threads`` share the work.
        """
        sizes = tuple(sorted(set(products)))
        # The inner loops are unrolled and side by side; vectors across the outer ones would gather and scatter.
        library = self._library(f"blocks {sizes} {size}", lambda: blocks_module(sizes, size), loops=False)
        threads = threads if isinstance(library, _MachineCode) else 1
        return Routines(library, threads, ThreadPoolExecutor(threads) if threads > 1 else None)

    def front_routines(self) -> Routines:
        """Those for fronts and their order, which are the same for all problems; for one thread."""
        return Routines(self._library("fronts", fronts_module, loops=True))

    def _library(self, name: str, module: Callable[[], Module], *, loops: bool) -> _MachineCode | Interpreted:
        """From the backend's store, or compiled and put there."""
        from mbm.kernels.native.engine import hindrance, kept
        from mbm.machine import llvm

        store: Store | None = getattr(self.backend, "store", None)
        if not isinstance(self.backend, MachineCode) and hindrance(store) is not None:
            # Loaded where there is nothing else.
            from mbm.machine.interpreted import Interpreted, code_of

            return Interpreted(code_of(module()))
        name = f"{name} {source_digest('sparse/blocks')}"
        level = FAST if self.numbers >= WORTH else LIGHT
        return _MachineCode(kept(name, lambda: llvm.text(module(), FLAGS), store, level, loops=loops))
