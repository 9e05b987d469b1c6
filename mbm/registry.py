"""What is plugged in: one immutable value, made here and passed as an argument; no module holds any of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.language.limits import Limits
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.data.types import ManyReader, Reader
    from mbm.kernels.store import Store
    from mbm.kernels.types import Backend, KernelSet
    from mbm.language.values import Vocabulary
    from mbm.solution.closed_forms.types import ClosedForm


def _vocabulary() -> Vocabulary:
    from mbm.shapes.vocabulary import vocabulary

    return vocabulary()


def _readers() -> Mapping[str, Reader | ManyReader]:
    from mbm.data.readers import READERS

    return READERS


def _casadi(store: Store | None) -> Backend:
    from mbm.kernels.backends.casadi_map import CasadiBackend

    return CasadiBackend(store=store)


def _numpy(store: Store | None) -> Backend:
    from mbm.kernels.backends.numpy_stream import NumpyBackend

    return NumpyBackend(store=store)


def _native(store: Store | None) -> Backend:
    from mbm.kernels.backends.native import backend

    return backend(store)


def _automatic(store: Store | None) -> Backend:
    from mbm.kernels.backends.automatic import backend

    return backend(store)


def _closed_forms() -> tuple[ClosedForm, ...]:
    from mbm.solution.closed_forms.standard import STANDARD

    return STANDARD


def _store() -> Store | None:
    from mbm.kernels.store import standard_store

    return standard_store()


_BACKENDS: Mapping[str, Callable[[Store | None], Backend]] = MappingProxyType(
    {"auto": _automatic, "native": _native, "casadi": _casadi, "numpy": _numpy}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """Vocabulary, readers by name, what makes a backend by the name that ``--backend`` gives it, and the closed forms.

    Each is called where it is needed: a warm start does without most of them. ``store`` is what keeps equations,
    kernels and object code from one process to the next, if anything does.
    """

    vocabulary: Callable[[], Vocabulary] = _vocabulary
    readers: Callable[[], Mapping[str, Reader | ManyReader]] = _readers
    backends: Mapping[str, Callable[[Store | None], Backend]] = field(default_factory=lambda: _BACKENDS)
    store: Callable[[], Store | None] = _store
    closed_forms: Callable[[], tuple[ClosedForm, ...]] = _closed_forms
    limits: Limits = field(default_factory=Limits)

    def backend(self, name: str) -> Backend:
        """The backend of a name, with the store to keep what it compiles in."""
        return self.backends[name](self.store())

    def suited(self, backend: Backend, kernels: KernelSet) -> Backend:
        """``backend``, or what stands in for it where these kernels are not for it."""
        from mbm.kernels.backends.automatic import suited

        return suited(backend, kernels)


ENTRY_POINTS = "mbm.closed_forms"
"""The group of entry points by which Python packages add closed forms."""


def standard_registry(closed_forms: tuple[ClosedForm, ...] = ()) -> Registry:
    """What mbm itself brings, and what packages add; ``closed_forms`` of the caller are tried before all others."""
    # packages are asked once, not for each solve
    forms = cache(lambda: (*closed_forms, *_installed(), *_closed_forms()))
    return Registry(vocabulary=cache(_vocabulary), closed_forms=forms)


def _installed() -> tuple[ClosedForm, ...]:
    """The closed forms that installed packages announce, by name."""
    from importlib.metadata import entry_points

    found = sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)
    return tuple(point.load() for point in found)
