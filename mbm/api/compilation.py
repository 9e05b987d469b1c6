"""The equations of a problem made ready for its data, and the problem that they are of."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.compiler import Inputs
from mbm.files.journal import noting
from mbm.problem.elaborated import Elaborated
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.reading import Reading
    from mbm.equations.binding import EvaluationCache
    from mbm.kernels.types import KernelSet
    from mbm.registry.standard import Registry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Origin:
    """The problem of a program that is compiled: by name (None: the only one), with what results call its file."""

    reading: Reading = field(repr=False)
    registry: Registry = field(repr=False)
    file: str | None
    name: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compilation:
    """The equations for tables, and the kernels made ready for them; ``key`` is that of their entry in the store."""

    elaborated: Elaborated
    kernels: KernelSet
    cache: EvaluationCache
    key: str | None = None


def compilation_of(origin: Origin, inputs: Inputs, backend: str) -> Compilation:
    """The compilation for ``inputs``.

    Raises:
        MbmError: the problem, its data or the name of the backend are wrong, or it calls functions in Python that are
            not allowed, or cannot be loaded.

    """
    from mbm.equations.binding import EvaluationCache
    from mbm.kernels.types import BackendUnavailableError

    if backend not in origin.registry.backends:
        from mbm.problem import faults

        raise MbmError(faults.unknown_backend(backend, tuple(origin.registry.backends)))
    try:
        evaluating = origin.registry.backend(backend)
    except BackendUnavailableError as error:
        from mbm.problem import faults

        raise MbmError(faults.native_unavailable(str(error))) from None
    found = origin.reading.compiled(origin.name, inputs)
    functions = compiler.called_functions(found.kernels, inputs, origin.reading.base)
    if functions is not None:
        with noting(origin.reading.journal):
            functions.load(found.kernels)
    return Compilation(
        elaborated=found.elaborated,
        kernels=found.kernels,
        cache=EvaluationCache(origin.registry.suited(evaluating, found.kernels, functions), found.without_closed_form),
        key=found.key,
    )
