"""What `mbm check` says of starts."""

from __future__ import annotations

from mbm import compiler
from mbm.problem.elaborated import Elaborated
from mbm.registry.standard import Registry
from mbm.text.types import Diagnostic, MbmError


def without_start(found: Elaborated, registry: Registry) -> tuple[Diagnostic, ...]:
    """Unknowns that a solve would find no start for, which is looked at where random points cannot help."""
    from mbm.estimation.search.startless import may_be_startless
    from mbm.problem.structure import called_functions

    if called_functions(found.problem) or not may_be_startless(found.problem, found.tables):
        return ()
    from mbm.equations.binding import EvaluationCache
    from mbm.estimation.solve.choice import chosen_solver

    kernels = compiler.derived(found)
    cache = EvaluationCache(registry.suited(registry.backend("auto"), kernels, None))
    try:
        chosen_solver(found, kernels, cache, registry.closed_forms())
    except MbmError as error:
        return error.diagnostics
    return ()
