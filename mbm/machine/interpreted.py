"""A module of the little language run as Python, where no machine code can be made: slow, with the same answers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import CodeType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.machine import python
from mbm.machine.kinds import LANES
from mbm.machine.tree import Module
from mbm.machine.words import call_fused, call_kernel, call_normal


class Interpreted:
    """The functions of a module; what `kernels.native.engine.Library` is to machine code."""

    def __init__(self, code: CodeType) -> None:
        """The module whose `code_of` this is."""
        names: dict[str, Any] = {"call_kernel": call_kernel, "call_fused": call_fused, "call_normal": call_normal}
        exec(code, names)  # noqa: S102 - our own text
        self._names = names

    def blank(self, kind: type) -> Any:
        """A record with nothing in it."""
        return self._names[kind.__name__]()

    def call(self, name: str, *arguments: Any) -> int:
        """Call the public function ``name``: arrays, records and integers go in, changed arrays come out."""
        with np.errstate(all="ignore"):
            given = [_flat(a) if isinstance(a, np.ndarray) else a for a in arguments]
            return int(self._names[name](*given) or 0)

    def routine(self, name: str, *_kinds: type) -> Callable[..., int]:
        """The public function ``name`` by itself."""
        return partial(self.call, name)


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    """The memory of an array from its first number to its last, as machine code has it."""
    if array.flags.c_contiguous:
        return array.reshape(-1)
    span = 1 + sum((count - 1) * step // array.itemsize for count, step in zip(array.shape, array.strides, strict=True))
    return np.lib.stride_tricks.as_strided(array, (span if array.size else 0,), (array.itemsize,))


def code_of(module: Module) -> CodeType:
    """A module as compiled Python."""
    return compile(f"{python.PRELUDE}\n\nLANES = {LANES}\n\n\n{python.text(module)}", f"<{module.name}>", "exec")
