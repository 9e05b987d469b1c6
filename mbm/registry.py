"""What is plugged in: one immutable value, made here and passed as an argument; no module holds any of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.data.readers import READERS
from mbm.data.types import Reader
from mbm.language.evaluator import Vocabulary
from mbm.language.limits import Limits
from mbm.shapes.vocabulary import vocabulary

if TYPE_CHECKING:
    from mbm.kernels.types import Backend


def _casadi() -> Backend:
    from mbm.kernels.backends.casadi_map import BACKEND

    return BACKEND


def _numpy() -> Backend:
    from mbm.kernels.backends.numpy_stream import BACKEND

    return BACKEND


def _automatic() -> Backend:
    from mbm.kernels.backends.automatic import BACKEND

    return BACKEND


_BACKENDS: Mapping[str, Callable[[], Backend]] = MappingProxyType(
    {"auto": _automatic, "casadi": _casadi, "numpy": _numpy}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """Vocabulary, readers by name, and what makes a backend by the name that ``--backend`` gives it."""

    vocabulary: Vocabulary
    readers: Mapping[str, Reader] = field(default_factory=lambda: READERS)
    backends: Mapping[str, Callable[[], Backend]] = field(default_factory=lambda: _BACKENDS)
    limits: Limits = field(default_factory=Limits)


def standard_registry() -> Registry:
    """What mbm itself brings."""
    return Registry(vocabulary=vocabulary())
