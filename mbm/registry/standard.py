"""What is plugged in: one immutable value, made here and passed as an argument; no module holds any of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field, replace
from functools import cache, partial
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.language.limits import Limits
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.data.types import AnyReader
    from mbm.estimation.starts.closed_forms.types import ClosedForm
    from mbm.kernels.called_functions import CalledFunctions
    from mbm.kernels.store import Store
    from mbm.kernels.types import Backend, KernelSet
    from mbm.language.values import Vocabulary
    from mbm.problem.builder import Front


CLOSED_FORMS, READERS, FUNCTIONS = "mbm.closed_forms", "mbm.readers", "mbm.functions"
"""The groups of entry points by which Python packages add closed forms, file formats, and functions of the language."""


def _vocabulary() -> Vocabulary:
    from mbm.language.functions import DeferredFunction
    from mbm.language.values import Builtin
    from mbm.registry.plug_ins import Group
    from mbm.shapes.vocabulary import vocabulary

    words = vocabulary()
    group = Group(name=FUNCTIONS, wanted="function of the language", suits=lambda found: isinstance(found, Builtin))
    added = {name: DeferredFunction(name, partial(group.loaded, point)) for name, point in group.announced().items()}
    return replace(words, functions={**added, **words.functions}) if added else words


class _Readers(Mapping[str, "AnyReader"]):
    """The readers of mbm by name, and then those of packages, which are asked for names that mbm does not have."""

    def __init__(self, own: Mapping[str, AnyReader]) -> None:
        self._own = own
        self._found: Mapping[str, Callable[[], AnyReader]] | None = None

    @property
    def _added(self) -> Mapping[str, Callable[[], AnyReader]]:
        if self._found is None:
            from mbm.data.types import AnyReader
            from mbm.registry.plug_ins import Group

            group = Group(name=READERS, wanted="reader", suits=lambda found: isinstance(found, AnyReader))
            self._found = {name: partial(group.loaded, point) for name, point in group.announced().items()}
        return self._found

    def __getitem__(self, name: str) -> AnyReader:
        return self._own[name] if name in self._own else self._added[name]()

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._added

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from (name for name in self._added if name not in self._own)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _readers() -> Mapping[str, AnyReader]:
    from mbm.data.readers import READERS as OWN

    return _Readers(OWN)


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
    from mbm.estimation.starts.closed_forms.standard import STANDARD

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
    kernels and object code from one process to the next, if anything does. ``given`` are the closed forms that the
    caller has brought.
    """

    vocabulary: Callable[[], Vocabulary] = _vocabulary
    readers: Callable[[], Mapping[str, AnyReader]] = _readers
    backends: Mapping[str, Callable[[Store | None], Backend]] = field(default_factory=lambda: _BACKENDS)
    store: Callable[[], Store | None] = _store
    closed_forms: Callable[[], tuple[ClosedForm, ...]] = _closed_forms
    given: tuple[ClosedForm, ...] = ()
    limits: Limits = field(default_factory=Limits)

    def backend(self, name: str) -> Backend:
        """The backend of a name, with the store to keep what it compiles in."""
        return self.backends[name](self.store())

    def front(self, *, drawing: bool) -> Front:
        """What elaboration needs besides the text; ``drawing``: inputs may be without a variance."""
        from mbm.data.types import Formats
        from mbm.problem.builder import Front

        return Front(
            vocabulary=self.vocabulary(),
            limits=self.limits,
            formats=Formats(self.readers()),
            routines=lambda: tuple(form.name for form in self.closed_forms()),
            drawing=drawing,
        )

    def suited(self, backend: Backend, kernels: KernelSet, functions: CalledFunctions | None) -> Backend:
        """``backend``, or what stands in for it where these kernels are not for it, or call ``functions``."""
        from mbm.kernels.backends.automatic import suited

        chosen = suited(backend, kernels)
        if functions is None:
            return chosen
        from mbm.kernels.backends.calling import backend as calling

        return calling(chosen, functions)


def standard_registry(closed_forms: tuple[ClosedForm, ...] = ()) -> Registry:
    """What mbm itself brings, and what packages add; ``closed_forms`` of the caller are tried before all others."""
    # packages are asked once, not for each solve
    forms = cache(lambda: (*closed_forms, *_installed(), *_closed_forms()))
    return Registry(vocabulary=cache(_vocabulary), readers=cache(_readers), closed_forms=forms, given=closed_forms)


def _installed() -> tuple[ClosedForm, ...]:
    """The closed forms that installed packages announce, by name."""
    from mbm.registry.plug_ins import Group

    members = ("name", "joint", "recognises", "solve")
    group = Group(
        name=CLOSED_FORMS, wanted="closed form", suits=lambda found: all(hasattr(found, each) for each in members)
    )
    return tuple(group.loaded(point) for point in group.announced().values())
